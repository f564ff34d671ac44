#include "client/map_watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/guarded.h"
#include "image/matching.h"
#include "store/fault.h"

namespace cairn::client {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kDepthRadiusPx = 2.0;    // as the feature module of mapping takes depths (mapping/keypoint_depth.h)
constexpr double kMaxDepthSpread = 0.15;  // points that differ by more lie on both sides of an edge

}  // namespace

std::vector<double> DepthRatios(const Pinhole& pinhole, const KeyframeDepths& depths, const SE3& keyframe_from_camera,
                                const std::vector<direct::PacketPoint>& seen) {
  std::vector<image::Keypoint> places;
  places.reserve(depths.points.size());
  for (const direct::PacketPoint& point : depths.points) places.push_back({point.x_px, point.y_px, 0.0f, 0});
  const image::FeatureGrid grid(places, pinhole.width_px, pinhole.height_px, 8);
  std::vector<double> ratios;
  std::vector<std::uint32_t> near;
  for (const direct::PacketPoint& point : seen) {
    const Vector3d in_camera = pinhole.Unproject(Vector2d(point.x_px, point.y_px)) / point.inverse_depth;
    const Vector3d in_keyframe = keyframe_from_camera * in_camera;
    if (!(in_keyframe.z() > 1e-9)) continue;
    const Vector2d pixel = pinhole.Project(in_keyframe);
    if (!pinhole.Contains(pixel)) continue;
    grid.Query(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), kDepthRadiusPx, 0, 255, &near);
    if (near.empty()) continue;
    double low = 1e300, high = 0.0, sum = 0.0;
    for (const std::uint32_t i : near) {
      const double inverse_depth = depths.points[i].inverse_depth;
      low = std::min(low, inverse_depth), high = std::max(high, inverse_depth), sum += inverse_depth;
    }
    const double mean = sum / static_cast<double>(near.size());
    if (high - low <= kMaxDepthSpread * mean) ratios.push_back(in_keyframe.z() * mean);
  }
  return ratios;
}

absl::StatusOr<std::unique_ptr<MapWatch>> MapWatch::Start(std::unique_ptr<ViewSource> source,
                                                          std::shared_ptr<const MapMatcher> matcher,
                                                          const Pinhole& pinhole, const MapWatchOptions& options) {
  std::unique_ptr<MapWatch> watch(new MapWatch(std::move(source), std::move(matcher), pinhole, options));
  if (options.in_background) {
    MapWatch* const self = watch.get();
    CAIRN_ASSIGN_OR_RETURN(watch->thread_, StartThread(
                                               "the tracker's matching", [self] { self->Run(); },
                                               [self](const absl::Status& status) {
                                                 const std::lock_guard lock(self->mutex_);
                                                 self->failed_ = true;
                                                 self->answer_.emplace();
                                                 self->answer_->status = status;
                                                 self->done_.notify_one();
                                               }));
  }
  return watch;
}

MapWatch::~MapWatch() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    work_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
}

void MapWatch::Give(WatchJob job) {
  if (!options_.in_background) {
    answer_ = Do(job);
    return;
  }
  std::optional<WatchJob> replaced;  // freed without the lock
  const std::lock_guard lock(mutex_);
  if (job_ && job_->retired) job.retired = std::move(job_->retired);
  replaced = std::exchange(job_, std::move(job));
  work_.notify_one();
}

std::optional<WatchAnswer> MapWatch::Take() {
  const std::lock_guard lock(mutex_);
  if (failed_) return answer_;  // nothing else will come
  return std::exchange(answer_, std::nullopt);
}

bool MapWatch::Busy() const {
  const std::lock_guard lock(mutex_);
  return job_.has_value() || under_way_ || answer_.has_value();
}

void MapWatch::Wait() {
  std::unique_lock lock(mutex_);
  done_.wait(lock, [&] { return (!job_ && !under_way_) || answer_.has_value(); });
}

void MapWatch::Run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_.wait(lock, [&] { return ending_ || job_.has_value(); });
    if (ending_) return;
    under_way_ = true;
    WatchAnswer answer;
    {
      const WatchJob job = *std::exchange(job_, std::nullopt);
      lock.unlock();
      answer = Do(job);
    }
    lock.lock();
    answer_ = std::move(answer);
    under_way_ = false;
    done_.notify_one();
  }
}

// A map that cannot be followed any more (removed, damaged, out of reach) is no reason to stop: what is known of it
// still answers.
void MapWatch::Follow(WatchAnswer* answer) {
  const Clock::time_point now = Clock::now();
  // What could not be read is read anew at once, and then now and then: only so it is known whether the map is damaged,
  // or no more than what is kept ready of it.
  const auto& features = source_->view()->map().feature_cache();
  const bool unreadable = features != nullptr && store::IsDamaged(features->status()) && !store::IsDamaged(following_);
  if (unreadable || !refreshed_ || now - *refreshed_ >= std::chrono::duration<double>(options_.refresh_interval_s)) {
    following_ = Guarded([&] { return source_->Refresh().status(); });
    refreshed_ = Clock::now();
  }
  answer->following = following_;
  answer->view = source_->view();
}

WatchAnswer MapWatch::Do(const WatchJob& job) {
  WatchAnswer answer;
  Follow(&answer);
  answer.frame = job.frame;
  answer.direct = job.direct;
  answer.odometer = job.odometer;
  if (!job.frame.image.empty()) answer.status = Guarded([&] { return Look(job, &answer); });
  return answer;
}

absl::Status MapWatch::Look(const WatchJob& job, WatchAnswer* answer) {
  answer->looked = true;
  const tracking::MapView& view = *answer->view;
  std::optional<Expectation> expected = job.expected;
  if (expected && job.view != answer->view) {
    const std::optional<Place> place = expected->place.In(job.view->map(), view.map(), &answer->unit_ratio);
    if (place) {
      expected->place = *place;
      expected->translation_sigma *= answer->unit_ratio;
    } else {
      expected.reset();
    }
  }
  CAIRN_ASSIGN_OR_RETURN(const ImageFeatures image, matcher_->Extract(view, job.frame.image, true));
  if (expected) answer->sighting = matcher_->Match(view, image, *expected, &cache_);
  answer->misplaced = answer->sighting.misplaced;
  const bool anywhere = job.find_anywhere || !expected || answer->misplaced;
  if (!answer->sighting.found && anywhere) {
    CAIRN_ASSIGN_OR_RETURN(answer->sighting, matcher_->Find(view, image));
    answer->anywhere = true;
  }
  if (answer->sighting.found && job.depths != nullptr && job.depths->keyframe == job.direct.keyframe) {
    answer->depth_ratios = DepthRatios(pinhole_, *job.depths,
                                       Scaled(job.direct.keyframe_from_camera, job.map_per_direct * answer->unit_ratio),
                                       answer->sighting.depths);
  }
  return absl::OkStatus();
}

}  // namespace cairn::client
