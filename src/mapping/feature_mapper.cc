#include "mapping/feature_mapper.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "image/orb_extractor.h"
#include "mapping/keyframe_tracker.h"
#include "mapping/keypoint_depth.h"
#include "mapping/local_mapper.h"
#include "mapping/relative_scale.h"
#include "mapping/stopwatch.h"
#include "mapping/view_record.h"
#include "tracking/place_database.h"
#include "tracking/relocalizer.h"

namespace cairn::mapping {
namespace {

// The first keyframes are all inserted: the map needs them more than it needs to be small.
constexpr int kAlwaysInserted = 4;
// So many packets the relative scale from depths is trusted before the alignment of centres takes over.
constexpr int kTrustDepths = 10;
// A search after a loss is this much wider than usual.
constexpr double kWideSearch = 3.0;

SE3 Scaled(const SE3& motion, double scale) { return {motion.rotation(), scale * motion.translation()}; }

double MedianDirectDepth(std::span<const direct::PacketPoint> points) {
  std::vector<double> depths;
  for (const direct::PacketPoint& point : points) {
    if (point.inverse_depth > 0.0f && std::isfinite(point.inverse_depth)) depths.push_back(1.0 / point.inverse_depth);
  }
  if (depths.empty()) return 1.0;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

}  // namespace

class FeatureMapper::Impl {
 public:
  Impl(const FeatureMapperOptions& options, std::shared_ptr<const map::Snapshot> map, SessionId session,
       CameraId camera, const place::Vocabulary* vocabulary, Commit commit)
      : options_(options),
        map_(std::move(map)),
        session_(session),
        camera_(camera),
        pinhole_(map_->pinhole(camera)),
        vocabulary_(vocabulary),
        commit_(std::move(commit)),
        extractor_(map_->info().orb),
        mapper_(options, [this](const map::Edit& edit, const map::Keyframe& culled, const map::Keyframe& heir) {
          OnCull(edit, culled, heir);
        }) {}

  absl::Status BuildPlaces() {
    if (vocabulary_ == nullptr) return absl::OkStatus();
    // Not owned: the vocabulary outlives the mapper.
    const std::shared_ptr<const place::Vocabulary> shared(std::shared_ptr<void>(), vocabulary_);
    CAIRN_ASSIGN_OR_RETURN(auto places, tracking::PlaceDatabase::Build(shared, *map_));
    places_.emplace(std::move(places));
    return absl::OkStatus();
  }

  absl::StatusOr<KeyframeReport> Process(const direct::KeyframePacket& packet);
  absl::Status Finish();

  absl::Status CommitCorrection(map::Delta delta, const std::unordered_map<KeyframeId, double>& scales);

  const std::shared_ptr<const map::Snapshot>& map() const { return map_; }
  const tracking::PlaceDatabase* places() const { return places_ ? &*places_ : nullptr; }
  FeatureState state() const { return state_; }
  const KeyframeTrajectory& trajectory() const { return trajectory_; }

 private:
  // One packet on its way through.
  struct Current {
    const direct::KeyframePacket& packet;
    std::shared_ptr<map::KeyframeFeatures> features;
    image::FeatureGrid grid;
    std::vector<KeypointDepth> depths;
    int num_depths = 0;
    TrackedKeyframe tracked;
    KeyframeReport report;
  };
  // Where the camera was last, rigidly attached to a keyframe of the map.
  struct Last {
    bool known = false;
    std::int64_t segment = 0;
    SE3 direct_from_camera;
    KeyframeId reference;
    SE3 reference_from_camera;
    std::vector<PointId> points;  // observed there
  };

  absl::Status Check(const direct::KeyframePacket& packet) const;
  absl::Status Extract(Current* current);
  absl::Status Continue(Current* current);
  bool Track(const PoseSeed& seed, Current* current);
  absl::StatusOr<bool> Relocate(Current* current);
  absl::Status Accept(Current* current);
  absl::Status Lose(const SE3& guess, Current* current);
  absl::Status Start(const SE3& camera_from_map, double map_per_direct, KeyframeId parent, Current* current);
  bool ShouldInsert(const Current& current) const;
  int MaxBetween(double rate_hz) const;
  absl::Status Insert(const SE3& camera_from_map, double map_per_direct, bool points_from_depths, KeyframeId parent,
                      Current* current);
  absl::Status CommitEdit(map::Edit edit, std::string reason);
  absl::Status CommitDelta(map::Delta delta);
  double UpdateScale(const Current& current);
  std::vector<double> DepthRatios(const Current& current, std::size_t min_observations) const;
  std::optional<ScaleMeasurement> MeasureCentres(const Current& current) const;
  void Remember(const SE3& camera_from_map, KeyframeId reference, Current* current);
  void Record(const Current& current, bool refined, double map_per_direct);
  void OnCull(const map::Edit& edit, const map::Keyframe& culled, const map::Keyframe& heir);
  PoseSeed SeedPose(const direct::KeyframePacket& packet) const;
  std::vector<PointId> SeenLately() const;
  int NumFeatures(double rate_hz) const;

  const FeatureMapperOptions options_;
  std::shared_ptr<const map::Snapshot> map_;
  const SessionId session_;
  const CameraId camera_;
  const Pinhole pinhole_;
  const place::Vocabulary* const vocabulary_;
  const Commit commit_;
  const image::OrbExtractor extractor_;
  const tracking::Relocalizer relocalizer_;
  std::optional<tracking::PlaceDatabase> places_;
  LocalMapper mapper_;
  RelativeScale scale_;
  KeyframeTrajectory trajectory_;
  std::vector<ViewRecord> views_;  // per trajectory entry; empty for keyframes in the map

  FeatureState state_ = FeatureState::kInitializing;
  Last last_;
  double median_depth_ = 1.0;  // of the scene, map units
  int since_insertion_ = 0;    // packets
  int inserted_inliers_ = 0;   // of the last keyframe inserted
  int since_depths_ = 0;       // packets since depths gave the relative scale
  int attempts_ = 0;           // packets since the loss
  std::int64_t last_packet_ = -1;
};

absl::Status FeatureMapper::Impl::Check(const direct::KeyframePacket& packet) const {
  if (packet.keyframe <= last_packet_) {
    return absl::InvalidArgumentError(absl::StrCat("direct keyframe ", packet.keyframe, " comes after ", last_packet_,
                                                   "; packets must be in temporal order"));
  }
  const cv::Mat& image = packet.frame.image;
  if (image.type() != CV_8UC1 || image.cols != pinhole_.width_px || image.rows != pinhole_.height_px) {
    return absl::InvalidArgumentError(absl::StrCat("direct keyframe ", packet.keyframe, " has an image of ", image.cols,
                                                   "x", image.rows, ", the camera needs 8-bit grey of ",
                                                   pinhole_.width_px, "x", pinhole_.height_px));
  }
  if (!packet.direct_from_camera.Matrix().allFinite()) {
    return absl::InvalidArgumentError(absl::StrCat("direct keyframe ", packet.keyframe, " has no finite pose"));
  }
  return absl::OkStatus();
}

int FeatureMapper::Impl::NumFeatures(double rate_hz) const {
  const double share =
      std::clamp((rate_hz - options_.slow_rate_hz) / (options_.fast_rate_hz - options_.slow_rate_hz), 0.0, 1.0);
  return static_cast<int>(std::lround(options_.max_features + share * (options_.min_features - options_.max_features)));
}

absl::Status FeatureMapper::Impl::Extract(Current* current) {
  const direct::KeyframePacket& packet = current->packet;
  current->features = std::make_shared<map::KeyframeFeatures>();
  CAIRN_ASSIGN_OR_RETURN(current->features->features,
                         extractor_.Extract(packet.frame.image, NumFeatures(packet.keyframe_rate_hz)));
  const auto& keypoints = current->features->features.keypoints;
  current->grid = image::FeatureGrid(keypoints, pinhole_.width_px, pinhole_.height_px);
  current->depths = KeypointDepths(keypoints, packet.points);
  for (const KeypointDepth& depth : current->depths) current->num_depths += depth.known() ? 1 : 0;
  return absl::OkStatus();
}

absl::StatusOr<KeyframeReport> FeatureMapper::Impl::Process(const direct::KeyframePacket& packet) {
  CAIRN_RETURN_IF_ERROR(Check(packet));
  Stopwatch total, watch;
  Current current{packet, nullptr, {}, {}, 0, {}, {}};
  CAIRN_RETURN_IF_ERROR(Extract(&current));
  KeyframeReport& report = current.report;
  report.times.extract_ms = watch.LapMs();
  report.direct_keyframe = packet.keyframe;
  report.time_ns = packet.frame.time_ns;
  report.features = static_cast<int>(current.features->features.size());
  report.depths = current.num_depths;
  last_packet_ = packet.keyframe;

  CAIRN_RETURN_IF_ERROR(Continue(&current));
  report.state = state_;
  report.times.total_ms = total.LapMs();
  return report;
}

absl::Status FeatureMapper::Impl::Continue(Current* current) {
  const direct::KeyframePacket& packet = current->packet;
  if (map_->keyframes().empty()) {
    if (current->num_depths < options_.min_start_points) {
      current->report.message = absl::StrCat("a start needs ", options_.min_start_points,
                                             " features with depth, there are ", current->num_depths);
      Record(*current, false, 0.0);
      return absl::OkStatus();
    }
    return Start(SE3(), 1.0, KeyframeId(), current);
  }
  const PoseSeed seed = last_.known ? SeedPose(packet) : PoseSeed();
  if (last_.known && Track(seed, current)) return Accept(current);
  CAIRN_ASSIGN_OR_RETURN(const bool relocated, Relocate(current));
  if (relocated) {
    current->report.relocated = true;
    return Accept(current);
  }
  return Lose(seed.camera_from_map, current);
}

PoseSeed FeatureMapper::Impl::SeedPose(const direct::KeyframePacket& packet) const {
  const SE3 last_from_map = last_.reference_from_camera.Inverse() * map_->keyframe(last_.reference).camera_from_map;
  if (packet.segment != last_.segment) return PoseSeed{last_from_map};
  const SE3 camera_from_last = packet.direct_from_camera.Inverse() * last_.direct_from_camera;
  const SE3 motion = Scaled(camera_from_last, scale_.scale());
  PoseSeed seed{motion * last_from_map};
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

bool FeatureMapper::Impl::Track(const PoseSeed& seed, Current* current) {
  Stopwatch watch;
  const tracking::FeatureView view{pinhole_, current->features->features, current->grid};
  const std::vector<PointId> seen = SeenLately();
  current->tracked = TrackKeyframe(*map_, view, seed, seen, last_.reference, median_depth_, 1.0, options_);
  if (!current->tracked.tracked) {
    current->tracked = TrackKeyframe(*map_, view, seed, seen, last_.reference, median_depth_, kWideSearch, options_);
  }
  current->report.matches = current->tracked.matches;
  current->report.inliers = current->tracked.inliers;
  current->report.times.track_ms += watch.LapMs();
  return current->tracked.tracked;
}

// Anywhere in the map; what it finds is refined like any other keyframe, from the pose found.
absl::StatusOr<bool> FeatureMapper::Impl::Relocate(Current* current) {
  if (!places_) return false;
  Stopwatch watch;
  CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                         relocalizer_.Relocalize(*map_, *places_, pinhole_, current->features->features));
  bool tracked = false;
  if (found.localized) {
    std::vector<PointId> seen;
    for (const auto& inlier : found.inliers) seen.push_back(inlier.point);
    const tracking::FeatureView view{pinhole_, current->features->features, current->grid};
    current->tracked = TrackKeyframe(*map_, view, {found.camera_from_map}, seen, found.reference_keyframe,
                                     median_depth_, 1.0, options_);
    tracked = current->tracked.tracked;
    current->report.matches = current->tracked.matches;
    current->report.inliers = current->tracked.inliers;
  }
  current->report.times.relocate_ms += watch.LapMs();
  return tracked;
}

std::optional<ScaleMeasurement> FeatureMapper::Impl::MeasureCentres(const Current& current) const {
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
  return ScaleFromCentres(map_centres, direct_centres);
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
  // A point of few observations may still have its depth from the direct module itself.
  const auto from_depths = ScaleFromDepths(DepthRatios(current, 3));
  since_depths_ = from_depths ? 0 : since_depths_ + 1;
  // The alignment lags behind: only where depths have been missing for long.
  const bool align = since_depths_ > kTrustDepths || scale_.relative_sigma() == 0.0;
  scale_.Update(from_depths, align ? MeasureCentres(current) : std::nullopt);
  return from_depths ? from_depths->scale : scale_.scale();
}

void FeatureMapper::Impl::Remember(const SE3& camera_from_map, KeyframeId reference, Current* current) {
  last_.known = true;
  last_.segment = current->packet.segment;
  last_.direct_from_camera = current->packet.direct_from_camera;
  last_.reference = reference;
  last_.reference_from_camera = map_->keyframe(reference).camera_from_map * camera_from_map.Inverse();
  current->report.located = true;
  current->report.map_from_camera = camera_from_map.Inverse();
  current->report.map_per_direct = scale_.scale();
}

void FeatureMapper::Impl::Record(const Current& current, bool refined, double map_per_direct) {
  KeyframeTrajectory::Entry entry;
  entry.direct_keyframe = current.packet.keyframe;
  entry.segment = current.packet.segment;
  entry.frame_index = current.packet.frame.index;
  entry.time_ns = current.packet.frame.time_ns;
  entry.state = state_;
  entry.direct_from_camera = current.packet.direct_from_camera;
  entry.map_per_direct = map_per_direct;
  if (refined) {
    entry.keyframe = current.report.keyframe;
    entry.reference = last_.reference;
    entry.reference_from_camera = last_.reference_from_camera;
  }
  trajectory_.Add(entry);
  views_.emplace_back();
  if (refined && !entry.keyframe) {
    views_.back() = MakeViewRecord(current.features->features.keypoints, current.tracked.points, map_->info().orb);
  }
}

// Packets that need not be inserted in a row: fewer when they are rare.
int FeatureMapper::Impl::MaxBetween(double rate_hz) const {
  const int by_time = static_cast<int>(rate_hz * options_.max_seconds_between);
  return std::min(options_.max_keyframes_between, by_time);
}

bool FeatureMapper::Impl::ShouldInsert(const Current& current) const {
  const int inliers = current.tracked.inliers;
  return mapper_.keyframes_inserted() < kAlwaysInserted || inliers < options_.insert_below_matches ||
         since_insertion_ >= MaxBetween(current.packet.keyframe_rate_hz) ||
         inliers < options_.insert_below_share * inserted_inliers_;
}

absl::Status FeatureMapper::Impl::Accept(Current* current) {
  const TrackedKeyframe& tracked = current->tracked;
  if (last_.known && last_.segment != current->packet.segment) scale_.Reset(scale_.scale());
  state_ = tracked.inliers >= options_.poor_inliers ? FeatureState::kGood : FeatureState::kPoor;
  attempts_ = 0;
  if (tracked.median_depth > 0.0) median_depth_ = tracked.median_depth;
  const double map_per_direct = UpdateScale(*current);
  mapper_.CountVisible(tracked.visible, tracked.points);
  last_.points = tracked.points;
  if (ShouldInsert(*current)) {
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
    double scale = scale_.scale();
    if (current->packet.segment != last_.segment) {
      // Nothing links the two worlds: as large as the scene was last.
      scale = median_depth_ / MedianDirectDepth(current->packet.points);
      scale_.Reset(scale);
    }
    current->report.restarted = true;
    return Start(guess, scale, last_.reference, current);
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

absl::Status FeatureMapper::Impl::Insert(const SE3& camera_from_map, double map_per_direct, bool points_from_depths,
                                         KeyframeId parent, Current* current) {
  Stopwatch watch;
  if (vocabulary_ != nullptr) {
    for (const image::Descriptor& descriptor : current->features->features.descriptors) {
      current->features->words.push_back(vocabulary_->Lookup(descriptor));
    }
  }
  InsertionRequest request;
  request.keyframe.session = session_;
  request.keyframe.camera = camera_;
  request.keyframe.time_ns = current->packet.frame.time_ns;
  request.keyframe.frame_index = current->packet.frame.index;
  request.keyframe.camera_from_map = camera_from_map;
  request.keyframe.camera_from_direct = current->packet.direct_from_camera.Inverse();
  request.keyframe.direct_segment = current->packet.segment;
  request.keyframe.features = current->features;
  request.points = current->tracked.points;
  request.depths = current->depths;
  request.map_per_direct = map_per_direct;
  request.points_from_depths = points_from_depths;
  request.parent = parent;
  request.nearby = current->tracked.nearby;

  map::Edit edit(map_);
  CAIRN_ASSIGN_OR_RETURN(const InsertionReport inserted, mapper_.Insert(edit, std::move(request)));
  KeyframeReport& report = current->report;
  report.times.new_points_ms = inserted.new_points_ms;
  report.times.fuse_ms = inserted.fuse_ms;
  report.times.adjust_ms = inserted.adjust_ms;
  report.times.cull_ms = inserted.cull_ms;
  watch.LapMs();
  CAIRN_RETURN_IF_ERROR(CommitEdit(std::move(edit), absl::StrCat("insert keyframe ", inserted.keyframe.value())));
  report.times.commit_ms = watch.LapMs();
  report.inserted = true;
  report.keyframe = inserted.keyframe;
  report.new_points = inserted.new_points;
  report.fused_points = inserted.fused_points;
  report.culled_points = inserted.culled_points;
  report.culled_keyframes = inserted.culled_keyframes;
  since_insertion_ = 0;
  Remember(map_->keyframe(inserted.keyframe).camera_from_map, inserted.keyframe, current);
  return absl::OkStatus();
}

absl::Status FeatureMapper::Impl::CommitEdit(map::Edit edit, std::string reason) {
  return CommitDelta(edit.Finish(std::move(reason)));
}

absl::Status FeatureMapper::Impl::CommitDelta(map::Delta delta) {
  if (delta.empty()) return absl::OkStatus();
  if (places_) CAIRN_RETURN_IF_ERROR(places_->Update(delta));
  CAIRN_ASSIGN_OR_RETURN(map_, commit_(std::move(delta)));
  if (map_ == nullptr) return absl::InternalError("the commit function returned no map");
  return absl::OkStatus();
}

absl::Status FeatureMapper::Impl::CommitCorrection(map::Delta delta,
                                                   const std::unordered_map<KeyframeId, double>& scales) {
  for (const KeyframeId removed : delta.removed_keyframes) {
    if (last_.reference == removed) last_.known = false;
  }
  CAIRN_RETURN_IF_ERROR(CommitDelta(std::move(delta)));
  trajectory_.Rescale(scales);
  const auto here = scales.find(last_.reference);
  if (!last_.known || here == scales.end()) return absl::OkStatus();
  last_.reference_from_camera = Scaled(last_.reference_from_camera, here->second);
  scale_.Rescale(here->second);
  median_depth_ *= here->second;
  return absl::OkStatus();
}

void FeatureMapper::Impl::OnCull(const map::Edit& edit, const map::Keyframe& culled, const map::Keyframe& heir) {
  const SE3 heir_from_culled = heir.camera_from_map * culled.camera_from_map.Inverse();
  const auto& entries = trajectory_.entries();
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (entries[i].keyframe == culled.id) {
      views_[i] = MakeViewRecord(culled.keypoints(), culled.points, edit.info().orb);
    }
  }
  trajectory_.Reattach(culled.id, heir.id, heir_from_culled);
  if (last_.reference == culled.id) {
    last_.reference = heir.id;
    last_.reference_from_camera = heir_from_culled * last_.reference_from_camera;
  }
}

absl::Status FeatureMapper::Impl::Finish() {
  std::vector<KeyframeId> own;
  map_->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (keyframe->session == session_) own.push_back(keyframe->id);
  });
  if (own.size() >= 2 && static_cast<int>(own.size()) <= options_.max_final_keyframes) {
    map::Edit edit(map_);
    LocalAdjustmentOptions adjustment;
    adjustment.first_iterations = options_.final_iterations;
    adjustment.second_iterations = options_.final_iterations;
    adjustment.max_fixed_keyframes = 0;
    const auto adjusted = AdjustKeyframes(edit, own, adjustment);
    if (adjusted.ok()) {
      CAIRN_RETURN_IF_ERROR(CommitEdit(std::move(edit), "bundle adjustment of the session"));
    } else if (!absl::IsInternal(adjusted.status())) {
      return adjusted.status();
    }
  }
  auto& entries = trajectory_.entries();
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (!entries[i].reference || views_[i].empty()) continue;
    const map::Keyframe& reference = map_->keyframe(entries[i].reference);
    const SE3 now = entries[i].reference_from_camera.Inverse() * reference.camera_from_map;
    const auto refined = RefineView(*map_, pinhole_, views_[i], now, options_.min_inliers);
    if (refined) entries[i].reference_from_camera = reference.camera_from_map * refined->Inverse();
  }
  return absl::OkStatus();
}

FeatureMapper::FeatureMapper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FeatureMapper::~FeatureMapper() = default;

absl::StatusOr<std::unique_ptr<FeatureMapper>> FeatureMapper::Create(const FeatureMapperOptions& options,
                                                                     std::shared_ptr<const map::Snapshot> map,
                                                                     SessionId session, CameraId camera,
                                                                     const place::Vocabulary* vocabulary,
                                                                     Commit commit) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (map == nullptr || !commit) return absl::InvalidArgumentError("feature mapper: needs a map and a commit function");
  if (!map->sessions().contains(session) || !map->cameras().contains(camera)) {
    return absl::InvalidArgumentError(
        absl::StrCat("feature mapper: the map has no session ", session.value(), " or no camera ", camera.value()));
  }
  auto impl = std::make_unique<Impl>(options, std::move(map), session, camera, vocabulary, std::move(commit));
  CAIRN_RETURN_IF_ERROR(impl->BuildPlaces());
  return std::unique_ptr<FeatureMapper>(new FeatureMapper(std::move(impl)));
}

absl::StatusOr<KeyframeReport> FeatureMapper::Process(const direct::KeyframePacket& packet) {
  return impl_->Process(packet);
}
absl::Status FeatureMapper::Finish() { return impl_->Finish(); }
absl::StatusOr<std::shared_ptr<const map::Snapshot>> FeatureMapper::CommitCorrection(
    map::Delta delta, const std::unordered_map<KeyframeId, double>& scales) {
  CAIRN_RETURN_IF_ERROR(impl_->CommitCorrection(std::move(delta), scales));
  return impl_->map();
}
const tracking::PlaceDatabase* FeatureMapper::places() const { return impl_->places(); }
const std::shared_ptr<const map::Snapshot>& FeatureMapper::map() const { return impl_->map(); }
FeatureState FeatureMapper::state() const { return impl_->state(); }
std::vector<TrajectoryKeyframe> FeatureMapper::Trajectory(const map::Snapshot& snapshot) const {
  return impl_->trajectory().Resolve(snapshot);
}

}  // namespace cairn::mapping
