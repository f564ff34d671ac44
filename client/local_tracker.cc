#include "client/local_tracker.h"

#include <chrono>
#include <utility>

#include "base/guarded.h"
#include "client/map_reader.h"
#include "client/query_image.h"
#include "store/fault.h"

namespace cairn::client {

absl::Status LocalTrackerOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("tracker: ", what)); };
  if (!(match_interval_s >= 0.0)) return bad("match_interval_s must not be negative");
  if (!(max_match_age_s > 0.0)) return bad("max_match_age_s must be positive");
  if (!(refresh_interval_s >= 0.0)) return bad("refresh_interval_s must not be negative");
  CAIRN_RETURN_IF_ERROR(matching.Validate());
  CAIRN_RETURN_IF_ERROR(drift.Validate());
  return odometry.Validate();
}

absl::Status LocalTracker::Check(const Camera& camera, const LocalTrackerOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), "track"));
  if (options.photometric) CAIRN_RETURN_IF_ERROR(Annotate(options.photometric->ValidateFor(camera), "track"));
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<LocalTracker>> LocalTracker::Open(const std::string& path, const Camera& camera,
                                                                 const LocalTrackerOptions& options) {
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<LocalTracker>> {
    CAIRN_RETURN_IF_ERROR(Check(camera, options));  // before the map is loaded
    CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<MapReader> reader, MapReader::Open(path));
    return Open(std::unique_ptr<ViewSource>(std::move(reader)), camera, options);
  });
}

absl::StatusOr<std::unique_ptr<LocalTracker>> LocalTracker::Open(std::unique_ptr<ViewSource> source,
                                                                 const Camera& camera,
                                                                 const LocalTrackerOptions& options) {
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<LocalTracker>> {
    CAIRN_RETURN_IF_ERROR(Check(camera, options));
    CAIRN_ASSIGN_OR_RETURN(image::Undistorter undistorter, image::Undistorter::Create(camera));
    CAIRN_RETURN_IF_ERROR(direct::Odometry::Create(options.odometry, undistorter.pinhole()).status());
    auto context = std::make_unique<TrackerContext>();
    context->options = options;
    context->pinhole = undistorter.pinhole();
    context->matcher =
        std::make_shared<const MapMatcher>(options.matching, std::make_shared<const image::Undistorter>(undistorter));
    context->view = source->view();
    MapWatchOptions watch;
    watch.in_background = !options.deterministic;
    watch.refresh_interval_s = options.deterministic ? 0.0 : options.refresh_interval_s;
    CAIRN_ASSIGN_OR_RETURN(context->watch,
                           MapWatch::Start(std::move(source), context->matcher, context->pinhole, watch));
    std::unique_ptr<FrameTracker> tracker =
        options.mode == TrackMode::kFeatures ? MakeFeatureTracker(context.get()) : MakeSemiDirectTracker(context.get());
    return std::unique_ptr<LocalTracker>(
        new LocalTracker(std::move(undistorter), std::move(context), std::move(tracker)));
  });
}

absl::StatusOr<api::TrackAnswer> LocalTracker::Track(const api::TrackFrame& frame) {
  return Guarded([&] { return Follow(frame); });
}

absl::StatusOr<api::TrackAnswer> LocalTracker::Follow(const api::TrackFrame& frame) {
  const auto start = std::chrono::steady_clock::now();
  CAIRN_RETURN_IF_ERROR(CheckImage(frame.image, undistorter_.camera(), "track"));
  CAIRN_RETURN_IF_ERROR(Annotate(times_.Accept(frame.time_ns), "track"));
  direct::Frame prepared;
  prepared.index = next_index_++;
  prepared.time_ns = frame.time_ns;
  const auto& photometric = context_->options.photometric;
  CAIRN_ASSIGN_OR_RETURN(image::PreparedImage images,
                         image::PrepareImage(frame.image, undistorter_, photometric ? &*photometric : nullptr));
  prepared.image = std::move(images.gray);
  prepared.corrected = std::move(images.corrected);
  if (photometric) prepared.exposure_gain = photometric->ExposureGain(frame.exposure_s);
  if (undistorter_.identity()) prepared.image = prepared.image.clone();  // kept for longer than the caller keeps his
  context_->out_of_time = frame.out_of_time;
  const absl::StatusOr<TrackStep> step = tracker_->Track(prepared);
  context_->out_of_time = {};
  CAIRN_RETURN_IF_ERROR(step.status());
  api::TrackAnswer answer;
  answer.time_ns = frame.time_ns;
  Fill(*step, &answer);
  answer.track_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return answer;
}

void LocalTracker::Fill(const TrackStep& step, api::TrackAnswer* answer) const {
  const map::Snapshot& map = context_->view->map();
  answer->state = step.state;
  answer->reason = step.reason;
  answer->map_id = map.info().id;
  answer->revision = map.revision();
  const MapConnection connection = context_->watch->connection();
  answer->connected = connection.connected;
  answer->map_age_s = connection.age_s;
  answer->focal_factor = context_->calibration.focal_factor();
  if (!tracker_->following().ok()) {
    answer->note = std::string(tracker_->following().message());
    answer->map_damaged = store::IsDamaged(tracker_->following());
  }
  if (const Anchor* anchor = tracker_->anchor(); anchor != nullptr) {
    answer->matched_ns = anchor->time_ns;
    answer->inliers = anchor->inliers;
  }
  if (step.state == api::TrackState::kLost) return;
  answer->component = step.component;
  answer->map_from_camera = answer->world_from_camera = step.map_from_camera;
  answer->covariance = step.covariance;
  const auto& world_from_map = map.WorldFrom(step.component);
  answer->world_is_metric = world_from_map.has_value();
  if (!world_from_map) return;
  answer->world_per_map = world_from_map->scale();
  answer->world_from_camera = world_from_map->TransformPose(step.map_from_camera);
}

}  // namespace cairn::client
