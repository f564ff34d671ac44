#include "host/export.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <set>
#include <vector>

#include "io/ply.h"
#include "io/trajectory.h"
#include "map/snapshot.h"
#include "store/map_store.h"

namespace cairn::host {
namespace {

constexpr std::size_t kPartBytes = 1 << 20;

// What can be shown in one frame: all aligned components in the world, or the largest one in its own.
struct ExportFrame {
  std::set<ComponentId> components;
  bool world = false;
};

ExportFrame ExportFrameOf(const map::Snapshot& map) {
  ExportFrame frame;
  ComponentId largest;
  for (const ComponentId id : map.LiveComponents()) {
    if (map.WorldFrom(id)) frame.components.insert(id);
    if (!largest || map.NumKeyframes(id) > map.NumKeyframes(largest)) largest = id;
  }
  frame.world = !frame.components.empty();
  if (!frame.world && largest) frame.components = {largest};
  return frame;
}

Sim3 OutFrom(const map::Snapshot& map, ComponentId component) { return map.WorldFrom(component).value_or(Sim3()); }

// ", without 9 keyframes of 2 components in other frames"; empty: all are in this one.
std::string LeftOut(const map::Snapshot& map, const ExportFrame& frame) {
  int components = 0;
  std::int64_t keyframes = 0;
  for (const ComponentId id : map.LiveComponents()) {
    if (frame.components.contains(id) || map.NumKeyframes(id) == 0) continue;
    ++components;
    keyframes += static_cast<std::int64_t>(map.NumKeyframes(id));
  }
  return components == 0
             ? ""
             : absl::StrCat(", without ", keyframes, " keyframes of ", components,
                            components == 1 ? " component in another frame" : " components in other frames");
}

// What stands at the head of the files.
std::string Comment(const char* what, const map::Snapshot& map, const ExportFrame& frame) {
  return absl::StrCat(what, " of map ", map.info().name, ", revision ", map.revision(), LeftOut(map, frame),
                      frame.world ? ", frame world, metres" : ", frame of the largest component, map units");
}

absl::Status WriteTrajectory(const map::Snapshot& map, const std::string& path) {
  const ExportFrame frame = ExportFrameOf(map);
  std::vector<io::StampedPose> poses;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!frame.components.contains(keyframe->component)) return;
    poses.push_back(
        {keyframe->time_ns, OutFrom(map, keyframe->component).TransformPose(keyframe->camera_from_map.Inverse())});
  });
  if (poses.empty()) return absl::FailedPreconditionError("the map has no keyframes");
  std::ranges::stable_sort(poses, {}, &io::StampedPose::time_ns);
  io::TrajectoryWriteOptions options;
  options.comment = Comment("keyframes", map, frame);
  return io::WriteTumTrajectory(path, poses, options);
}

absl::Status WritePoints(const map::Snapshot& map, const std::string& path) {
  const ExportFrame frame = ExportFrameOf(map);
  std::vector<io::ColoredPoint> points;
  map.points().ForEach([&](const auto& point) {
    const ComponentId component = map.keyframe(point->reference.keyframe).component;
    if (!frame.components.contains(component)) return;
    points.push_back({OutFrom(map, component) * point->position});
  });
  if (points.empty()) return absl::FailedPreconditionError("the map has no points");
  return io::WritePly(path, points, /*overwrite=*/false, Comment("points", map, frame));
}

absl::Status SendFile(std::ifstream* file, const api::ExportSink& sink) {
  std::vector<char> part(kPartBytes);
  while (file->read(part.data(), static_cast<std::streamsize>(part.size())), file->gcount() > 0) {
    CAIRN_RETURN_IF_ERROR(sink(absl::string_view(part.data(), static_cast<std::size_t>(file->gcount()))));
  }
  return file->bad() ? absl::InternalError("what was exported could not be read back") : absl::OkStatus();
}

}  // namespace

absl::Status ExportMap(const std::string& uri, api::ExportContent content, const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(uri, store::OpenMode::kRead));
  if (content == api::ExportContent::kMap) return store->CopyTo(path);
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, store->LoadSnapshot());
  if (map->keyframes().empty()) return absl::FailedPreconditionError(absl::StrCat(uri, " has no keyframes"));
  return content == api::ExportContent::kTrajectory ? WriteTrajectory(*map, path) : WritePoints(*map, path);
}

absl::Status ExportMapTo(const std::string& uri, api::ExportContent content, const std::string& scratch,
                         const api::ExportSink& sink) {
  std::error_code ignored;
  const absl::Status written = ExportMap(uri, content, scratch);
  std::ifstream file(scratch, std::ios::binary);
  std::filesystem::remove(scratch, ignored);  // it lives on as long as it is open
  CAIRN_RETURN_IF_ERROR(written);
  if (!file) return absl::InternalError("what was exported is gone");
  return SendFile(&file, sink);
}

}  // namespace cairn::host
