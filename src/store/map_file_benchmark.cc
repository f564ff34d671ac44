// What a change costs a map file, and what loading one takes.
#include <benchmark/benchmark.h>

#include "map/delta.h"
#include "store/map_file.h"
#include "store/test_maps.h"

namespace cairn::store {
namespace {

constexpr int kKeyframes = 40;

// A map of keyframes as a run makes them, in memory and in the file.
struct Map {
  const testing::TempFolder folder{/*on_disk=*/true};
  testing::MapGrower grower{14, {.features = 1000, .new_points = 110}};
  std::unique_ptr<MapFile> file = *MapFile::Create(folder.File("a.cairn"), testing::TestInfo());
  std::shared_ptr<const map::Snapshot> snapshot = map::Snapshot::Empty(testing::TestInfo());

  Map() {
    Change(grower.Start(snapshot));
    for (int i = 0; i < kKeyframes; ++i) Change(grower.AddKeyframe(snapshot));
  }
  void Change(const map::Delta& delta) {
    snapshot = *snapshot->Apply(delta);
    if (!file->Commit(delta).ok()) std::abort();
  }
};

// The adjustment of 20 keyframes and the points that they see.
void CommitAdjustment(benchmark::State& state) {
  Map map;
  std::size_t points = 0;
  for (auto unused : state) {
    state.PauseTiming();
    const map::Delta delta = map.grower.Adjust(map.snapshot, 20);
    points = delta.points.size();
    state.ResumeTiming();
    const absl::Status status = map.file->Commit(delta);
    state.PauseTiming();
    if (!status.ok()) state.SkipWithError(std::string(status.message()).c_str());
    map.snapshot = *map.snapshot->Apply(delta);
    state.ResumeTiming();
  }
  state.counters["points"] = static_cast<double>(points);
}
BENCHMARK(CommitAdjustment)->Unit(benchmark::kMillisecond);

void LoadSnapshot(benchmark::State& state) {
  Map map;
  for (auto unused : state) {
    const auto loaded = map.file->LoadSnapshot();
    if (!loaded.ok()) state.SkipWithError(std::string(loaded.status().message()).c_str());
  }
}
BENCHMARK(LoadSnapshot)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace cairn::store
