#include "mapping/feature_mapper.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "map/lens.h"
#include "mapping/direct_trajectory.h"
#include "mapping/feature_mapper_impl.h"
#include "mapping/held.h"
#include "mapping/stopwatch.h"

namespace cairn::mapping {

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
  auto& keypoints = current->features->features.keypoints;
  const auto count = [](const KeypointDepth& depth) { return depth.known(); };
  current->depths = KeypointDepths(keypoints, packet.points);
  current->num_depths = static_cast<int>(std::ranges::count_if(current->depths, count));
  if (!component_ && current->num_depths < options_.min_start_points) {
    current->depths = KeypointDepths(keypoints, packet.points, WideKeypointDepths(map_->info().orb.scale_factor));
    current->num_depths = static_cast<int>(std::ranges::count_if(current->depths, count));
  }
  map::CorrectKeypoints(map_->cameras().at(camera_), keypoints);
  current->grid = image::FeatureGrid(keypoints, pinhole_.width_px, pinhole_.height_px);
  return absl::OkStatus();
}

absl::StatusOr<KeyframeReport> FeatureMapper::Impl::Process(const direct::KeyframePacket& packet) {
  CAIRN_RETURN_IF_ERROR(Check(packet));
  Stopwatch total;
  CpuStopwatch cpu, watch;
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
  report.times.cpu_ms = cpu.LapMs();
  report.times.total_ms = total.LapMs();
  return report;
}

absl::Status FeatureMapper::Impl::Continue(Current* current) {
  const direct::KeyframePacket& packet = current->packet;
  if (!component_) {
    if (current->num_depths < options_.min_start_points) {
      current->report.message = absl::StrCat("a start needs ", options_.min_start_points,
                                             " features with depth, there are ", current->num_depths);
      Record(*current, false, 0.0);
      return absl::OkStatus();
    }
    return Start(SE3(), 1.0, KeyframeId(), current);
  }
  const tracking::PoseSeed seed = last_.known ? SeedPose(packet) : tracking::PoseSeed();
  // A new segment may be anywhere: a few matches around the last pose, found in a wide search, prove nothing.
  const bool blind = last_.known && packet.segment != last_.segment;
  if (last_.known && !blind && Track(seed, current)) return Accept(current);
  CAIRN_ASSIGN_OR_RETURN(const bool relocated, Relocate(current));
  if (relocated) {
    current->report.relocated = true;
    return Accept(current);
  }
  if (blind && Track(seed, current) && current->tracked.inliers >= options_.poor_inliers) return Accept(current);
  return Lose(seed.camera_from_map, current);
}

// Whether nobody else has taken pictures with this session's camera, so that its lens is this session's to correct.
bool FeatureMapper::Impl::OwnsCamera() const {
  bool owns = true;
  map_->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    owns &= keyframe->camera != camera_ || keyframe->session == session_;
  });
  return owns;
}

// Over all that the session added to a component, and what others have of it unless that is held; the lens of the
// session's camera in between, as soon as poses and points agree with it as it is calibrated.
absl::Status FeatureMapper::Impl::AdjustSession(ComponentId component, const std::vector<KeyframeId>& own) {
  std::vector<KeyframeId> free;
  map_->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (keyframe->component == component && !IsHeld(*map_, *keyframe, session_)) free.push_back(keyframe->id);
  });
  if (static_cast<int>(free.size()) > options_.max_final_keyframes) free = own;
  map::Edit edit(map_);
  LocalAdjustmentOptions adjustment;
  adjustment.first_iterations = options_.final_iterations;
  adjustment.second_iterations = options_.final_iterations;
  // What is bent over many keyframes costs little and straightens slowly.
  adjustment.function_tolerance = options_.final_tolerance;
  adjustment.max_fixed_keyframes = 0;
  absl::Status adjusted = AdjustKeyframes(edit, free, adjustment).status();
  if (absl::IsInternal(adjusted)) return absl::OkStatus();  // no better answer: the map stays as it was
  CAIRN_RETURN_IF_ERROR(adjusted);
  if (OwnsCamera() && !lens_) {
    CAIRN_ASSIGN_OR_RETURN(lens_, RefineLens(edit, own, camera_, options_.lens));
  }
  adjustment.noise_iterations = options_.noise_iterations;
  adjustment.rotations = DirectRotations(trajectory_.entries(), *map_);
  adjusted = AdjustKeyframes(edit, free, adjustment).status();
  if (!absl::IsInternal(adjusted)) CAIRN_RETURN_IF_ERROR(adjusted);
  CAIRN_RETURN_IF_ERROR(CommitEdit(std::move(edit), "bundle adjustment of the session"));
  if (lens_ && lens_->applied) CorrectViews();
  return absl::OkStatus();
}

void FeatureMapper::Impl::CorrectViews() {
  const map::MapCamera& camera = map_->cameras().at(camera_);
  for (ViewRecord& view : views_) {
    for (ViewRecord::Sight& sight : view.sights) {
      const auto ideal = camera.lens->Ideal(camera.pinhole, {sight.x_px, sight.y_px});
      if (!ideal) continue;
      sight.x_px = static_cast<float>(ideal->x());
      sight.y_px = static_cast<float>(ideal->y());
    }
  }
}

// A session that came to where others have been adds what they have not seen.
absl::Status FeatureMapper::Impl::CullSession() {
  std::vector<KeyframeId> own;
  bool others = false;
  map_->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (keyframe->session != session_) return;
    own.push_back(keyframe->id);
    for (const KeyframeId id : map::BestCovisible(*keyframe)) others |= map_->keyframe(id).session != session_;
  });
  if (!others) return absl::OkStatus();
  map::Edit edit(map_);
  mapper_.CullRedundant(edit, std::move(own));
  return CommitEdit(std::move(edit), "cull redundant keyframes");
}

absl::Status FeatureMapper::Impl::Finish() {
  std::map<ComponentId, std::vector<KeyframeId>> own_of;
  map_->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (keyframe->session == session_) own_of[keyframe->component].push_back(keyframe->id);
  });
  for (const auto& [component, own] : own_of) {
    if (own.size() < 2 || static_cast<int>(own.size()) > options_.max_final_keyframes) continue;
    CAIRN_RETURN_IF_ERROR(AdjustSession(component, own));
  }
  CAIRN_RETURN_IF_ERROR(CullSession());  // last: what goes has helped to place what stays
  auto& entries = trajectory_.entries();
  for (std::size_t i = 0; i < entries.size(); ++i) {
    if (!entries[i].reference || views_[i].empty()) continue;
    const map::Keyframe& reference = map_->keyframe(entries[i].reference);
    const SE3 now = entries[i].reference_from_camera.Inverse() * reference.camera_from_map;
    const auto refined = RefineView(*map_, pinhole_, views_[i], now, options_.tracker.min_inliers);
    if (refined) entries[i].reference_from_camera = reference.camera_from_map * refined->Inverse();
  }
  return absl::OkStatus();
}

FeatureMapper::FeatureMapper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FeatureMapper::~FeatureMapper() = default;

absl::StatusOr<std::unique_ptr<FeatureMapper>> FeatureMapper::Create(const FeatureMapperOptions& options, MapHead* head,
                                                                     SessionId session, CameraId camera) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const map::Snapshot& map = head->View()->map();
  if (!map.sessions().contains(session) || !map.cameras().contains(camera)) {
    return absl::InvalidArgumentError(
        absl::StrCat("feature mapper: the map has no session ", session.value(), " or no camera ", camera.value()));
  }
  return std::unique_ptr<FeatureMapper>(new FeatureMapper(std::make_unique<Impl>(options, head, session, camera)));
}

absl::StatusOr<KeyframeReport> FeatureMapper::Process(const direct::KeyframePacket& packet) {
  return impl_->Process(packet);
}

absl::StatusOr<std::optional<FeatureMapper::Found>> FeatureMapper::Locate(const direct::Frame& frame) const {
  return impl_->Locate(frame);
}
void FeatureMapper::InsertEach(bool each) { impl_->InsertEach(each); }
absl::Status FeatureMapper::Finish() { return impl_->Finish(); }
void FeatureMapper::OnChange(const tracking::MapView& before, const map::Delta& delta,
                             const std::shared_ptr<const tracking::MapView>& after, const KeyframeScales& scales) {
  impl_->OnChange(before, delta, after, scales);
}

void FeatureMapper::ReviseDirectPoses(const std::unordered_map<std::int64_t, SE3>& direct_from_camera) {
  impl_->ReviseDirectPoses(direct_from_camera);
}

ComponentId FeatureMapper::component() const { return impl_->component(); }
const KeyframeTrajectory& FeatureMapper::trajectory() const { return impl_->trajectory(); }
const std::shared_ptr<const map::Snapshot>& FeatureMapper::map() const { return impl_->map(); }
const std::optional<LensReport>& FeatureMapper::lens() const { return impl_->lens(); }
FeatureState FeatureMapper::state() const { return impl_->state(); }
std::vector<TrajectoryKeyframe> FeatureMapper::Trajectory(const map::Snapshot& snapshot) const {
  return impl_->trajectory().Resolve(snapshot);
}

}  // namespace cairn::mapping
