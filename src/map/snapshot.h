// One revision of a map, immutable, shared by any number of readers without locks.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "map/entities.h"
#include "map/entity_source.h"
#include "map/table.h"

namespace cairn::map {

// Edges of fewer shared points are not kept in the graph at all.
inline constexpr int kMinStoredSharedPoints = 8;
// From how many shared points two keyframes count as covisible, and as linked in the essential graph (DESIGN: 15, 100).
inline constexpr int kMinCovisiblePoints = 15;
inline constexpr int kMinEssentialPoints = 100;

// A revision whose keyframes and points come from a source when somebody looks at them.
struct SnapshotParts {
  Revision revision = 0;
  MapInfo info;
  std::vector<MapCamera> cameras;
  std::vector<Session> sessions;
  std::vector<Component> components;
  std::map<ComponentId, std::int64_t> num_keyframes;  // of those that have any
  std::shared_ptr<const EntitySource> entities;
  std::shared_ptr<FeatureCache> feature_cache;
  KeyframeId next_keyframe{1};
  PointId next_point{1};
  CameraId next_camera{1};
  SessionId next_session{1};
  ComponentId next_component{1};
};

class Snapshot {
 public:
  // An empty map, at revision 0 unless a map that has a history is being read back.
  static std::shared_ptr<const Snapshot> Empty(MapInfo info, Revision revision = 0);

  // Of parts that were a good map when they were written: nothing is looked at, and nothing is checked.
  static std::shared_ptr<const Snapshot> Of(SnapshotParts parts);

  // The map after `delta`. O(size of the delta). Errors: FailedPrecondition if delta.base is not this revision,
  // InvalidArgument if the map after it would not be a good one (map/delta_check.h): every change of a map, from
  // whomever it comes, passes here. This snapshot is as it was.
  absl::StatusOr<std::shared_ptr<const Snapshot>> Apply(const Delta& delta) const;

  Revision revision() const { return revision_; }
  const MapInfo& info() const { return *info_; }
  const std::map<CameraId, MapCamera>& cameras() const { return *cameras_; }
  const std::map<SessionId, Session>& sessions() const { return *sessions_; }
  const std::map<ComponentId, Component>& components() const { return *components_; }
  const Table<KeyframeId, Keyframe>& keyframes() const { return keyframes_; }
  const Table<PointId, MapPoint>& points() const { return points_; }
  KeyframeId next_keyframe() const { return next_keyframe_; }
  PointId next_point() const { return next_point_; }
  CameraId next_camera() const { return next_camera_; }
  SessionId next_session() const { return next_session_; }
  ComponentId next_component() const { return next_component_; }

  // The entity must exist.
  const Keyframe& keyframe(KeyframeId id) const { return *keyframes_.Find(id); }
  const MapPoint& point(PointId id) const { return *points_.Find(id); }
  const Pinhole& pinhole(CameraId id) const { return cameras_->at(id).pinhole; }
  const Component& component(ComponentId id) const { return components_->at(id); }

  // Keyframes in a component; 0 for one that was joined to another, or does not exist.
  std::int64_t NumKeyframes(ComponentId id) const;
  // Those with keyframes, ascending.
  std::vector<ComponentId> LiveComponents() const;
  // The component that one has become by joins; itself if it has not been joined. None if it never existed.
  ComponentId Resolve(ComponentId id) const;
  // The similarity to the world of a component, if it is aligned.
  const std::optional<Sim3>& WorldFrom(ComponentId id) const { return component(id).world_from_component; }

  // The same revision, whose keyframes' features come from `cache`.
  std::shared_ptr<const Snapshot> With(std::shared_ptr<FeatureCache> cache) const;
  // Null: all features are in memory. Who answers questions about the map says so if its status is not OK.
  const std::shared_ptr<FeatureCache>& feature_cache() const { return feature_cache_; }

  // Null: all keyframes and points are in memory.
  const std::shared_ptr<const EntitySource>& entities() const { return entities_; }
  // The same revision, of whose keyframes and points in the source none was looked at yet.
  std::shared_ptr<const Snapshot> Anew() const;

  // Every reference resolves both ways: observations, parents and children, covisibility. O(map); for tests, `verify`
  // and after loading.
  absl::Status CheckConsistency() const;

 private:
  Revision revision_ = 0;
  std::shared_ptr<const MapInfo> info_;
  std::shared_ptr<const std::map<CameraId, MapCamera>> cameras_;
  std::shared_ptr<const std::map<SessionId, Session>> sessions_;
  std::shared_ptr<const std::map<ComponentId, Component>> components_;
  std::shared_ptr<const std::map<ComponentId, std::int64_t>> num_keyframes_;  // of those that have any
  Table<KeyframeId, Keyframe> keyframes_;
  Table<PointId, MapPoint> points_;
  std::shared_ptr<const EntitySource> entities_;
  std::shared_ptr<FeatureCache> feature_cache_;
  KeyframeId next_keyframe_{1};
  PointId next_point_{1};
  CameraId next_camera_{1};
  SessionId next_session_{1};
  ComponentId next_component_{1};
};

// Visits all keyframes, ascending, each with a snapshot of the same revision to look around in: of what is looked at in
// a source, about `budget_bytes` stay in memory. Both are for the time of the visit.
void ForEachKeyframe(const Snapshot& map, std::size_t budget_bytes,
                     const std::function<void(const Snapshot& map, const Keyframe& keyframe)>& visit);

// The covisible keyframes with at least `min_shared` points in common, best first, at most `max_count` (0: all). If
// none reaches `min_shared`, the best one there is.
std::vector<KeyframeId> BestCovisible(const Keyframe& keyframe, int max_count = 0,
                                      int min_shared = kMinCovisiblePoints);

}  // namespace cairn::map
