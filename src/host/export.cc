#include "host/export.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <vector>

#include "inspect/measures.h"
#include "io/ply.h"
#include "io/trajectory.h"
#include "map/snapshot.h"
#include "store/map_store.h"

namespace cairn::host {
namespace {

constexpr std::size_t kPartBytes = 1 << 20;

// What can be shown in one frame.
struct ExportFrame {
  std::vector<ComponentId> components;
  bool world = false;

  bool Has(ComponentId id) const { return std::ranges::find(components, id) != components.end(); }
};

ExportFrame ExportFrameOf(const map::Snapshot& map) {
  ExportFrame frame;
  frame.components = inspect::TogetherInOneFrame(map);
  frame.world = !frame.components.empty() && map.WorldFrom(frame.components[0]).has_value();
  return frame;
}

Sim3 OutFrom(const map::Snapshot& map, ComponentId component) { return map.WorldFrom(component).value_or(Sim3()); }

// What stands at the head of the files.
std::string Comment(const char* what, const map::Snapshot& map, const ExportFrame& frame) {
  const std::string without = inspect::LeftOutBesides(map, frame.components).Text();
  return absl::StrCat(what, " of map ", map.info().name, ", revision ", map.revision(), without.empty() ? "" : ", ",
                      without, frame.world ? ", frame world, metres" : ", frame of the largest component, map units");
}

absl::Status WriteTrajectory(const map::Snapshot& map, const std::string& path) {
  const ExportFrame frame = ExportFrameOf(map);
  std::vector<io::StampedPose> poses;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!frame.Has(keyframe->component)) return;
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
    if (!frame.Has(component)) return;
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
