#include "cli/bench_adjustment.h"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_format.h"
#include "base/guarded.h"
#include "base/sample_reservoir.h"
#include "cli/process_memory.h"
#include "cli/sample_statistics.h"
#include "engine/live_map.h"
#include "map/edit.h"
#include "mapping/full_adjustment.h"
#include "mapping/stopwatch.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

constexpr double kMove = 1e-6;  // of every keyframe and point, map units
constexpr auto kReadEvery = std::chrono::milliseconds(20);
constexpr auto kEditEvery = std::chrono::milliseconds(100);  // as often as a session inserts a keyframe

struct BenchAdjustmentOptions {
  std::string map;
  std::string copy;
  std::size_t points_per_part = mapping::AdjustmentMerge::kPointsPerPart;
  bool json = false;
};

struct Result {
  std::size_t keyframes = 0, points = 0, parts = 0;
  double elapsed_s = 0.0;
  double log_mb = 0.0;  // at its largest
  SampleReservoir made_ms, editor_ms, reader_ms;
};

// Every keyframe and point a little aside.
mapping::FullAdjustment Adjustment(const map::Snapshot& map) {
  mapping::FullAdjustment adjustment;
  const Vector3d move(kMove, -kMove, kMove);
  map.keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    const SE3& pose = keyframe->camera_from_map;
    adjustment.camera_from_map[keyframe->id] = SE3(pose.rotation(), pose.translation() + move);
  });
  map.points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    adjustment.positions[point->id] = point->position + move;
  });
  return adjustment;
}

// Somebody else who changes the map, a point at a time: how long it takes until that is durable.
absl::Status EditOften(engine::LiveMap* live, const std::atomic<bool>* stop, SampleReservoir* ms) {
  PointId some;
  live->Published()->map().points().ForEach(
      [&](const std::shared_ptr<const map::MapPoint>& point) { some = point->id; });
  while (!*stop) {
    mapping::Stopwatch watch;
    {
      engine::LiveMap::Editor editor = live->BeginEdit();
      map::Edit edit(editor.View()->snapshot());
      edit.SetPosition(some, edit.point(some).position + Vector3d(kMove, 0.0, 0.0));
      CAIRN_RETURN_IF_ERROR(editor.Commit(edit.Finish("move a point"), {}));
    }
    CAIRN_RETURN_IF_ERROR(live->Flush());
    ms->Add(static_cast<float>(watch.LapMs()));
    std::this_thread::sleep_for(kEditEvery);
  }
  return absl::OkStatus();
}

// Somebody who only reads: how long it takes to ask the file for its revision.
absl::Status ReadOften(const std::string& path, const std::atomic<bool>* stop, SampleReservoir* ms, double* log_mb) {
  CAIRN_ASSIGN_OR_RETURN(const auto store, store::OpenMapStore(path, store::OpenMode::kRead));
  while (!*stop) {
    mapping::Stopwatch watch;
    CAIRN_RETURN_IF_ERROR(store->ReadSummary().status());
    ms->Add(static_cast<float>(watch.LapMs()));
    std::error_code none;
    const auto bytes = std::filesystem::file_size(path + "-wal", none);
    if (!none) *log_mb = std::max(*log_mb, 1e-6 * static_cast<double>(bytes));
    std::this_thread::sleep_for(kReadEvery);
  }
  return absl::OkStatus();
}

absl::Status MergeInParts(engine::LiveMap* live, mapping::FullAdjustment adjustment, std::size_t points_per_part,
                          Result* result) {
  mapping::AdjustmentMerge merge(std::move(adjustment));
  while (!merge.done()) {
    engine::LiveMap::Editor editor = live->BeginEdit();
    mapping::Stopwatch watch;
    map::Edit edit(editor.View()->snapshot());
    merge.MergeNext(edit, points_per_part);
    CAIRN_RETURN_IF_ERROR(editor.Commit(edit.Finish("full bundle adjustment"), {}));
    result->made_ms.Add(static_cast<float>(watch.LapMs()));
    ++result->parts;
  }
  return live->Flush();
}

// In the copy.
absl::StatusOr<Result> Run(const BenchAdjustmentOptions& options) {
  std::unique_ptr<engine::LiveMap> live;
  CAIRN_ASSIGN_OR_RETURN(live, engine::LiveMap::Open(options.copy, {.ready = false}));
  CAIRN_RETURN_IF_ERROR(live->StoreInBackground());
  const std::shared_ptr<const map::Snapshot> map = live->Published()->snapshot();
  Result result;
  result.keyframes = map->keyframes().size();
  result.points = map->points().size();
  mapping::FullAdjustment adjustment = Adjustment(*map);

  std::atomic<bool> stop = false;
  absl::Status edited, read;
  std::thread editor([&] { edited = Guarded([&] { return EditOften(live.get(), &stop, &result.editor_ms); }); });
  std::thread reader(
      [&] { read = Guarded([&] { return ReadOften(options.copy, &stop, &result.reader_ms, &result.log_mb); }); });
  mapping::Stopwatch watch;
  const absl::Status merged =
      Guarded([&] { return MergeInParts(live.get(), std::move(adjustment), options.points_per_part, &result); });
  result.elapsed_s = 1e-3 * watch.LapMs();
  stop = true;
  editor.join();
  reader.join();
  CAIRN_RETURN_IF_ERROR(merged);
  CAIRN_RETURN_IF_ERROR(edited);
  CAIRN_RETURN_IF_ERROR(read);
  CAIRN_RETURN_IF_ERROR(live->Close());
  return result;
}

absl::Status BenchAdjustment(const BenchAdjustmentOptions& options) {
  {
    CAIRN_ASSIGN_OR_RETURN(const auto from, store::OpenMapStore(options.map, store::OpenMode::kRead));
    CAIRN_RETURN_IF_ERROR(from->CopyTo(options.copy));
  }
  const absl::StatusOr<Result> result = Run(options);
  std::error_code none;
  std::filesystem::remove(options.copy, none);
  CAIRN_RETURN_IF_ERROR(result.status());
  if (options.json) {
    PrintJson({{"keyframes", result->keyframes},
               {"points", result->points},
               {"parts", result->parts},
               {"elapsed_s", result->elapsed_s},
               {"log_mb", result->log_mb},
               {"part_ms", SampleStatistics(result->made_ms)},
               {"other_editor_ms", SampleStatistics(result->editor_ms)},
               {"reader_ms", SampleStatistics(result->reader_ms)},
               {"peak_memory_mb", PeakMemoryMb()}});
    return absl::OkStatus();
  }
  std::printf("%zu keyframes and %zu points moved in %.2f s, %zu parts; log at most %.1f MB\n", result->keyframes,
              result->points, result->elapsed_s, result->parts, result->log_mb);
  std::printf("  ms (median, 99 %%, largest)\n");
  const auto print = [](const char* what, const SampleReservoir& ms) {
    std::printf("    %-34s %8.1f %8.1f %8.1f\n", what, ms.Percentile(0.5), ms.Percentile(0.99), ms.max());
  };
  print("a part, in the turn of its editor", result->made_ms);
  print("a change of another editor", result->editor_ms);
  print("a reader's summary", result->reader_ms);
  return absl::OkStatus();
}

}  // namespace

void AddBenchAdjustmentCommand(CLI::App* bench, Action* action) {
  CLI::App* verb =
      bench->add_subcommand("adjustment", "A map: storing an adjustment of all of it, and who waits meanwhile");
  auto options = std::make_shared<BenchAdjustmentOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn); it stays as it is")->required();
  verb->add_option("--copy", options->copy, "File of the copy that is changed, and removed at the end; must not exist")
      ->required();
  verb->add_option("--points-per-part", options->points_per_part, "Points that move in one change")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Every keyframe and point is moved by a millionth of the map's unit, while another thread\n"
      "changes a point now and then and a third reads the file.\n"
      "Example:\n"
      "  cairn bench adjustment office.cairn --copy /var/tmp/copy.cairn");
  verb->callback([=] {
    *action = [=] {
      const absl::Status status = BenchAdjustment(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("bench", status, options->json);
    };
  });
}

}  // namespace cairn::cli
