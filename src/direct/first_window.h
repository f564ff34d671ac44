// The first window of a segment: keyframes with points whose depths are known, where before there was nothing. Either
// from a motion and corners that two-view geometry found, or from one view whose depths somebody else knows.
//
// The first keyframe is the origin of the segment's frame "direct", and the median depth there is 1. Only the thread
// that calls Odometry::OptimizeNext() uses it; it takes no lock itself.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "direct/candidate_points.h"
#include "direct/feature_start.h"
#include "direct/odometry_options.h"
#include "direct/retained_frames.h"
#include "direct/window.h"

namespace cairn::direct {

// What the first keyframe gets.
struct SegmentNumbers {
  std::int64_t segment = 0;
  std::int64_t keyframe = 0;  // further ones are counted on
};

class FirstWindow {
 public:
  using MakeFrameData = std::function<std::shared_ptr<FrameData>(const Frame&)>;

  // `window` and `candidates` are the odometry's, and outlive it. `make_data` builds pyramids.
  FirstWindow(const OdometryOptions& options, const Pinhole& camera, const PyramidGeometry& geometry, Window* window,
              CandidatePoints* candidates, MakeFrameData make_data);

  // Two or three keyframes: the start's reference, the newest frame, and one half of the way between, optimized.
  // `frames` has the start's frames since the reference. The window must be empty; it is again where this fails, which
  // says that the images do not bear the start out.
  absl::Status FromMotion(const StartResult& start, const RetainedFrames& frames, const SegmentNumbers& numbers);
  // One keyframe, which has the known points, in units of their median depth. False, and an empty window, if there are
  // fewer than kMinKnownPoints inside the image. The window must be empty.
  static constexpr std::size_t kMinKnownPoints = 40;
  bool FromKnownView(const Frame& frame, const KnownView& view, const SegmentNumbers& numbers);

 private:
  // A frame of the start in which candidates are traced.
  struct View {
    std::size_t at = 0;               // frames after the reference
    std::shared_ptr<FrameData> data;  // null: to be built again when it is needed
    AffineLight light;
  };

  std::vector<View> MakeViews(const StartResult& start, const RetainedFrames& frames,
                              const std::vector<std::size_t>& keyframes) const;
  AffineLight MatchLight(const StartResult& start, const FrameData& reference, const FrameData& view,
                         const SE3& view_from_reference) const;
  std::unique_ptr<Keyframe> TracedKeyframe(const StartResult& start, const RetainedFrames& frames,
                                           const std::vector<View>& views, std::size_t at);
  absl::Status CheckOptimized(const OptimizationReport& report) const;

  const OdometryOptions options_;
  const Pinhole camera_;  // full resolution
  const PyramidGeometry geometry_;
  Window* const window_;
  CandidatePoints* const candidates_;
  const MakeFrameData make_data_;
};

}  // namespace cairn::direct
