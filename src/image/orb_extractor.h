// ORB features spread evenly over an image (Rublee, Rabaud, Konolige, Bradski: "ORB: an efficient alternative to SIFT
// or SURF", ICCV 2011).
//
// Per pyramid level: FAST corners (Rosten, Drummond: "Machine learning for high-speed corner detection", ECCV 2006),
// with a lower threshold in cells where the first finds none; thinned to the level's share by suppression via square
// covering (Bailo et al.: "Efficient adaptive non-maximal suppression algorithms for homogeneous spatial keypoint
// distribution", Pattern Recognition Letters 2018); orientation by the intensity centroid; position refined below the
// pixel; steered BRIEF on the blurred level. The descriptors are bit-compatible with OpenCV's ORB (and so with DBoW2
// ORB vocabularies).
#pragma once

#include <opencv2/core.hpp>

#include "base/status.h"
#include "image/feature.h"

namespace cairn::image {

class OrbExtractor {
 public:
  // Parameters are checked by Extract (or ask parameters.Validate()).
  explicit OrbExtractor(const OrbParameters& parameters) : parameters_(parameters) {}

  const OrbParameters& parameters() const { return parameters_; }

  // Features of an 8-bit grey image (CV_8UC1), keypoints in its pixels with pixel centres at integer coordinates,
  // ordered by octave, then strongest first. At most `num_features`, or parameters().num_features if that is 0; fewer
  // where the image has no texture, none (not an error) when it has none at all or is smaller than a patch (33x33).
  // InvalidArgument: another image type, an empty image, a negative count, bad parameters.
  // A pure function of image and parameters; may be called by several threads at once.
  absl::StatusOr<Features> Extract(const cv::Mat& gray, int num_features = 0) const;

 private:
  OrbParameters parameters_;
};

}  // namespace cairn::image
