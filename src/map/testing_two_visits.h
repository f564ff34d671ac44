// Two sessions in one room, and a third in a component of its own, for tests of what is done to whole sessions.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "map/edit.h"
#include "map/testing_map.h"

namespace cairn::map::testing {

struct TwoVisits {
  std::shared_ptr<const Snapshot> map;
  SessionId first, second, apart;
  ComponentId shared, alone;
};

// Views 0, 2, 4, ... are the first session's, the others the second's; view 0 is the root. The third session has made
// the same room again, aside. The shared component is aligned to the world.
inline TwoVisits MakeTwoVisits(std::size_t num_views = 10, std::size_t num_points = 600, double noise_px = 0.5) {
  TestMap world = MakeWorld(31, num_views, num_points);
  Random random(32);
  Edit edit(world.snapshot);
  TwoVisits visits;
  visits.first = world.session;
  Session another = edit.session(world.session);
  visits.second = edit.AddSession(another);
  visits.apart = edit.AddSession(another);
  visits.shared = edit.AddComponent({.id = {}, .session = visits.first});
  visits.alone = edit.AddComponent({.id = {}, .session = visits.apart});
  Component aligned = edit.component(visits.shared);
  aligned.world_from_component = Sim3(ExpSO3(Vector3d(0.1, 0.2, 0.3)), Vector3d(1.0, 2.0, 3.0), 2.0);
  edit.PutComponent(aligned);
  const auto add = [&](bool apart) {
    std::vector<std::vector<Observation>> seen(num_points);
    for (std::size_t view = 0; view < num_views; ++view) {
      std::vector<std::size_t> visible;
      Keyframe keyframe = MakeKeyframe(world, view, noise_px, random, &visible);
      keyframe.session = apart ? visits.apart : view % 2 == 0 ? visits.first : visits.second;
      keyframe.component = apart ? visits.alone : visits.shared;
      const KeyframeId id = edit.AddKeyframe(std::move(keyframe));
      for (std::uint32_t i = 0; i < visible.size(); ++i) seen[visible[i]].push_back({id, i});
    }
    for (std::size_t i = 0; i < num_points; ++i) {
      if (seen[i].size() < 2) continue;
      const PointId point = edit.AddPoint(world.truth[i]);
      for (const Observation& o : seen[i]) edit.AddObservation(point, o.keyframe, o.feature);
    }
  };
  add(false);
  add(true);
  const auto map = world.snapshot->Apply(edit.Finish("two visits, and one apart"));
  visits.map = map.ok() ? *map : nullptr;
  return visits;
}

}  // namespace cairn::map::testing
