#include "store/map_assembly.h"

#include <algorithm>
#include <iterator>
#include <unordered_map>
#include <utility>

#include "map/component_assignment.h"
#include "map/viewing.h"

namespace cairn::store {

map::Keyframe* MapRows::FindKeyframe(std::int64_t id) {
  const auto at = std::lower_bound(keyframes.begin(), keyframes.end(), id, [](const auto& keyframe, std::int64_t key) {
    return static_cast<std::int64_t>(keyframe->id.value()) < key;
  });
  if (at == keyframes.end() || static_cast<std::int64_t>((*at)->id.value()) != id) return nullptr;
  return at->get();
}

void SortCovisible(map::Keyframe* keyframe) {
  std::sort(keyframe->covisible.begin(), keyframe->covisible.end(), [](const auto& a, const auto& b) {
    return a.shared_points != b.shared_points ? a.shared_points > b.shared_points : a.keyframe < b.keyframe;
  });
}

void IdIndex::Reserve(std::uint32_t last, std::size_t count) {
  constexpr std::size_t kMostPerEntity = 8, kAlwaysDense = 1 << 16;
  if (last <= kMostPerEntity * count + kAlwaysDense) dense_.resize(last + std::size_t{1});
}

void IdIndex::Set(std::uint32_t id, std::size_t place) {
  if (dense_.empty()) {
    sparse_.emplace(id, place);
  } else {
    dense_[id] = static_cast<std::uint32_t>(place + 1);
  }
}

std::size_t IdIndex::Find(std::uint32_t id) const {
  if (!dense_.empty()) return id < dense_.size() && dense_[id] > 0 ? dense_[id] - 1 : kNone;
  const auto found = sparse_.find(id);
  return found == sparse_.end() ? kNone : found->second;
}

std::shared_ptr<map::MapPoint> PointBlocks::Next() {
  if (used_ == kSize) {
    block_ = std::make_shared<std::array<map::MapPoint, kSize>>();
    used_ = 0;
  }
  return {block_, &(*block_)[used_++]};
}

void SetFromRow(const PointRow& row, map::MapPoint* point) {
  point->id = row.id;
  point->position = row.position;
  point->reference.keyframe = row.reference_keyframe;
  point->times_visible = row.times_visible;
  point->times_found = row.times_found;
}

namespace {

class Assembly {
 public:
  Assembly(MapRows rows, const FindingSink& sink) : rows_(std::move(rows)), sink_(sink) {}

  absl::StatusOr<map::Delta> Run();

 private:
  absl::Status Report(absl::string_view table, std::int64_t id, absl::string_view message) {
    return sink_(Finding{std::string(table), id, std::string(message)});
  }
  absl::Status LinkKeyframes();
  absl::Status CheckTree();
  // False if it ended at a finding.
  absl::StatusOr<bool> LinkObservations();
  absl::Status LinkPoints();
  // What a map of an older format has none of: components, next ids.
  void SetWhatFormat4Added();

  MapRows rows_;
  const FindingSink& sink_;
};

absl::Status Assembly::LinkKeyframes() {
  for (const EdgeRow& edge : rows_.edges) {
    map::Keyframe* a = rows_.FindKeyframe(edge.a.value());
    map::Keyframe* b = rows_.FindKeyframe(edge.b.value());
    if (a == nullptr || b == nullptr) {
      return Report("covisibility", edge.a.value(),
                    absl::StrCat("a keyframe of ", edge.a.value(), " - ", edge.b.value(), " is missing"));
    }
    a->covisible.push_back({edge.b, edge.shared_points});
    b->covisible.push_back({edge.a, edge.shared_points});
  }
  for (const auto& keyframe : rows_.keyframes) {
    SortCovisible(keyframe.get());
    if (!keyframe->parent) continue;
    map::Keyframe* parent = rows_.FindKeyframe(keyframe->parent.value());
    if (parent == nullptr) return Report("keyframes", keyframe->id.value(), "the parent is missing");
    parent->children.push_back(keyframe->id);
  }
  return CheckTree();
}

absl::Status Assembly::CheckTree() {
  // Whatever cannot be reached from a root downwards is on, or below, a circle of parents.
  std::vector<const map::Keyframe*> reached;
  for (const auto& keyframe : rows_.keyframes) {
    if (!keyframe->parent) reached.push_back(keyframe.get());
  }
  for (std::size_t i = 0; i < reached.size(); ++i) {
    for (const KeyframeId child : reached[i]->children) reached.push_back(rows_.FindKeyframe(child.value()));
  }
  if (reached.size() == rows_.keyframes.size()) return absl::OkStatus();
  return Report("keyframes", 0, "the parents of some keyframes form a circle");
}

absl::StatusOr<bool> Assembly::LinkObservations() {
  // Those of all points one behind the other first: that is little memory to jump about in.
  const IdIndex index(rows_.points);
  std::vector<std::uint32_t> begin(rows_.points.size() + 1);
  for (const auto& keyframe : rows_.keyframes) {
    for (const PointId id : keyframe->points) {
      const std::size_t row = id ? index.Find(id.value()) : IdIndex::kNone;
      if (row != IdIndex::kNone) ++begin[row + 1];
    }
  }
  for (std::size_t row = 0; row < rows_.points.size(); ++row) begin[row + 1] += begin[row];
  std::vector<map::Observation> all(begin.back());
  std::vector<std::uint32_t> end(begin.begin(), begin.end() - 1);
  for (const auto& keyframe : rows_.keyframes) {
    for (std::uint32_t i = 0; i < keyframe->points.size(); ++i) {
      if (!keyframe->points[i]) continue;
      const std::size_t row = index.Find(keyframe->points[i].value());
      const bool missing = row == IdIndex::kNone;
      if (missing || (end[row] > begin[row] && all[end[row] - 1].keyframe == keyframe->id)) {
        CAIRN_RETURN_IF_ERROR(
            Report("keyframe_points", keyframe->id.value(),
                   absl::StrCat("point ", keyframe->points[i].value(), missing ? " is missing" : " is there twice")));
        return false;
      }
      all[end[row]++] = {keyframe->id, i};
    }
  }
  for (std::size_t row = 0; row < rows_.points.size(); ++row) {
    rows_.points[row]->observations.assign(all.begin() + begin[row], all.begin() + begin[row + 1]);
  }
  return true;
}

absl::Status Assembly::LinkPoints() {
  CAIRN_ASSIGN_OR_RETURN(const bool linked, LinkObservations());
  if (!linked) return absl::OkStatus();
  std::unordered_map<CameraId, double> focal_px;
  for (const map::MapCamera& camera : rows_.content.cameras) focal_px.emplace(camera.id, camera.pinhole.fx_px);
  const IdIndex index(rows_.keyframes);
  std::vector<Vector3d> center_of;
  center_of.reserve(rows_.keyframes.size());
  for (const auto& keyframe : rows_.keyframes) center_of.push_back(keyframe->CenterInMap());
  std::vector<Vector3d> centers;
  for (std::size_t i = 0; i < rows_.points.size(); ++i) {
    map::MapPoint& point = *rows_.points[i];
    const KeyframeId reference_id = point.reference.keyframe;
    centers.clear();
    std::size_t reference = IdIndex::kNone;
    for (const map::Observation& observation : point.observations) {
      const std::size_t observer = index.Find(observation.keyframe.value());
      centers.push_back(center_of[observer]);
      if (observation.keyframe != reference_id) continue;
      point.reference = observation;
      reference = observer;
    }
    if (reference == IdIndex::kNone) {
      return Report("points", point.id.value(), "the reference keyframe does not observe the point");
    }
    const map::Keyframe& keyframe = *rows_.keyframes[reference];
    if (rows_.octaves.empty()) point.descriptor = keyframe.descriptors()[point.reference.feature];
    const int octave = rows_.octaves.empty() ? keyframe.keypoints()[point.reference.feature].octave : rows_.octaves[i];
    map::SetViewing(map::ComputeViewing(point.position, centers, center_of[reference], octave,
                                        focal_px.at(keyframe.camera), rows_.map_row.info.orb),
                    &point);
  }
  rows_.octaves = {};
  rows_.content.points.assign(std::make_move_iterator(rows_.points.begin()),
                              std::make_move_iterator(rows_.points.end()));
  rows_.points = {};
  return absl::OkStatus();
}

void Assembly::SetWhatFormat4Added() {
  const auto next = [](const auto& entities, auto first) {
    for (const auto& entity : entities) first = std::max(first, decltype(first)(entity.id.value() + 1));
    return first;
  };
  rows_.content.next_camera = next(rows_.content.cameras, CameraId(1));
  rows_.content.next_session = next(rows_.content.sessions, SessionId(1));
  if (rows_.map_row.revision == 0) return;
  rows_.content.components =
      map::AssignComponents(rows_.map_row.world_from_map, rows_.keyframes, &rows_.content.sessions);
  rows_.content.next_component = next(rows_.content.components, ComponentId(1));
}

absl::StatusOr<map::Delta> Assembly::Run() {
  CAIRN_RETURN_IF_ERROR(LinkKeyframes());
  map::Delta& content = rows_.content;
  content.next_camera = rows_.map_row.next_camera;
  content.next_session = rows_.map_row.next_session;
  content.next_component = rows_.map_row.next_component;
  if (rows_.format < 4) SetWhatFormat4Added();
  CAIRN_RETURN_IF_ERROR(LinkPoints());
  content.keyframes.assign(std::make_move_iterator(rows_.keyframes.begin()),
                           std::make_move_iterator(rows_.keyframes.end()));
  content.next_keyframe = rows_.map_row.next_keyframe;
  content.next_point = rows_.map_row.next_point;
  if (rows_.map_row.revision > 0) content.base = rows_.map_row.revision - 1;
  return std::move(content);
}

}  // namespace

absl::StatusOr<map::Delta> AssembleMap(MapRows rows, const FindingSink& sink) {
  return Assembly(std::move(rows), sink).Run();
}

}  // namespace cairn::store
