// Reading updates.
#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "map/point_completion.h"
#include "map/region.h"
#include "store/blobs.h"
#include "wire/convert.h"
#include "wire/convert_deltas.h"
#include "wire/convert_map_rows.h"

namespace cairn::wire {
namespace {

absl::Status Bad(absl::string_view what) { return absl::InvalidArgumentError(absl::StrCat("follow: ", what)); }

store::Bytes BytesOf(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace

absl::Status UpdateReader::Begin(const v1::UpdateBegin& begin) {
  update_.whole = begin.whole();
  map::Delta& delta = update_.delta;
  if (begin.revision() == 0) return Bad("an update must lead to a revision");
  if (begin.whole()) {
    if (!begin.has_head()) return Bad("a view must say of which map");
    CAIRN_ASSIGN_OR_RETURN(info_, FromProto(begin.head()));
    update_.base = map::Snapshot::Empty(info_, begin.revision() - 1);
  } else {
    if (held_ == nullptr || begin.base() != held_->revision() || begin.revision() < begin.base()) {
      return Bad(
          absl::StrCat("a change from revision ", begin.base(), " to ", begin.revision(), " is none of what is held"));
    }
    info_ = held_->info();
    if (begin.has_head()) {
      CAIRN_ASSIGN_OR_RETURN(info_, FromProto(begin.head()));
      delta.info = info_;
    }
    update_.base = held_;
  }
  delta.base = update_.base->revision();
  delta.num_changes = begin.revision() - delta.base;
  delta.reason = absl::StrCat("revision ", begin.revision());
  delta.next_keyframe = KeyframeId(begin.next_keyframe());
  delta.next_point = PointId(begin.next_point());
  delta.next_camera = CameraId(begin.next_camera());
  delta.next_session = SessionId(begin.next_session());
  delta.next_component = ComponentId(begin.next_component());
  vocabulary_bytes_ = begin.vocabulary_bytes();
  begun_ = true;
  return absl::OkStatus();
}

absl::StatusOr<bool> UpdateReader::Read(const v1::FollowMapResponse& message) {
  const auto bytes = static_cast<std::int64_t>(message.ByteSizeLong());
  update_.bytes += bytes;
  if (update_.bytes > kMaxBytes) return Bad("the update does not end");
  if (begun_ == message.has_begin()) return Bad("an update has one beginning, before all else");
  switch (message.step_case()) {
    case v1::FollowMapResponse::kBegin:
      CAIRN_RETURN_IF_ERROR(Begin(message.begin()));
      return false;
    case v1::FollowMapResponse::kVocabulary:
      update_.vocabulary += message.vocabulary();
      if (static_cast<std::int64_t>(update_.vocabulary.size()) > vocabulary_bytes_) {
        return Bad("the vocabulary is longer than it was said to be");
      }
      return false;
    case v1::FollowMapResponse::kRows:
      rows_bytes_ += static_cast<std::int64_t>(message.rows().ByteSizeLong());
      CAIRN_RETURN_IF_ERROR(AddRows(message.rows()));
      return false;
    case v1::FollowMapResponse::kEnd:
      if (static_cast<std::int64_t>(update_.vocabulary.size()) != vocabulary_bytes_) {
        return Bad("the vocabulary is shorter than it was said to be");
      }
      if (message.end().rows_bytes() != rows_bytes_) return Bad("rows are missing");
      update_.keyframes = message.end().keyframes();
      update_.points = message.end().points();
      return true;
    default:
      return Bad("an update ends before anything else comes");
  }
}

absl::Status UpdateReader::AddRows(const v1::UpdateRows& rows) {
  map::Delta& delta = update_.delta;
  const map::Snapshot& base = *update_.base;
  for (const v1::CameraRow& row : rows.cameras()) {
    CAIRN_ASSIGN_OR_RETURN(map::MapCamera camera, FromProto(row));
    delta.cameras.push_back(std::move(camera));
  }
  for (const v1::SessionRow& row : rows.sessions()) delta.sessions.push_back(FromProto(row));
  for (const v1::ComponentRow& row : rows.components()) {
    CAIRN_ASSIGN_OR_RETURN(map::Component component, FromProto(row));
    delta.components.push_back(std::move(component));
  }
  for (const v1::KeyframeRow& row : rows.keyframes()) CAIRN_RETURN_IF_ERROR(AddKeyframe(row));
  if (rows.has_points()) CAIRN_RETURN_IF_ERROR(AddPoints(rows.points()));
  for (const std::uint32_t id : rows.removed_cameras()) {
    if (base.cameras().contains(CameraId(id))) delta.removed_cameras.emplace_back(id);
  }
  for (const std::uint32_t id : rows.removed_components()) {
    if (base.components().contains(ComponentId(id))) delta.removed_components.emplace_back(id);
  }
  for (const std::uint32_t id : rows.removed_keyframes()) {
    if (base.keyframes().Contains(KeyframeId(id))) delta.removed_keyframes.emplace_back(id);
  }
  return rows.has_removed_points() ? AddRemovedPoints(rows.removed_points()) : absl::OkStatus();
}

const Pinhole* UpdateReader::PinholeOf(CameraId id) const {
  for (const map::MapCamera& camera : update_.delta.cameras) {
    if (camera.id == id) return &camera.pinhole;
  }
  const auto known = update_.base->cameras().find(id);
  return known == update_.base->cameras().end() ? nullptr : &known->second.pinhole;
}

absl::Status UpdateReader::AddFeatures(const v1::FeaturesRow& row, const map::Keyframe* before,
                                       map::Keyframe* keyframe) {
  const std::string name = absl::StrCat("keyframe ", keyframe->id.value(), ": ");
  auto features = store::UnpackFeatures(row.count(), row.keypoint_layout(), row.word_bytes(), BytesOf(row.keypoints()),
                                        BytesOf(row.descriptors()), BytesOf(row.words()));
  if (!features.ok()) return Bad(name + std::string(features.status().message()));
  const Pinhole* pinhole = PinholeOf(keyframe->camera);
  if (pinhole == nullptr) return Bad(name + "its camera is missing");
  const absl::string_view wrong = store::WrongKeypoints(features->features.keypoints, pinhole, info_.orb.num_levels);
  if (!wrong.empty()) return Bad(absl::StrCat(name, wrong));
  keyframe->features = std::make_shared<const map::KeyframeFeatures>(*std::move(features));
  if (before != nullptr) update_.delta.moved_keypoints.push_back(keyframe->id);
  return absl::OkStatus();
}

absl::Status UpdateReader::AddKeyframe(const v1::KeyframeRow& row) {
  auto keyframe = std::make_shared<map::Keyframe>();
  keyframe->id = KeyframeId(row.id());
  const std::string name = absl::StrCat("keyframe ", row.id(), ": ");
  keyframe->session = SessionId(row.session());
  keyframe->camera = CameraId(row.camera());
  keyframe->component = ComponentId(row.component());
  keyframe->time_ns = row.time_ns();
  keyframe->frame_index = row.frame_index();
  CAIRN_ASSIGN_OR_RETURN(keyframe->camera_from_map, FromProto(row.camera_from_map()));
  CAIRN_ASSIGN_OR_RETURN(keyframe->camera_from_direct, FromProto(row.camera_from_direct()));
  keyframe->direct_segment = row.direct_segment();
  keyframe->parent = KeyframeId(row.parent());
  for (const std::uint32_t child : row.children()) keyframe->children.emplace_back(child);
  if (row.covisible_size() != row.shared_points_size()) return Bad(name + "edges without a number of points");
  for (int i = 0; i < row.covisible_size(); ++i) {
    if (row.shared_points(i) > std::uint32_t{std::numeric_limits<int>::max()}) return Bad(name + "shared_points");
    keyframe->covisible.push_back({KeyframeId(row.covisible(i)), static_cast<int>(row.shared_points(i))});
  }
  const map::Keyframe* before = update_.base->keyframes().Find(keyframe->id);
  if (row.has_features()) {
    CAIRN_RETURN_IF_ERROR(AddFeatures(row.features(), before, keyframe.get()));
  } else if (before != nullptr) {
    keyframe->features = before->features;
  } else {
    return Bad(name + "it is new, but comes without features");
  }
  const std::size_t num_features = keyframe->features->features.size();
  if (row.has_points()) {
    auto points = store::UnpackPointIds(num_features, BytesOf(row.points()));
    if (!points.ok()) return Bad(absl::StrCat(name, points.status().message()));
    keyframe->points = *std::move(points);
  } else if (before != nullptr) {
    keyframe->points = before->points;
  }
  if (keyframe->points.size() != num_features) return Bad(name + "not one point entry per feature");
  update_.delta.keyframes.push_back(std::move(keyframe));
  return absl::OkStatus();
}

absl::Status UpdateReader::AddPoints(const v1::PointRows& rows) {
  const std::string& positions = rows.positions();
  const auto count = static_cast<std::size_t>(rows.reference_keyframes_size());
  if (rows.ids().count() != count || positions.size() != count * kPointPositionBytes ||
      static_cast<std::size_t>(rows.times_visible_size()) != count ||
      static_cast<std::size_t>(rows.times_found_size()) != count) {
    return Bad("columns of points of different lengths");
  }
  const auto ids = store::UnpackPointIds(count, BytesOf(rows.ids().ids()));
  if (!ids.ok()) return Bad(absl::StrCat("ids of points: ", ids.status().message()));
  for (std::size_t i = 0; i < count; ++i) {
    const int at = static_cast<int>(i);
    constexpr std::uint32_t kMost = std::numeric_limits<int>::max();
    if (rows.times_visible(at) > kMost || rows.times_found(at) > kMost) return Bad("a point's counts are out of range");
    auto point = std::make_shared<map::MapPoint>();
    point->id = (*ids)[i];
    std::memcpy(point->position.data(), positions.data() + i * kPointPositionBytes, kPointPositionBytes);
    point->reference.keyframe = KeyframeId(rows.reference_keyframes(at));
    point->times_visible = static_cast<int>(rows.times_visible(at));
    point->times_found = static_cast<int>(rows.times_found(at));
    points_.push_back(std::move(point));
  }
  return absl::OkStatus();
}

absl::Status UpdateReader::AddRemovedPoints(const v1::PointIds& ids) {
  const auto removed = store::UnpackPointIds(ids.count(), BytesOf(ids.ids()));
  if (!removed.ok()) return Bad(absl::StrCat("removed points: ", removed.status().message()));
  for (const PointId id : *removed) {
    if (update_.base->points().Contains(id)) update_.delta.removed_points.push_back(id);
  }
  return absl::OkStatus();
}

bool NeedsRebuilding(const MapUpdate& update) {
  const map::Snapshot& base = *update.base;
  return !update.whole && (std::ranges::any_of(update.delta.keyframes,
                                               [&](const auto& keyframe) {
                                                 return keyframe->id < base.next_keyframe() &&
                                                        !base.keyframes().Contains(keyframe->id);
                                               }) ||
                           std::ranges::any_of(update.delta.points, [&](const auto& point) {
                             return point->id < base.next_point() && !base.points().Contains(point->id);
                           }));
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> Applied(const MapUpdate& update) {
  if (!NeedsRebuilding(update)) return update.base->Apply(update.delta);
  const map::Delta before = map::AllOf(*update.base);
  const auto empty = map::Snapshot::Empty(update.base->info(), before.base);
  CAIRN_ASSIGN_OR_RETURN(map::Delta all, map::MergeDeltas(*empty, before, update.delta));
  // The revision that it is of, however many there were between.
  const auto anew = map::Snapshot::Empty(update.base->info(), all.revision() - 1);
  all.base = anew->revision();
  all.num_changes = 1;
  all.moved_keypoints.clear();
  return anew->Apply(all);
}

absl::StatusOr<MapUpdate> UpdateReader::Take() {
  const absl::Status completed = map::CompletePoints(*update_.base, info_.orb, points_, &update_.delta);
  if (!completed.ok()) return Bad(completed.message());
  return std::move(update_);
}

}  // namespace cairn::wire
