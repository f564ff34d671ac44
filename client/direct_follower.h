// The direct odometry of a tracker: begins at once from depths that a map gives, follows every frame, and says how the
// camera has moved between any two of them. It owns the thread that makes keyframes and optimizes the window, if there
// is one.
//
// Lengths are in direct units, of which one is as long as DirectUnit() says when it begins, and which drifts slowly.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "base/status.h"
#include "direct/odometry.h"

namespace cairn::client {

// Points of a direct keyframe, in it.
struct KeyframeDepths {
  std::int64_t keyframe = -1;
  std::vector<direct::PacketPoint> points;
};

class DirectFollower {
 public:
  // Begins at `frame`, whose `view` is known; `begun` gets its pose. In one thread, or with a second one that
  // optimizes. Errors as direct::Odometry::BeginFrom.
  static absl::StatusOr<std::unique_ptr<DirectFollower>> Begin(const direct::OdometryOptions& options,
                                                               const Pinhole& pinhole, const direct::Frame& frame,
                                                               const direct::KnownView& view, bool in_background,
                                                               direct::FrameResult* begun);
  ~DirectFollower();
  DirectFollower(const DirectFollower&) = delete;
  DirectFollower& operator=(const DirectFollower&) = delete;

  // The length of the direct unit at its beginning, in the unit of the view's depths: their median.
  double DirectUnit() const { return direct_unit_; }

  // keyframe is -1 while it is lost; it may find itself again, by the images it has seen. With a second thread it waits
  // for that while too much is left to do, as when the view runs out of points.
  absl::StatusOr<direct::FrameResult> Track(const direct::Frame& frame);
  // It has given up: only a known view would help.
  bool ended() const { return ended_; }

  // a_from_b of two frames that it has tracked, by all that is known now. Nothing if one was forgotten.
  std::optional<SE3> Motion(const direct::FrameResult& a, const direct::FrameResult& b) const;

  // Of the newest keyframe that frames are tracked against; may be null.
  std::shared_ptr<const KeyframeDepths> Depths() const;

 private:
  explicit DirectFollower(std::unique_ptr<direct::Odometry> odometry) : odometry_(std::move(odometry)) {}
  void Run();
  void AfterOptimization();

  const std::unique_ptr<direct::Odometry> odometry_;
  double direct_unit_ = 1.0;
  bool ended_ = false;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable work_, room_;
  bool ending_ = false;
  absl::Status status_;
  std::int64_t tracked_against_ = -1;  // keyframe of the newest frame
  std::shared_ptr<const KeyframeDepths> depths_;
  std::thread thread_;
};

}  // namespace cairn::client
