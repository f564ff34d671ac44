#include "client/remote/region_tracker.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/guarded.h"
#include "client/query_image.h"

namespace cairn::client {
namespace {

constexpr double kAskEveryS = 1.0;     // of the images' time
constexpr double kLostForS = 0.5;      // before the server is asked: the tracker looks for itself first
constexpr double kReachedShare = 0.5;  // of the way to the edge of the region

}  // namespace

absl::StatusOr<std::unique_ptr<api::Tracker>> RegionTracker::Create(Server server, const Camera& camera,
                                                                    const LocalTrackerOptions& options,
                                                                    int max_keyframes) {
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), "track"));
  CAIRN_RETURN_IF_ERROR(options.Validate());
  return std::unique_ptr<api::Tracker>(new RegionTracker(std::move(server), camera, options, max_keyframes));
}

absl::StatusOr<bool> RegionTracker::Ask(const api::TrackFrame& frame, std::string* reason) {
  *reason = miss_;
  if (asked_ns_ && ToSeconds(frame.time_ns - *asked_ns_) < kAskEveryS) return false;
  asked_ns_ = frame.time_ns;
  CAIRN_ASSIGN_OR_RETURN(const api::LocalizeAnswer found, server_.localize({frame.image, camera_, frame.time_ns}));
  if (!found.localized) {
    *reason = miss_ = found.reason;
    return false;
  }
  region_ = {{found.reference_keyframe}, found.component, found.map_from_camera.translation(), max_keyframes_};
  return true;
}

absl::StatusOr<api::TrackAnswer> RegionTracker::Begin(const api::TrackFrame& frame) {
  CAIRN_RETURN_IF_ERROR(CheckImage(frame.image, camera_, "track"));
  CAIRN_RETURN_IF_ERROR(Annotate(times_.Accept(frame.time_ns), "track"));
  api::TrackAnswer answer;
  answer.time_ns = frame.time_ns;
  CAIRN_ASSIGN_OR_RETURN(const bool found, Ask(frame, &answer.reason));
  if (!found) return answer;
  CAIRN_ASSIGN_OR_RETURN(copy_, server_.follow(region_));
  CAIRN_ASSIGN_OR_RETURN(tracker_, LocalTracker::Open(copy_->NewReader(), camera_, options_));
  return tracker_->Track(frame);
}

void RegionTracker::Measure() {
  std::shared_ptr<const tracking::MapView> newest = copy_->view();
  if (newest == seen_) return;
  seen_ = std::move(newest);
  moving_ = false;
  component_ = seen_->map().Resolve(region_.component);
  const map::Keyframe* around =
      region_.around.empty() ? nullptr : seen_->map().keyframes().Find(region_.around.front());
  middle_ = around != nullptr ? around->CenterInMap() : region_.center;
  std::vector<double> distances;
  seen_->map().keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component == component_) distances.push_back((keyframe->CenterInMap() - middle_).norm());
  });
  reach_ = 0.0;
  if (distances.empty()) return;
  const auto at = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() * 4 / 5);
  std::nth_element(distances.begin(), at, distances.end());
  reach_ = *at;
}

void RegionTracker::MoveAlong(const api::TrackAnswer& answer) {
  Measure();
  const Vector3d& center = answer.map_from_camera.translation();
  if (moving_ || (answer.component == component_ && (center - middle_).norm() <= kReachedShare * reach_)) return;
  region_ = {{}, answer.component, center, max_keyframes_};
  copy_->MoveTo(region_);
  moving_ = true;
}

absl::StatusOr<api::TrackAnswer> RegionTracker::Track(const api::TrackFrame& frame) {
  return Guarded([&]() -> absl::StatusOr<api::TrackAnswer> {
    if (tracker_ == nullptr) return Begin(frame);
    CAIRN_ASSIGN_OR_RETURN(api::TrackAnswer answer, tracker_->Track(frame));
    if (answer.state != api::TrackState::kLost) {
      MoveAlong(answer);
      return answer;
    }
    const bool long_lost = ToSeconds(frame.time_ns - answer.matched_ns) > kLostForS;
    if (!long_lost || !answer.connected) return answer;
    std::string reason;
    const absl::StatusOr<bool> found = Ask(frame, &reason);
    if (found.ok() && *found) {
      copy_->MoveTo(region_);
      moving_ = true;
    } else if (!found.ok()) {
      answer.note = std::string(found.status().message());
    }
    return answer;
  });
}

}  // namespace cairn::client
