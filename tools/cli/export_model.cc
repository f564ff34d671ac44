#include "cli/export_model.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "base/files.h"
#include "cli/cli.h"
#include "cli/map_to_read.h"
#include "exchange/colmap.h"
#include "exchange/formats.h"
#include "exchange/model_images.h"
#include "io/ply.h"
#include "io/trajectory.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

using exchange::Reconstruction;

struct Source {
  const map::Snapshot& map;
  const Reconstruction& model;
  const ModelExport& options;
};

// What stands at the head of files that have room for it, as host/export.cc words it.
std::string Comment(const char* what, const Source& source) {
  const Reconstruction& model = source.model;
  const std::string without = model.left_out.Text();
  const std::string frame = model.metric ? ", frame world, metres" : ", frame of the component, map units";
  return absl::StrCat(what, " of map ", source.map.info().name, ", revision ", source.map.revision(),
                      without.empty() ? "" : ", ", without, frame);
}

std::string TimesBeside(const std::string& kitti) {
  return (std::filesystem::path(kitti).parent_path() / "times.txt").string();
}

absl::Status WriteText(const ModelExport& options, const std::string& text) {
  return WriteFileAtomically(options.out, text, options.overwrite);
}

absl::Status WriteKitti(const Source& source) {
  const auto poses = exchange::Trajectory(source.model);
  CAIRN_RETURN_IF_ERROR(WriteText(source.options, exchange::KittiText(poses)));
  return WriteFileAtomically(TimesBeside(source.options.out), exchange::KittiTimesText(poses),
                             source.options.overwrite);
}

absl::Status WritePoints(const Source& source) {
  std::vector<io::ColoredPoint> points;
  for (const exchange::ModelPoint& point : source.model.points) {
    points.push_back({point.position, point.red, point.green, point.blue});
  }
  return io::WritePly(source.options.out, points, source.options.overwrite, Comment("points", source));
}

absl::Status WriteNerfstudio(const Source& source) {
  std::error_code error;
  std::filesystem::create_directories(source.options.out, error);
  return WriteFileAtomically(absl::StrCat(source.options.out, "/transforms.json"),
                             exchange::TransformsJson(source.model), source.options.overwrite);
}

using Writer = std::function<absl::Status(const Source&)>;
const std::map<std::string, Writer>& Writers() {
  static const auto* writers = new std::map<std::string, Writer>{
      {"colmap",
       [](const Source& s) {
         return exchange::WriteColmap(s.model, s.options.out, exchange::ColmapFormat::kBinary, s.options.overwrite);
       }},
      {"colmap-text",
       [](const Source& s) {
         return exchange::WriteColmap(s.model, s.options.out, exchange::ColmapFormat::kText, s.options.overwrite);
       }},
      {"nerfstudio", WriteNerfstudio},
      {"tum",
       [](const Source& s) {
         return WriteText(s.options, io::FormatTumTrajectory(exchange::Trajectory(s.model), Comment("keyframes", s)));
       }},
      {"kitti", WriteKitti},
      {"euroc",
       [](const Source& s) { return WriteText(s.options, exchange::EurocText(exchange::Trajectory(s.model))); }},
      {"g2o", [](const Source& s) { return WriteText(s.options, exchange::G2oText(s.model, s.map)); }},
      {"ply", WritePoints},
      {"json", [](const Source& s) { return WriteText(s.options, exchange::ModelJson(s.model, s.map)); }}};
  return *writers;
}

bool MakesFolder(const std::string& format) { return absl::StartsWith(format, "colmap") || format == "nerfstudio"; }

// The images of the keyframes, and gray values for the points; how many images there were.
absl::StatusOr<std::size_t> AddImages(const ModelExport& options, const map::Snapshot& map, Reconstruction* model) {
  InputOptions input;
  input.sequence = options.images;
  input.open.camera_path = options.camera;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenInput(input, "export"));
  const std::string folder = MakesFolder(options.format) ? absl::StrCat(options.out, "/images") : "";
  CAIRN_ASSIGN_OR_RETURN(exchange::ModelImages images,
                         exchange::ModelImages::Create(map, *model, source->info().name, folder, options.overwrite));
  SkippedFrames skipped("export", options.json);
  while (images.num_written() < images.num_images()) {
    CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, source->Next());
    if (!frame) break;
    if (!frame->status.ok()) {
      skipped.Add(frame->path, frame->status);
      continue;
    }
    CAIRN_RETURN_IF_ERROR(Annotate(images.Add(frame->time_ns, frame->gray).status(), frame->path));
  }
  images.ColorPoints(model);
  return images.num_written();
}

void TellJson(const ModelExport& options, const map::Snapshot& map, const Reconstruction& model, std::size_t images) {
  const exchange::ModelErrors errors = exchange::MeasureErrors(model);
  nlohmann::ordered_json json = {
      {"map", options.map}, {"revision", map.revision()}, {"format", options.format}, {"out", options.out}};
  AddFrameAndUnit(model.metric, &json);
  json.update({{"cameras", model.cameras.size()},
               {"keyframes", model.images.size()},
               {"points", model.points.size()},
               {"components_left_out", model.left_out.components},
               {"keyframes_left_out", model.left_out.keyframes},
               {"observations", errors.observations},
               {"images_written", MakesFolder(options.format) ? images : 0},
               {"images_read", images},
               {"error_rms_px", errors.rms_px},
               {"error_mean_px", errors.mean_px},
               {"error_mean_of_points_px", errors.mean_of_points_px}});
  PrintJson(json);
}

void Tell(const ModelExport& options, const Reconstruction& model, std::size_t images) {
  const exchange::ModelErrors errors = exchange::MeasureErrors(model);
  text::Say(absl::StrFormat("%s: %s of %s and %s, in %s\n", text::Shown(options.out), options.format,
                            text::Keyframes(static_cast<std::int64_t>(model.images.size())),
                            text::Points(static_cast<std::int64_t>(model.points.size())),
                            model.metric ? "the world, metres" : "map units"));
  if (const std::string without = model.left_out.Text(); !without.empty()) {
    text::Say(absl::StrCat("  ", without, " (--component ID)\n"));
  }
  if (!options.images.empty()) {
    const bool written = MakesFolder(options.format);
    text::Say(absl::StrCat(written ? "  " : "  points have the gray values of ", images,
                           written ? " images of keyframes\n" : " images\n"));
  }
  text::Say(absl::StrFormat("  reprojection error %.3f px RMS; mean %.3f px over the points, as COLMAP has it\n",
                            errors.rms_px, errors.mean_of_points_px));
}

}  // namespace

std::vector<std::string> ModelFormats() {
  std::vector<std::string> names;
  for (const auto& [name, writer] : Writers()) names.push_back(name);
  return names;
}

std::string FormatOfName(const std::string& path) {
  static const auto* endings = new std::map<std::string, std::string>{
      {"", "colmap"},    {".ply", "ply"}, {".txt", "tum"},   {".tum", "tum"},
      {".csv", "euroc"}, {".g2o", "g2o"}, {".json", "json"}, {".kitti", "kitti"}};
  const auto found = endings->find(absl::AsciiStrToLower(std::filesystem::path(path).extension().string()));
  return found == endings->end() ? "" : found->second;
}

absl::Status ExportModel(const ModelExport& options) {
  if (!MakesFolder(options.format)) CAIRN_RETURN_IF_ERROR(CheckWritable(options.out, options.overwrite));
  // Both or none: times of another map beside the poses would be wrong ones.
  if (options.format == "kitti") CAIRN_RETURN_IF_ERROR(CheckWritable(TimesBeside(options.out), options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.out}, {InputFile(options.server, options.map), options.camera}));
  CAIRN_ASSIGN_OR_RETURN(const MapToRead served, MapToRead::Open(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                         store::OpenMapStore(served.path(), store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, file->LoadSnapshot());
  auto made = exchange::FromMap(*map, ComponentId(options.component));
  if (!made.ok()) return Annotate(made.status(), options.map);
  Reconstruction& model = *made;
  std::optional<FreshFolder> folder;
  if (MakesFolder(options.format)) folder.emplace(options.out);
  std::size_t images = 0;
  if (!options.images.empty()) {
    CAIRN_ASSIGN_OR_RETURN(images, AddImages(options, *map, &model));
  }
  CAIRN_RETURN_IF_ERROR(Writers().at(options.format)({*map, model, options}));
  if (folder) folder->Keep();
  if (options.json) {
    TellJson(options, *map, model, images);
  } else {
    Tell(options, model, images);
  }
  return absl::OkStatus();
}

}  // namespace cairn::cli
