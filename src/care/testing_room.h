// A room of points with a map of it, for tests of what keeps maps: without images.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tracking/map_view.h"
#include "tracking/testing_world.h"

namespace cairn::care::testing {

struct Room {
  tracking::testing_world::World world;
  std::shared_ptr<const place::Vocabulary> words;

  explicit Room(std::uint64_t seed, int points = 4000) {
    Random random(seed);
    tracking::testing_world::AddRoom(Vector3d::Zero(), points, random, &world);
    words = tracking::testing_world::TrainVocabulary(world);
  }
  // Keyframes along the room, seen with noise of their own.
  std::shared_ptr<const map::Snapshot> Map(int keyframes, std::uint64_t noise) const {
    return Map(tracking::testing_world::PathInRoom(Vector3d::Zero(), keyframes), noise);
  }
  std::shared_ptr<const map::Snapshot> Map(const std::vector<SE3>& poses, std::uint64_t noise) const {
    Random random(noise);
    return tracking::testing_world::BuildMap(world, poses, *words, {}, random);
  }
  std::shared_ptr<const tracking::MapView> View(const std::shared_ptr<const map::Snapshot>& map) const {
    return *tracking::MapView::Create(map, words);
  }
};

// The same map in another frame.
inline std::shared_ptr<const map::Snapshot> Moved(const std::shared_ptr<const map::Snapshot>& map, const Sim3& to) {
  map::Edit edit(map);
  map->keyframes().ForEach([&](const auto& keyframe) {
    edit.SetPose(keyframe->id, to.TransformPose(keyframe->camera_from_map.Inverse()).Inverse());
  });
  map->points().ForEach([&](const auto& point) { edit.SetPosition(point->id, to * point->position); });
  return *map->Apply(edit.Finish("moved"));
}

}  // namespace cairn::care::testing
