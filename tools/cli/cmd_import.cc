// cairn import: reconstructions of other programs become maps.
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>

#include "absl/strings/str_format.h"
#include "base/version.h"
#include "care/model_import.h"
#include "cli/cli.h"
#include "engine/session_record.h"
#include "exchange/colmap.h"
#include "io/frame_source.h"
#include "place/default_vocabulary.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct ImportCommand {
  std::string model, images, out, name;
  care::ModelImportOptions options;
  bool exact_poses = false;
  bool overwrite = false;
  bool json = false;
};

absl::StatusOr<care::ModelImport> RunImport(const ImportCommand& command) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(command.out, command.overwrite, /*is_map=*/true));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({command.out}, {command.model, command.images}));
  CAIRN_ASSIGN_OR_RETURN(const exchange::Reconstruction model, exchange::ReadColmap(command.model));
  CAIRN_ASSIGN_OR_RETURN(place::Vocabulary vocabulary, place::LoadDefaultVocabulary());
  const auto words = std::make_shared<const place::Vocabulary>(std::move(vocabulary));
  care::ModelImportOptions options = command.options;
  options.source = std::filesystem::path(command.images).lexically_normal().filename().string();
  if (options.source.empty()) options.source = "colmap";
  if (command.exact_poses) options.mapper.position_sigma_share = options.mapper.rotation_sigma_deg = 0.0;
  map::MapInfo info;
  info.id = engine::NewMapId(std::nullopt);
  info.name = command.name.empty() ? options.source : command.name;
  info.software_version = kVersion;
  info.created_unix_ns = engine::UnixNowNs();
  info.vocabulary_hash = words->hash();
  store::CreateOptions create;
  create.overwrite = command.overwrite;
  create.whole = true;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live,
                         engine::LiveMap::Create(command.out, info, words, create));
  Progress progress("import", static_cast<std::int64_t>(model.images.size()), command.json);
  const auto read = [&](const std::string& name) {
    return io::ReadGrayImage((std::filesystem::path(command.images) / name).string());
  };
  CAIRN_ASSIGN_OR_RETURN(care::ModelImport imported,
                         care::ImportModel(model, options, read, live.get(), [&](int done, int) {
                           progress.Update(done);
                           return true;
                         }));
  progress.Finish();
  CAIRN_RETURN_IF_ERROR(live->Close());
  return imported;
}

void PrintImport(const ImportCommand& command, const care::ModelImport& imported) {
  const mapping::PosedMapperReport& report = imported.report;
  constexpr std::size_t kToldSkipped = 5;
  for (std::size_t i = 0; i < imported.skipped.size() && i < kToldSkipped; ++i) {
    std::cerr << "cairn import: left out: " << imported.skipped[i] << "\n";
  }
  if (imported.skipped.size() > kToldSkipped) {
    std::cerr << "cairn import: and " << imported.skipped.size() - kToldSkipped << " more images left out\n";
  }
  if (command.json) {
    PrintJson({{"map", command.out},
               {"images", imported.images},
               {"images_skipped", imported.skipped.size()},
               {"cameras", imported.cameras},
               {"keyframes", report.keyframes},
               {"keyframes_without_points", report.keyframes_without_points},
               {"points", report.points},
               {"observations", report.observations},
               {"rmse_px", report.rmse_px},
               {"poses_fit_share", report.fit.share},
               {"median_pose_change", report.median_pose_change},
               {"aligned", command.options.metric}});
    return;
  }
  text::Say(absl::StrFormat(
      "%s: %d keyframes of %lld images, %d points, reprojection %.2f px RMSE (per axis, as at octave 0)\n",
      text::Shown(command.out), report.keyframes, static_cast<long long>(imported.images), report.points,
      report.rmse_px));
  text::Say(absl::StrFormat("  the model's poses explain %.0f %% of the matches; refined by %.2g (median, its unit)\n",
                            100.0 * report.fit.share, report.median_pose_change));
  if (imported.cameras > 1) {
    text::Say(absl::StrFormat("  %d calibrations were brought to that of most images\n", imported.cameras));
  }
}

}  // namespace

void AddImportCommand(CLI::App& app, Action* action) {
  CLI::App* import = app.add_subcommand("import", "Make a map of a reconstruction by another program");
  import->require_subcommand(1);
  import->footer("See cairn import colmap --help.");
  CLI::App* verb = import->add_subcommand("colmap", "Make a map of a COLMAP model and its images");
  auto command = std::make_shared<ImportCommand>();
  verb->add_option("MODEL", command->model, "Folder with cameras, images and points3D, text or binary")->required();
  verb->add_option("--images", command->images, "Folder of the images that the model names")->required();
  verb->add_option("-o,--out", command->out, "Map file to make (.cairn)")->required();
  verb->add_option("--name", command->name, "Of the map; by default that of the folder of the images");
  verb->add_flag("--metric", command->options.metric,
                 "The model's unit is the metre: its frame becomes the map's world. By default the map is not aligned");
  verb->add_flag("--exact-poses", command->exact_poses, "Keep the poses exactly as they are");
  verb->add_option("--features", command->options.mapper.features_per_image, "Per image")
      ->capture_default_str()
      ->check(CLI::Range(100, 20000));
  verb->add_flag("--overwrite", command->overwrite, "Replace a map that is there");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "The images' features are extracted anew and triangulated; the poses are kept and refined. The points of the "
      "model are not taken.\n"
      "Examples:\n"
      "  cairn import colmap sparse/0 --images images -o house.cairn\n"
      "  cairn export office.cairn model --format colmap --images office && \\\n"
      "      cairn import colmap model --images model/images -o again.cairn --metric");
  verb->callback([=] {
    *action = [=] {
      const absl::StatusOr<care::ModelImport> imported = RunImport(*command);
      if (!imported.ok()) return Fail("import colmap", imported.status(), command->json);
      PrintImport(*command, *imported);
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli
