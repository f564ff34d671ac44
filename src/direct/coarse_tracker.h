// Coarse-to-fine direct image alignment of a new frame against the newest keyframe with the depths of all active points
// (DSO Sec. 3.1), with several motion hypotheses.
#pragma once

#include <memory>
#include <vector>

#include "direct/image_pyramid.h"
#include "direct/light.h"
#include "direct/tracking_kernel.h"
#include "direct/view_search.h"
#include "geometry/se3.h"

namespace cairn::direct {

// A point as the reference is built from: pixel of level 0 in the reference keyframe.
struct ReferencePoint {
  float x = 0.0f;
  float y = 0.0f;
  float inverse_depth = 0.0f;
  float weight = 0.0f;  // relative information
};

// What frames are tracked against. Immutable once built, shared between threads.
struct TrackingReference {
  std::int64_t keyframe = -1;
  AffineLight light;
  double exposure_gain = 0.0;
  Thumbnail thumbnail;  // to find the view again
  struct Level {
    int count = 0;                                  // without padding
    std::vector<float> x, y, inverse_depth, color;  // padded to a multiple of 8
  };
  Level level[kMaxLevels];
  double mean_inverse_depth = 1.0;
};

// Counts the points of a level and adds padding that is in no image.
void PadLevel(TrackingReference::Level* level);

// Where an alignment starts and how far from it the true motion may be, in pixels of level 0 (standard deviation of
// rotation and, for a point at the reference's mean depth, of translation; 0: unknown). It decides only what the image
// leaves open, such as the motion along a blank wall.
struct MotionGuess {
  SE3 new_from_reference;
  double sigma_px = 0.0;
};

struct TrackingOutcome {
  bool converged = false;  // plausible on every level
  SE3 new_from_reference;
  AffineLight light;                 // of the new frame
  double rms_gray = 0.0;             // of level 0, per visible point, clamped at the cutoff
  double visible_share = 0.0;        // of the reference points on level 0
  double good_share = 0.0;           // of the reference points on level 0: visible and below the cutoff
  double flow_px = 0.0;              // root mean square motion of the points on level 0
  double translation_flow_px = 0.0;  // the same without the rotation
  double weakest_sigma_px = 0.0;     // of the motion in the direction that the image tells least about, without a prior
};

class CoarseTracker {
 public:
  CoarseTracker(const PyramidGeometry& geometry, double huber_gray, double cutoff_gray);

  // Fills `reference` (levels only) from points in the keyframe's image.
  void BuildReference(const ImagePyramid& image, const std::vector<ReferencePoint>& points,
                      TrackingReference* reference);

  // Aligns from one hypothesis. Gives up early (converged false) where a level ends above `give_up_rms[level]`, entries
  // of 0 never give up; on return `level_rms` has what each level reached. `prior` is of the new frame's light.
  TrackingOutcome Align(const TrackingReference& reference, const FrameData& data, const MotionGuess& guess,
                        const AffineLight& light, const LightPrior& prior, const double* give_up_rms,
                        double* level_rms) const;

 private:
  double WeakestSigmaPx(const float* h, double mean_inverse_depth) const;
  void Flow(const TrackingReference& reference, TrackingOutcome* outcome) const;

  PyramidGeometry geometry_;
  float huber_;
  float cutoff_;
  TrackingKernel kernel_;
  std::vector<float> depth_[kMaxLevels];
  std::vector<float> weight_[kMaxLevels];
  std::vector<float> weight_copy_;
};

}  // namespace cairn::direct
