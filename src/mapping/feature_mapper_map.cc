// What a packet changes: the map, the trajectory, where the camera was last.
#include <algorithm>
#include <utility>

#include "mapping/feature_mapper_impl.h"
#include "mapping/stopwatch.h"

namespace cairn::mapping {
namespace {

// The first keyframes are all inserted: the map needs them more than it needs to be small.
constexpr int kAlwaysInserted = 4;

// A component of the session's own; it notes that it has touched it.
ComponentId BeginComponent(SessionId session_id, map::Edit* edit) {
  map::Component component;
  component.session = session_id;
  const ComponentId id = edit->AddComponent(component);
  map::Session session = edit->session(session_id);
  session.components.push_back(id);
  edit->PutSession(session);
  return id;
}

}  // namespace

// Packets that need not be inserted in a row: fewer when they are rare.
int FeatureMapper::Impl::MaxBetween(double rate_hz) const {
  const int by_time = static_cast<int>(rate_hz * options_.max_seconds_between);
  return std::min(options_.max_keyframes_between, by_time);
}

bool FeatureMapper::Impl::ShouldInsert(const Current& current) const {
  const int inliers = current.tracked.inliers;
  return insert_each_ || mapper_.keyframes_inserted() < kAlwaysInserted || inliers < options_.insert_below_matches ||
         since_insertion_ >= MaxBetween(current.packet.keyframe_rate_hz) ||
         inliers < options_.insert_below_share * inserted_inliers_;
}

void FeatureMapper::Impl::Remember(const SE3& camera_from_map, KeyframeId reference, Current* current) {
  last_.known = true;
  last_.segment = current->packet.segment;
  last_.direct_from_camera = current->packet.direct_from_camera;
  last_.reference = reference;
  last_.reference_from_camera = map_->keyframe(reference).camera_from_map * camera_from_map.Inverse();
  current->report.located = true;
  current->report.component = map_->keyframe(reference).component;
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

absl::Status FeatureMapper::Impl::Insert(const SE3& camera_from_map, double map_per_direct, bool points_from_depths,
                                         KeyframeId parent, Current* current) {
  CpuStopwatch watch;
  if (view_->places() != nullptr) {
    current->features->words = view_->places()->vocabulary().LookupAll(current->features->features.descriptors);
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
  if (!component_) component_ = BeginComponent(session_, &edit);
  request.keyframe.component = component_;
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
  edit.SetSession(session_);
  map::Delta delta = edit.Finish(std::move(reason));
  return delta.empty() ? absl::OkStatus() : head_->Commit(std::move(delta), {});
}

// Everything that refers to a keyframe which is gone hangs on the nearest of its ancestors that is left, or on nothing.
void FeatureMapper::Impl::Reattach(KeyframeId gone, const map::Snapshot& before, const map::Snapshot& after) {
  const map::Keyframe* was = before.keyframes().Find(gone);
  if (was == nullptr) return;
  const map::Keyframe* heir = was;
  while (heir != nullptr && !after.keyframes().Contains(heir->id)) heir = before.keyframes().Find(heir->parent);
  const KeyframeId id = heir == nullptr ? KeyframeId() : heir->id;
  const SE3 heir_from_gone = heir == nullptr ? SE3() : heir->camera_from_map * was->camera_from_map.Inverse();
  trajectory_.Reattach(gone, id, heir_from_gone);
  if (last_.reference != gone) return;
  last_.reference = id;
  last_.reference_from_camera = heir_from_gone * last_.reference_from_camera;
  last_.known &= id.valid();
}

void FeatureMapper::Impl::OnChange(const tracking::MapView& before, const map::Delta& delta,
                                   const std::shared_ptr<const tracking::MapView>& after,
                                   const KeyframeScales& scales) {
  for (const KeyframeId removed : delta.removed_keyframes) Reattach(removed, before.map(), after->map());
  view_ = after;
  map_ = after->snapshot();
  if (component_ && map_->components().contains(component_)) component_ = map_->Resolve(component_);
  trajectory_.Rescale(scales);
  const auto here = scales.find(last_.reference);
  if (!last_.known || here == scales.end()) return;
  last_.reference_from_camera = Scaled(last_.reference_from_camera, here->second);
  scale_.Rescale(here->second);
  median_depth_ *= here->second;
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

}  // namespace cairn::mapping
