// What is done to every image of a sequence before anybody sees it: 16 bits become 8 by one range, of two half pictures
// woven into one the second is dropped, bands of light are evened out, and what is fixed to the camera is hidden. Found
// out from samples when the sequence is opened, and told.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/status.h"
#include "image/view_survey.h"
#include "io/intensity_range.h"

namespace cairn::io {

struct ImageTreatment {
  IntensityRange range;
  bool drop_second_field = false;
  double band_periods = 0.0;  // of bands of light that are evened out; 0: none
  image::MaskFiller hidden;

  // From an image of 8 or 16 bits to what is used.
  void Apply(cv::Mat* raw) const;
};

// CV_8UC1 of `size`; dark (below 128) is hidden. InvalidArgument for another size, or if it leaves next to nothing.
absl::StatusOr<image::MaskFiller> LoadMask(const std::string& path, cv::Size size);

// `paths` are the images in their order, some of which may not be readable. `mask_path`: empty, and what is fixed to
// the camera is looked for; "none": it is not. What was found is appended to `notes`.
absl::StatusOr<ImageTreatment> FindTreatment(const std::vector<std::string>& paths, cv::Size size,
                                             const std::string& mask_path, std::vector<std::string>* notes);

}  // namespace cairn::io
