// What a tracker leaves to a thread of its own: matching a frame against the map, and following who changes the map.
// Jobs and answers are messages: of the jobs that wait the newest counts, the answer is taken by whoever asks next.
// With no thread a job is done where it is given.
#pragma once

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "base/status.h"
#include "client/anchor.h"
#include "client/direct_follower.h"
#include "client/map_matcher.h"
#include "client/view_source.h"

namespace cairn::client {

// Without an image: only to see whether the map has changed.
struct WatchJob {
  direct::Frame frame;
  direct::FrameResult direct;
  Odometer odometer;                    // at that frame
  std::optional<Expectation> expected;  // none: the frame is lost
  bool find_anywhere = false;           // if it is not found where it is expected
  double map_per_direct = 1.0;
  std::shared_ptr<const KeyframeDepths> depths;      // of direct.keyframe, if known
  std::shared_ptr<const tracking::MapView> view;     // that `expected` is in
  std::shared_ptr<const tracking::MapView> retired;  // not needed any more: freed here, which can take a while
};

struct WatchAnswer {
  std::shared_ptr<const tracking::MapView> view;  // the newest, which the sighting is in
  absl::Status following;                         // what keeps the map from being followed
  bool looked = false;                            // there was an image
  bool misplaced = false;                         // Sighting::misplaced, where it was expected
  bool anywhere = false;                          // it was found by relocalization
  Sighting sighting;
  direct::Frame frame;  // of the job, ...
  direct::FrameResult direct;
  Odometer odometer;
  double unit_ratio = 1.0;           // map units of `view` per unit of the job's view
  std::vector<double> depth_ratios;  // in the map over direct, of points of direct.keyframe
  absl::Status status;
};

struct MapWatchOptions {
  bool in_background = true;
  double refresh_interval_s = 0.25;  // at most so often the source is asked for a newer revision, by the wall clock
};

class MapWatch {
 public:
  static absl::StatusOr<std::unique_ptr<MapWatch>> Start(std::unique_ptr<ViewSource> source,
                                                         std::shared_ptr<const MapMatcher> matcher,
                                                         const Pinhole& pinhole, const MapWatchOptions& options);
  ~MapWatch();
  MapWatch(const MapWatch&) = delete;
  MapWatch& operator=(const MapWatch&) = delete;

  void Give(WatchJob job);
  std::optional<WatchAnswer> Take();
  // Waiting or being done, or with an answer that was not taken.
  bool Busy() const;
  // Until nothing is waiting or being done.
  void Wait();
  // Of the source of the views.
  MapConnection connection() const { return source_->connection(); }

 private:
  MapWatch(std::unique_ptr<ViewSource> source, std::shared_ptr<const MapMatcher> matcher, const Pinhole& pinhole,
           const MapWatchOptions& options)
      : options_(options), pinhole_(pinhole), source_(std::move(source)), matcher_(std::move(matcher)) {}
  void Run();
  WatchAnswer Do(const WatchJob& job);
  absl::Status Look(const WatchJob& job, WatchAnswer* answer);
  void Follow(WatchAnswer* answer);

  const MapWatchOptions options_;
  const Pinhole pinhole_;

  // Of the thread that does the jobs.
  const std::unique_ptr<ViewSource> source_;
  const std::shared_ptr<const MapMatcher> matcher_;
  std::optional<std::chrono::steady_clock::time_point> refreshed_;
  absl::Status following_;
  StreamCache cache_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable work_, done_;
  bool ending_ = false;
  bool under_way_ = false;
  bool failed_ = false;  // the thread has ended; answer_ says why
  std::optional<WatchJob> job_;
  std::optional<WatchAnswer> answer_;
  std::thread thread_;
};

// Depth in the map over depth in the direct world, of the points of a direct keyframe that lie where points of the map
// appear in it: what tracking::ScaleFromDepths takes (Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM",
// RA-L 2019, Sec. V-A and V-B). `seen` is in the frame of `keyframe_from_camera`, in map units.
std::vector<double> DepthRatios(const Pinhole& pinhole, const KeyframeDepths& depths, const SE3& keyframe_from_camera,
                                const std::vector<direct::PacketPoint>& seen);

}  // namespace cairn::client
