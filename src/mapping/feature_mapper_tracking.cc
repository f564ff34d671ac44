// How a packet finds its pose in the map, and what happens when it does not.
#include <algorithm>
#include <cmath>

#include "base/median.h"
#include "map/lens.h"
#include "mapping/feature_mapper_impl.h"
#include "mapping/stopwatch.h"
#include "tracking/graph_distance.h"

namespace cairn::mapping {
namespace {

// So many packets the relative scale from depths is trusted before the alignment of centres takes over.
constexpr int kTrustDepths = 10;
// A search after a loss is this much wider than usual.
constexpr double kWideSearch = 3.0;

}  // namespace

double MedianDirectDepth(std::span<const direct::PacketPoint> points) {
  std::vector<double> depths;
  for (const direct::PacketPoint& point : points) {
    if (point.inverse_depth > 0.0f && std::isfinite(point.inverse_depth)) depths.push_back(1.0 / point.inverse_depth);
  }
  return depths.empty() ? 1.0 : Median(depths);
}

tracking::PoseSeed FeatureMapper::Impl::SeedPose(const direct::KeyframePacket& packet) const {
  const SE3 last_from_map = last_.reference_from_camera.Inverse() * map_->keyframe(last_.reference).camera_from_map;
  if (packet.segment != last_.segment) return tracking::PoseSeed{last_from_map};
  const SE3 camera_from_last = packet.direct_from_camera.Inverse() * last_.direct_from_camera;
  // Without a scale only the turn is known.
  if (!scale_.known()) return tracking::PoseSeed{SE3(camera_from_last.rotation(), Vector3d::Zero()) * last_from_map};
  const SE3 motion = Scaled(camera_from_last, scale_.scale());
  tracking::PoseSeed seed{motion * last_from_map};
  // Once the relative scale is known: how good direct odometry is from one keyframe to the next.
  if (scale_.relative_sigma() > 0.0) {
    seed.translation_sigma =
        options_.odometry_sigma_share * motion.translation().norm() + options_.odometry_sigma_depth * median_depth_;
    seed.rotation_sigma_rad =
        options_.odometry_sigma_share * AngleRad(motion.rotation()) + options_.odometry_sigma_depth;
  }
  return seed;
}

std::vector<PointId> FeatureMapper::Impl::SeenLately() const {
  std::vector<PointId> seen;
  for (const PointId point : last_.points) {
    if (point && map_->points().Contains(point)) seen.push_back(point);
  }
  return seen;
}

bool FeatureMapper::Impl::Track(const tracking::PoseSeed& seed, Current* current) {
  CpuStopwatch watch;
  const tracking::FeatureView view{pinhole_, current->features->features, current->grid};
  const std::vector<PointId> seen = SeenLately();
  tracking::LocalMapStart start{.seed = seed, .seen = seen, .anchor = last_.reference, .median_depth = median_depth_};
  current->tracked = TrackLocalMap(*map_, view, start, options_.tracker);
  if (!current->tracked.tracked) {
    start.radius_factor = kWideSearch;
    current->tracked = TrackLocalMap(*map_, view, start, options_.tracker);
  }
  current->report.matches = current->tracked.matches;
  current->report.inliers = current->tracked.inliers;
  current->report.times.track_ms += watch.LapMs();
  return current->tracked.tracked;
}

// Anywhere in the map; what it finds is refined like any other keyframe, from the pose found.
absl::StatusOr<bool> FeatureMapper::Impl::Relocate(Current* current) {
  if (view_->places() == nullptr || !component_) return false;
  CpuStopwatch watch;
  CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                         relocalizer_.Relocalize(*map_, *view_->places(), pinhole_, current->features->features,
                                                 tracking::SearchArea::Only(component_)));
  bool tracked = false;
  if (found.beyond_doubt && MayGoOnAt(found.place.reference_keyframe, current->packet)) {
    std::vector<PointId> seen;
    for (const auto& inlier : found.place.inliers) seen.push_back(inlier.point);
    const tracking::FeatureView view{pinhole_, current->features->features, current->grid};
    current->tracked = TrackLocalMap(*map_, view,
                                     {.seed = {found.place.camera_from_map},
                                      .seen = seen,
                                      .anchor = found.place.reference_keyframe,
                                      .median_depth = median_depth_},
                                     options_.tracker);
    tracked = current->tracked.tracked;
    current->report.matches = current->tracked.matches;
    current->report.inliers = current->tracked.inliers;
  }
  current->report.times.relocate_ms += watch.LapMs();
  return tracked;
}

absl::StatusOr<std::optional<FeatureMapper::Found>> FeatureMapper::Impl::Locate(const direct::Frame& frame) const {
  if (view_->places() == nullptr || map_->keyframes().empty()) return std::nullopt;
  CAIRN_ASSIGN_OR_RETURN(image::Features features, extractor_.Extract(frame.image, options_.max_features));
  const std::vector<image::Keypoint> seen_by_the_odometry = features.keypoints;
  map::CorrectKeypoints(map_->cameras().at(camera_), features.keypoints);
  CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                         relocalizer_.Relocalize(*map_, *view_->places(), pinhole_, features));
  if (!found.beyond_doubt) return std::nullopt;  // what looks alike may be another place
  // Many more points are seen than those that told the place.
  const image::FeatureGrid grid(features.keypoints, pinhole_.width_px, pinhole_.height_px);
  std::vector<PointId> seen;
  std::vector<double> depths;
  for (const auto& inlier : found.place.inliers) {
    seen.push_back(inlier.point);
    depths.push_back((found.place.camera_from_map * map_->point(inlier.point).position).z());
  }
  const tracking::TrackedView tracked = TrackLocalMap(*map_, {pinhole_, features, grid},
                                                      {.seed = {found.place.camera_from_map},
                                                       .seen = seen,
                                                       .anchor = found.place.reference_keyframe,
                                                       .median_depth = Median(depths)},
                                                      options_.tracker);
  if (!tracked.tracked) return std::nullopt;
  Found result;
  result.component = map_->keyframe(found.place.reference_keyframe).component;
  direct::KnownView& view = result.view;
  view.frame_index = frame.index;
  for (std::size_t i = 0; i < tracked.points.size(); ++i) {
    if (!tracked.points[i]) continue;
    const double depth = (tracked.camera_from_map * map_->point(tracked.points[i]).position).z();
    if (depth <= 0.0) continue;
    const image::Keypoint& keypoint = seen_by_the_odometry[i];
    view.points.push_back({keypoint.x_px, keypoint.y_px, static_cast<float>(1.0 / depth), 0.0f});
  }
  return result;
}

// As long as odometry goes on, a place that is far away along the graph is one to which the camera has come back, or
// one that only looks like it: loop closing decides, once the map goes on from a new start. A new segment knows
// nothing.
bool FeatureMapper::Impl::MayGoOnAt(KeyframeId place, const direct::KeyframePacket& packet) const {
  if (!last_.known || packet.segment != last_.segment) return true;
  return tracking::KeyframesWithin(*map_, last_.reference, options_.tracker.neighbour_way * median_depth_)
      .contains(place);
}

std::optional<tracking::ScaleMeasurement> FeatureMapper::Impl::MeasureCentres(const Current& current) const {
  std::vector<Vector3d> map_centres, direct_centres;
  const auto& entries = trajectory_.entries();
  const std::size_t window = 30;
  for (std::size_t i = entries.size() > window ? entries.size() - window : 0; i < entries.size(); ++i) {
    if (!entries[i].reference || entries[i].segment != current.packet.segment) continue;
    const SE3 map_from_camera =
        map_->keyframe(entries[i].reference).camera_from_map.Inverse() * entries[i].reference_from_camera;
    map_centres.push_back(map_from_camera.translation());
    direct_centres.push_back(entries[i].direct_from_camera.translation());
  }
  map_centres.push_back(current.tracked.camera_from_map.Inverse().translation());
  direct_centres.push_back(current.packet.direct_from_camera.translation());
  return tracking::ScaleFromCentres(map_centres, direct_centres);
}

// Depth in the map over depth in the direct world, of the features that have both.
std::vector<double> FeatureMapper::Impl::DepthRatios(const Current& current, std::size_t min_observations) const {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < current.depths.size(); ++i) {
    const PointId id = current.tracked.points[i];
    if (!id || !current.depths[i].known()) continue;
    const map::MapPoint& point = map_->point(id);
    if (point.observations.size() < min_observations) continue;
    ratios.push_back((current.tracked.camera_from_map * point.position).z() * current.depths[i].inverse_depth);
  }
  return ratios;
}

// The scale measured at this keyframe itself, or the running one.
double FeatureMapper::Impl::UpdateScale(const Current& current) {
  // A point of few observations may still have its depth from the direct module itself, of this segment's world or not.
  const auto from_depths = tracking::ScaleFromDepths(DepthRatios(current, 3));
  since_depths_ = from_depths ? 0 : since_depths_ + 1;
  // The alignment lags behind: only where depths have been missing for long.
  const bool align = since_depths_ > kTrustDepths || scale_.relative_sigma() == 0.0;
  scale_.Update(from_depths, align ? MeasureCentres(current) : std::nullopt);
  if (!scale_.known()) return 0.0;
  return from_depths ? from_depths->scale : scale_.scale();
}

absl::Status FeatureMapper::Impl::Accept(Current* current) {
  const tracking::TrackedView& tracked = current->tracked;
  // Another world on the direct side: how large it is here has to be measured.
  if (last_.known && last_.segment != current->packet.segment) scale_.Forget();
  state_ = tracked.inliers >= options_.poor_inliers ? FeatureState::kGood : FeatureState::kPoor;
  attempts_ = 0;
  if (tracked.median_depth > 0.0) median_depth_ = tracked.median_depth;
  const double map_per_direct = UpdateScale(*current);
  mapper_.CountVisible(tracked.visible, tracked.points);
  last_.points = tracked.points;
  // Without a scale the depths of the direct module mean nothing here, and a keyframe would be placed by them.
  if (map_per_direct > 0.0 && ShouldInsert(*current)) {
    const bool thin = tracked.inliers < options_.poor_inliers;
    inserted_inliers_ = tracked.inliers;
    CAIRN_RETURN_IF_ERROR(Insert(tracked.camera_from_map, map_per_direct, thin, tracked.reference, current));
  } else {
    ++since_insertion_;
    Remember(tracked.camera_from_map, tracked.reference, current);
  }
  Record(*current, true, map_per_direct);
  return absl::OkStatus();
}

absl::Status FeatureMapper::Impl::Lose(const SE3& guess, Current* current) {
  state_ = last_.known ? FeatureState::kLost : FeatureState::kInitializing;
  ++attempts_;
  current->report.message = absl::StrCat("the map is not found (", current->tracked.inliers, " inliers)");
  if (!last_.known) {
    current->report.message = "no view of this session has been located in the map yet";
    Record(*current, false, 0.0);
    return absl::OkStatus();
  }
  if (attempts_ >= options_.max_attempts && current->num_depths >= options_.min_restart_points) {
    current->report.restarted = true;
    if (current->packet.segment == last_.segment && scale_.known()) {
      return Start(guess, scale_.scale(), last_.reference, current);
    }
    // Nothing links the two worlds: a component of its own, about as large as the scene was last.
    component_ = ComponentId();
    const double scale = median_depth_ / MedianDirectDepth(current->packet.points);
    scale_.Reset(scale);
    return Start(SE3(), scale, KeyframeId(), current);
  }
  const KeyframeId reference = last_.reference;
  if (current->packet.segment == last_.segment) {
    Remember(guess, reference, current);
  }
  Record(*current, false, 0.0);
  return absl::OkStatus();
}

absl::Status FeatureMapper::Impl::Start(const SE3& camera_from_map, double map_per_direct, KeyframeId parent,
                                        Current* current) {
  state_ = FeatureState::kInitializing;
  attempts_ = 0;
  median_depth_ = map_per_direct * MedianDirectDepth(current->packet.points);
  inserted_inliers_ = current->num_depths;
  if (mapper_.keyframes_inserted() == 0) scale_.Reset(map_per_direct);
  current->tracked = {};
  CAIRN_RETURN_IF_ERROR(Insert(camera_from_map, map_per_direct, true, parent, current));
  last_.points = map_->keyframe(current->report.keyframe).points;
  Record(*current, true, map_per_direct);
  return absl::OkStatus();
}

}  // namespace cairn::mapping
