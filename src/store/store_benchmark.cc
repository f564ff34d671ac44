// What a commit costs, and what a reader pays to follow it.
#include <benchmark/benchmark.h>

#include "store/sqlite_map_store.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::MapGrower;
using testing::TempFolder;
using testing::TestInfo;
using SnapshotPtr = std::shared_ptr<const map::Snapshot>;

// A map in memory, and in a file on a file system in memory: the disk's own time is another matter.
struct World {
  TempFolder folder;
  std::string path = folder.File("a.cairn");
  MapGrower grower{14, {.features = 1000, .new_points = 110}};
  std::unique_ptr<SqliteMapStore> store = *SqliteMapStore::Create(path, TestInfo());
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());

  explicit World(int keyframes) {
    Change(grower.Start(map));
    for (int i = 0; i < keyframes; ++i) Change(grower.AddKeyframe(map));
  }
  void Change(const map::Delta& delta) {
    map = *map->Apply(delta);
    if (!store->Commit(delta).ok()) std::abort();
  }
};

// 20 keyframes move, and the 2000 points that they see: a local bundle adjustment.
void CommitAdjustment(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  std::size_t points = 0;
  for (auto _ : state) {
    state.PauseTiming();
    const map::Delta delta = world.grower.Adjust(world.map, 20);
    points = delta.points.size();
    world.map = *world.map->Apply(delta);
    state.ResumeTiming();
    if (!world.store->Commit(delta).ok()) state.SkipWithError("commit");
  }
  state.counters["points"] = static_cast<double>(points);
}
BENCHMARK(CommitAdjustment)->Arg(40)->Arg(400)->Unit(benchmark::kMillisecond)->Iterations(100);

void CommitKeyframe(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    state.PauseTiming();
    const map::Delta delta = world.grower.AddKeyframe(world.map);
    world.map = *world.map->Apply(delta);
    state.ResumeTiming();
    if (!world.store->Commit(delta).ok()) state.SkipWithError("commit");
  }
}
BENCHMARK(CommitKeyframe)->Arg(40)->Arg(400)->Unit(benchmark::kMillisecond)->Iterations(100);

// A reader in another connection takes over one keyframe's insertion.
void FollowKeyframe(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  const auto reader = *SqliteMapStore::OpenReadOnly(world.path);
  SnapshotPtr seen = *reader->LoadSnapshot();
  for (auto _ : state) {
    state.PauseTiming();
    world.Change(world.grower.AddKeyframe(world.map));
    state.ResumeTiming();
    const auto delta = reader->ReadDelta(*seen);
    if (!delta.ok() || !*delta) {
      state.SkipWithError("read");
    } else {
      seen = *seen->Apply(**delta);
    }
  }
}
BENCHMARK(FollowKeyframe)->Arg(40)->Arg(400)->Arg(2000)->Unit(benchmark::kMillisecond)->Iterations(50);

void Load(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(world.store->LoadSnapshot());
}
BENCHMARK(Load)->Arg(40)->Arg(400)->Unit(benchmark::kMillisecond)->Iterations(5);

}  // namespace
}  // namespace cairn::store
