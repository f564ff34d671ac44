// A change in the making: reads fall through to the Snapshot it started from, writes stay here until Finish() turns
// them into a Delta. Mapping works on an Edit and keeps the links between entities true through it. One thread at a
// time, for reading as well.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "map/draft.h"
#include "map/snapshot.h"

namespace cairn::map {

class Edit {
 public:
  explicit Edit(std::shared_ptr<const Snapshot> base);

  const Snapshot& base() const { return *base_; }
  const MapInfo& info() const { return info_ ? *info_ : base_->info(); }

  // Null if it does not exist (or was erased here).
  const Keyframe* FindKeyframe(KeyframeId id) const { return keyframes_.Find(id); }
  const MapPoint* FindPoint(PointId id) const { return points_.Find(id); }
  // The entity must exist. References stay valid until the entity is erased or the Edit finishes; a reference from
  // before the first change of an entity keeps showing the old value.
  const Keyframe& keyframe(KeyframeId id) const { return *FindKeyframe(id); }
  const MapPoint& point(PointId id) const { return *FindPoint(id); }
  const MapCamera& camera(CameraId id) const;
  const Session& session(SessionId id) const;
  const Component& component(ComponentId id) const;
  const Pinhole& pinhole(CameraId id) const { return camera(id).pinhole; }
  KeyframeId next_keyframe() const { return next_keyframe_; }  // above every id

  void SetInfo(MapInfo info) { info_ = std::move(info); }
  CameraId AddCamera(MapCamera camera);     // gives the id
  void PutCamera(const MapCamera& camera);  // replaces an existing one
  SessionId AddSession(Session session);    // gives the id
  void PutSession(const Session& session);  // replaces an existing one

  ComponentId AddComponent(Component component);  // gives the id
  void PutComponent(const Component& component);  // replaces an existing one
  // Notes who makes the change.
  void SetSession(SessionId session) { session_ = session; }

  // Moves every keyframe and point of a component by join.into_from_component and makes them part of join.into, in
  // whose tree the root of theirs hangs from then on: join.keyframe becomes it, below join.into_keyframe, both of which
  // must exist. If only the one that goes is aligned, the other is aligned by it. O(map).
  void JoinComponent(ComponentId component, const ComponentJoin& join);

  // Gives the id. Features must be set; points is sized here and links are made with AddObservation. Without a
  // component it goes to the first one of the map, which is made if there is none.
  KeyframeId AddKeyframe(Keyframe keyframe);
  // Gives the id. A point without observations is dropped by Finish().
  PointId AddPoint(const Vector3d& position);

  // False, and nothing changes, if the keyframe already observes the point or the feature already has a point.
  bool AddObservation(PointId point, KeyframeId keyframe, std::uint32_t feature);
  // Erases the point when fewer than `min_observations` would be left.
  void RemoveObservation(PointId point, KeyframeId keyframe, int min_observations = 2);
  void ErasePoint(PointId id);
  // Makes `parent` the parent of a new keyframe, should Finish() find none that shares points with it: a map that goes
  // on after a loss stays one tree. `parent` must be older.
  void LinkIfAlone(KeyframeId keyframe, KeyframeId parent) { link_if_alone_[keyframe] = parent; }
  // Unlinks its points and hands its children to other parents. The root of a spanning tree cannot be erased (returns
  // false).
  bool EraseKeyframe(KeyframeId id, int min_observations = 2);
  // Turns the spanning tree of a keyframe about, so that it becomes the root.
  void MakeRoot(KeyframeId id);
  // All keyframes and points of a component, and its row, unless other components are part of its history. O(map).
  void EraseComponent(ComponentId id);
  // Moves the observations of `from` to `into` where `into` has none, and erases `from`.
  void FusePoints(PointId from, PointId into);

  void SetPose(KeyframeId id, const SE3& camera_from_map);
  // As many as before, in the same order; descriptors and words stay.
  void SetKeypoints(KeyframeId id, std::vector<image::Keypoint> keypoints);
  void SetPosition(PointId id, const Vector3d& position);
  void AddVisibility(PointId id, int visible, int found);

  // Brings the covisibility edges of a keyframe up to date now; Finish() does it for all that changed.
  void UpdateCovisibility(KeyframeId id);
  // Likewise the derived fields of a point.
  void UpdatePoint(PointId id);

  // Every keyframe and point touched so far, ascending.
  std::vector<KeyframeId> ChangedKeyframes() const;

  // The change as a Delta; the Edit is then empty and must not be used.
  Delta Finish(std::string reason);

 private:
  // Which of a point's derived fields are out of date.
  // Only distances and direction, or the reference as well.
  enum class Stale : std::uint8_t { kNo, kViewing, kAll };
  // Of cameras, by id, filled as they are needed; poses must not change while it is in use.
  using Centers = std::vector<std::optional<Vector3d>>;

  Keyframe& MutableKeyframe(KeyframeId id) { return keyframes_.Mutable(id); }
  MapPoint& MutablePoint(PointId id) { return points_.Mutable(id); }
  void MarkStale(PointId id, Stale stale);
  void Refresh(PointId id, Stale stale, Centers* centers);
  void SetEdge(KeyframeId from, KeyframeId to, int shared_points);
  void SetParent(KeyframeId child, KeyframeId parent);
  void AdoptChildren(const Keyframe& orphaned);
  std::vector<KeyframeId> KeyframesOf(ComponentId id) const;

  std::shared_ptr<const Snapshot> base_;
  std::optional<MapInfo> info_;
  std::map<CameraId, MapCamera> cameras_;
  std::map<SessionId, Session> sessions_;
  std::map<ComponentId, Component> components_;
  std::set<ComponentId> removed_components_;
  SessionId session_;
  Draft<KeyframeId, Keyframe> keyframes_;
  Draft<PointId, MapPoint> points_;  // marked with their Stale
  std::set<KeyframeId> moved_keypoints_;
  std::set<KeyframeId> stale_covisibility_;
  std::vector<int> shared_;            // of UpdateCovisibility()
  std::vector<PointId> stale_points_;  // once marked so
  // Of Refresh(); keep their memory.
  std::vector<image::Descriptor> descriptors_;
  std::vector<Vector3d> seen_from_;
  std::unordered_map<KeyframeId, KeyframeId> link_if_alone_;
  KeyframeId next_keyframe_;
  PointId next_point_;
  CameraId next_camera_;
  SessionId next_session_;
  ComponentId next_component_;
};

}  // namespace cairn::map
