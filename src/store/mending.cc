#include "store/mending.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_format.h"
#include "base/version.h"
#include "geometry/pinhole_fit.h"
#include "map/typical_descriptor.h"

namespace cairn::store {
namespace {

// A camera that is found from what it saw is one if it saw that so.
constexpr double kMaxCameraErrorPx = 5.0;

template <class Entities, class IdType>
bool Has(const Entities& entities, IdType id) {
  return std::ranges::any_of(entities, [id](const auto& entity) { return entity.id == id; });
}

bool IsAmong(const std::vector<const map::Keyframe*>& keyframes, KeyframeId id) {
  return std::ranges::any_of(keyframes, [id](const map::Keyframe* keyframe) { return keyframe->id == id; });
}

template <class Entities>
void SortById(Entities* entities) {
  std::ranges::sort(*entities, {}, [](const auto& entity) { return entity.id; });
}

class Mending {
 public:
  explicit Mending(MapRows* rows) : rows_(*rows) {}

  absl::StatusOr<Mended> Run() {
    EstimateCameras();
    DropKeyframes();
    if (rows_.keyframes.empty()) {
      return absl::DataLossError("no keyframe is left that has its camera, its features and the points that it sees");
    }
    MendSessions();
    MendComponents();
    DropPoints();
    CountSharedPoints();
    MendTrees();
    MendMapRow();
    return std::move(mended_);
  }

 private:
  // A camera that is lost, from what its keyframes see: their keypoints are pixels of its pinhole.
  void EstimateCameras() {
    std::unordered_map<PointId, Vector3d> positions;
    for (const auto& point : rows_.points) positions.emplace(point->id, point->position);
    std::map<CameraId, std::vector<SeenPoint>> seen;
    for (const auto& keyframe : rows_.keyframes) {
      if (Has(rows_.content.cameras, keyframe->camera) || !keyframe->features) continue;
      for (std::size_t i = 0; i < keyframe->points.size(); ++i) {
        const auto position = positions.find(keyframe->points[i]);
        if (!keyframe->points[i] || position == positions.end()) continue;
        const image::Keypoint& keypoint = keyframe->keypoints()[i];
        seen[keyframe->camera].push_back(
            {keyframe->camera_from_map * position->second, {keypoint.x_px, keypoint.y_px}});
      }
    }
    for (const auto& [id, points] : seen) {
      const std::optional<PinholeFit> fit = FitPinhole(points);
      if (!fit || fit->median_error_px > kMaxCameraErrorPx) continue;
      rows_.content.cameras.push_back({id, "recovered", Camera::FromPinhole(fit->camera), fit->camera});
      mended_.notes.push_back(absl::StrCat(
          "what was known of camera ", id.value(), " is lost; from what its keyframes see it is a pinhole of ",
          fit->camera.width_px, "x", fit->camera.height_px, " px and focal lengths of ",
          absl::StrFormat("%.1f and %.1f px. Its lens is not known any more", fit->camera.fx_px, fit->camera.fy_px)));
    }
    SortById(&rows_.content.cameras);
  }

  void DropKeyframes() {
    std::erase_if(rows_.keyframes, [&](const auto& keyframe) {
      const bool whole = keyframe->features != nullptr &&
                         keyframe->points.size() == keyframe->features->features.size() &&
                         Has(rows_.content.cameras, keyframe->camera);
      if (!whole) mended_.lost_keyframes.push_back(keyframe->id.value());
      return !whole;
    });
  }

  void MendSessions() {
    auto& sessions = rows_.content.sessions;
    std::set<SessionId> needed;
    for (const auto& keyframe : rows_.keyframes) {
      if (!needed.insert(keyframe->session).second || Has(sessions, keyframe->session)) continue;
      map::Session session;
      session.id = keyframe->session;
      session.camera = keyframe->camera;
      session.source = "(lost)";
      session.software_version = kVersion;
      session.first_ns = session.last_ns = keyframe->time_ns;
      session.settings_json = "{}";
      sessions.push_back(std::move(session));
      mended_.notes.push_back(absl::StrCat("what was known of session ", keyframe->session.value(), " is lost"));
    }
    // One without keyframes is history, and goes with its camera.
    std::erase_if(sessions, [&](const map::Session& session) {
      return !needed.contains(session.id) && !Has(rows_.content.cameras, session.camera);
    });
    for (map::Session& session : sessions) {
      if (!Has(rows_.content.cameras, session.camera)) session.camera = CameraOf(session.id);
    }
    SortById(&sessions);
  }

  CameraId CameraOf(SessionId session) const {
    const auto found =
        std::ranges::find_if(rows_.keyframes, [&](const auto& keyframe) { return keyframe->session == session; });
    return found == rows_.keyframes.end() ? rows_.content.cameras.front().id : (*found)->camera;
  }

  void MendComponents() {
    if (rows_.format < 4) return;
    auto& components = rows_.content.components;
    std::set<ComponentId> needed;
    for (const auto& keyframe : rows_.keyframes) {
      if (!needed.insert(keyframe->component).second || Has(components, keyframe->component)) continue;
      map::Component component;
      component.id = keyframe->component;
      component.session = keyframe->session;
      components.push_back(std::move(component));
      mended_.notes.push_back(absl::StrCat("what was known of component ", keyframe->component.value(),
                                           " is lost: it is not aligned any more"));
    }
    for (map::Component& component : components) {
      const bool joined_to_nothing = component.joined && !Has(components, component.joined->into);
      // Its keyframes say that they are in it, in its own frame.
      if (joined_to_nothing || needed.contains(component.id)) component.joined.reset();
    }
    SortById(&components);
  }

  // Points that are lost, or that nothing sees any more. One that is left knows its place, however many have seen it.
  void DropPoints() {
    std::unordered_map<PointId, std::vector<const map::Keyframe*>> seen_by;
    for (const auto& point : rows_.points) seen_by.emplace(point->id, std::vector<const map::Keyframe*>());
    for (const auto& keyframe : rows_.keyframes) {
      std::unordered_set<PointId> seen;
      for (PointId& id : keyframe->points) {
        if (!id) continue;
        const auto point = seen_by.find(id);
        if (point == seen_by.end() || !seen.insert(id).second) {
          id = PointId();
        } else {
          point->second.push_back(keyframe.get());
        }
      }
    }
    std::erase_if(rows_.points, [&](const auto& point) {
      const std::vector<const map::Keyframe*>& observers = seen_by.at(point->id);
      if (observers.empty()) return true;
      KeyframeId& reference = point->reference.keyframe;
      if (!IsAmong(observers, reference)) reference = MostTypical(point->id, observers);
      return false;
    });
    std::unordered_set<PointId> left;
    for (const auto& point : rows_.points) left.insert(point->id);
    for (const auto& keyframe : rows_.keyframes) {
      for (PointId& id : keyframe->points) {
        if (id && !left.contains(id)) id = PointId();
      }
    }
  }

  static KeyframeId MostTypical(PointId point, const std::vector<const map::Keyframe*>& observers) {
    std::vector<image::Descriptor> descriptors;
    for (const map::Keyframe* keyframe : observers) {
      const auto at = std::ranges::find(keyframe->points, point) - keyframe->points.begin();
      descriptors.push_back(keyframe->descriptors()[static_cast<std::size_t>(at)]);
    }
    return observers[map::MostTypicalDescriptor(&descriptors)]->id;
  }

  // The covisibility graph follows from the points, all of it.
  void CountSharedPoints() {
    std::unordered_map<PointId, std::vector<KeyframeId>> seen_by;
    for (const auto& keyframe : rows_.keyframes) {
      for (const PointId id : keyframe->points) {
        if (id) seen_by[id].push_back(keyframe->id);
      }
    }
    std::map<std::pair<KeyframeId, KeyframeId>, int> shared;
    for (const auto& [point, observers] : seen_by) {
      for (std::size_t i = 0; i < observers.size(); ++i) {
        for (std::size_t k = i + 1; k < observers.size(); ++k) ++shared[{observers[i], observers[k]}];
      }
    }
    rows_.edges.clear();
    for (const auto& [pair, count] : shared) {
      if (count >= map::kMinStoredSharedPoints) rows_.edges.push_back({pair.first, pair.second, count});
    }
  }

  // A keyframe whose parent is lost gets the one that it shares most with; without any, the nearest in time: all poses
  // of a component are in one frame, so that their places to each other are known however they are linked.
  void MendTrees() {
    std::unordered_map<KeyframeId, std::vector<EdgeRow>> edges_of;
    for (const EdgeRow& edge : rows_.edges) {
      edges_of[edge.a].push_back(edge);
      edges_of[edge.b].push_back({edge.b, edge.a, edge.shared_points});
    }
    std::map<ComponentId, std::vector<map::Keyframe*>> by_component;
    for (const auto& keyframe : rows_.keyframes) by_component[keyframe->component].push_back(keyframe.get());
    for (auto& [id, keyframes] : by_component) {
      const bool whole = std::ranges::all_of(keyframes, [&](const map::Keyframe* keyframe) {
        return !keyframe->parent || rows_.FindKeyframe(keyframe->parent.value()) != nullptr;
      });
      if (!whole) GrowTree(keyframes, edges_of);
    }
  }

  // The spanning tree of most shared points, from the first keyframe (Prim).
  void GrowTree(const std::vector<map::Keyframe*>& keyframes,
                const std::unordered_map<KeyframeId, std::vector<EdgeRow>>& edges_of) {
    std::set<KeyframeId> reached;
    std::set<std::pair<std::pair<int, std::uint32_t>, std::uint32_t>> waiting;  // fewest shared last: negated
    const auto reach = [&](map::Keyframe* keyframe, KeyframeId parent) {
      keyframe->parent = parent;
      reached.insert(keyframe->id);
      const auto edges = edges_of.find(keyframe->id);
      if (edges == edges_of.end()) return;
      for (const EdgeRow& edge : edges->second) {
        waiting.insert({{-edge.shared_points, edge.b.value()}, keyframe->id.value()});
      }
    };
    for (map::Keyframe* start : keyframes) {
      if (reached.contains(start->id)) continue;
      reach(start, reached.empty() ? KeyframeId() : Nearest(keyframes, reached, *start));
      while (!waiting.empty()) {
        const auto [order, from] = *waiting.begin();
        waiting.erase(waiting.begin());
        map::Keyframe* next = rows_.FindKeyframe(order.second);
        if (next != nullptr && !reached.contains(next->id)) reach(next, KeyframeId(from));
      }
    }
  }

  static KeyframeId Nearest(const std::vector<map::Keyframe*>& keyframes, const std::set<KeyframeId>& reached,
                            const map::Keyframe& from) {
    const map::Keyframe* nearest = nullptr;
    const auto distance = [&](const map::Keyframe& keyframe) {
      const bool other_session = keyframe.session != from.session;
      return std::pair(other_session, std::abs(keyframe.time_ns - from.time_ns));
    };
    for (const map::Keyframe* keyframe : keyframes) {
      if (!reached.contains(keyframe->id)) continue;
      if (nearest == nullptr || distance(*keyframe) < distance(*nearest)) nearest = keyframe;
    }
    return nearest->id;
  }

  void MendMapRow() {
    MapRow& row = rows_.map_row;
    row.keyframe_count = static_cast<std::int64_t>(rows_.keyframes.size());
    row.point_count = static_cast<std::int64_t>(rows_.points.size());
    row.covisibility_count = static_cast<std::int64_t>(rows_.edges.size());
    const auto beyond = [](auto next, const auto& entities, auto id_of) {
      for (const auto& entity : entities) next = std::max(next, decltype(next)(id_of(entity).value() + 1));
      return next;
    };
    const auto own = [](const auto& entity) { return entity.id; };
    const auto pointed = [](const auto& entity) { return entity->id; };
    row.next_keyframe = beyond(row.next_keyframe, rows_.keyframes, pointed);
    row.next_point = beyond(row.next_point, rows_.points, pointed);
    row.next_camera = beyond(row.next_camera, rows_.content.cameras, own);
    row.next_session = beyond(row.next_session, rows_.content.sessions, own);
    row.next_component = beyond(row.next_component, rows_.content.components, own);
  }

  MapRows& rows_;
  Mended mended_;
};

}  // namespace

absl::StatusOr<Mended> Mend(MapRows* rows) { return Mending(rows).Run(); }

}  // namespace cairn::store
