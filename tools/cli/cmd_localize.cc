// cairn localize: where a sequence, or one photo, is in a map; the map is only read.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <map>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "api/localizer.h"
#include "base/files.h"
#include "base/guarded.h"
#include "base/median.h"
#include "cli/cli.h"
#include "cli/component_report.h"
#include "cli/input_options.h"
#include "cli/interrupt.h"
#include "cli/localize_across.h"
#include "cli/localize_answer.h"
#include "cli/localize_target.h"
#include "cli/map_camera.h"
#include "cli/map_to_read.h"
#include "cli/pictures.h"
#include "cli/prior_option.h"
#include "cli/sample_statistics.h"
#include "cli/server_option.h"
#include "io/camera_file.h"
#include "io/image_treatment.h"
#include "io/trajectory.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct LocalizeOptions {
  InputOptions input;
  std::vector<std::string> more_photos;
  ServerChoice server;
  std::vector<std::string> maps;
  std::string map;  // the one, if there is no other
  std::string out;
  std::string picture;
  PriorOptions prior_text;
  std::optional<api::PosePrior> prior;  // of every image
  std::string send = "image";
  bool all_maps = false;
  bool independent = false;
  bool verbose = false;
  bool overwrite = false;
  bool json = false;
};

// What came of all queries.
struct Summary {
  std::int64_t frames = 0;
  std::int64_t localized = 0;
  std::vector<double> focal_factors;           // of images that contradict the calibration
  std::int64_t missed_by_calibration = 0;      // those of them that would be located with another one
  std::int64_t elsewhere = 0;                  // of these, in a component whose frame is not that of the files
  std::map<std::string, std::int64_t> misses;  // by stage
  SampleReservoir latency_ms;
  std::vector<io::StampedPose> poses;
  nlohmann::ordered_json images = nlohmann::ordered_json::array();  // each answer, if asked for
  std::string map_id;
  Revision revision = 0;
  std::vector<ComponentId> together;  // components of the poses, which share a frame ...
  bool metric = false;                // ... that is the world
  api::LensUse lens = api::LensUse::kNone;

  void Add(const api::LocalizeAnswer& answer, TimeNs time_ns) {
    ++frames;
    latency_ms.Add(static_cast<float>(answer.extract_ms + answer.locate_ms));
    map_id = answer.map_id;
    revision = answer.revision;
    lens = answer.lens;
    if (answer.focal_factor != 1.0) focal_factors.push_back(answer.focal_factor);
    if (answer.localized) {
      ++localized;
      // A map that is aligned meanwhile: from then on its answers are in another frame.
      if (std::ranges::find(together, answer.component) == together.end() || answer.world_is_metric != metric) {
        ++elsewhere;
      } else {
        poses.push_back({time_ns, answer.world_from_camera});
      }
    } else {
      ++misses[api::LocalizeStageName(answer.stage)];
      if (answer.focal_factor != 1.0) ++missed_by_calibration;
    }
  }
};

absl::Status Draw(const LocalizeOptions& options, const Summary& summary) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                         store::OpenMapStore(options.map, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, file->LoadSnapshot());
  if (map->keyframes().empty()) {
    TellNotes("localize", {absl::StrCat(options.picture, " is not drawn: ", options.map, " has no keyframes")});
    return absl::OkStatus();
  }
  std::vector<SE3> queries;
  for (const io::StampedPose& pose : summary.poses) queries.push_back(pose.world_from_camera);
  return DrawMap(*map, options.picture, queries);
}

absl::Status WriteOutputs(const LocalizeOptions& options, const Summary& summary) {
  absl::Status status;
  if (!options.out.empty()) {
    io::TrajectoryWriteOptions write;
    write.overwrite = options.overwrite;
    write.comment = absl::StrCat("t tx ty tz qx qy qz qw: ", summary.metric ? "world" : "map", "_from_camera, map ",
                                 summary.map_id, " revision ", summary.revision);
    status.Update(io::WriteTumTrajectory(options.out, summary.poses, write));
  }
  if (!options.picture.empty()) status.Update(Guarded([&] { return Draw(options, summary); }));
  return status;
}

void PrintLensUse(api::LensUse lens) {
  if (lens == api::LensUse::kCorrected) {
    text::Say("  with the lens that the map found for this camera\n");
  } else if (lens == api::LensUse::kOtherCalibration) {
    text::Say("  the map has corrected its camera's lens; this calibration is another one and was used as it is\n");
  }
}

// Single images may err; not half of them.
bool CalibrationContradicted(const Summary& summary) {
  return 2 * static_cast<std::int64_t>(summary.focal_factors.size()) >
         summary.localized + summary.missed_by_calibration;
}

void PrintSummary(const LocalizeOptions& options, const Summary& summary, std::int64_t skipped, bool interrupted) {
  const double share =
      summary.frames > 0 ? static_cast<double>(summary.localized) / static_cast<double>(summary.frames) : 0.0;
  if (options.json) {
    nlohmann::ordered_json json = {{"map", summary.map_id}, {"revision", summary.revision}};
    AddFrameAndUnit(summary.metric, &json);
    json.update({{"frames", summary.frames},
                 {"localized", summary.localized},
                 {"localized_share", share},
                 {"localized_in_other_components", summary.elsewhere},
                 {"frames_skipped", skipped},
                 {"interrupted", interrupted},
                 {"lens", api::LensUseName(summary.lens)},
                 {"calibration_contradicted", CalibrationContradicted(summary)},
                 {"misses", summary.misses},
                 {"latency_ms", SampleStatistics(summary.latency_ms)}});
    if (options.verbose) json["images"] = summary.images;
    PrintJson(json);
    return;
  }
  text::Say(absl::StrFormat("located %lld of %lld images (%.1f %%), %.1f ms median each (p99 %.1f)\n",
                            static_cast<long long>(summary.localized), static_cast<long long>(summary.frames),
                            100.0 * share, summary.latency_ms.Percentile(0.5), summary.latency_ms.Percentile(0.99)));
  if (summary.elsewhere > 0) {
    text::Say(absl::StrFormat("  %lld of them in other components than those of the files, %s (cairn info)\n",
                              static_cast<long long>(summary.elsewhere), NameComponents(summary.together)));
  }
  for (const auto& [stage, count] : summary.misses) {
    text::Say(absl::StrFormat("  %lld missed at stage \"%s\"\n", static_cast<long long>(count), stage));
  }
  if (skipped > 0) text::Say(absl::StrFormat("  %lld images could not be used\n", static_cast<long long>(skipped)));
  if (interrupted) text::Say("  interrupted: this is what was done until then\n");
  PrintLensUse(summary.lens);
  if (CalibrationContradicted(summary)) {
    text::Say(absl::StrFormat(
        "  WARNING: the calibration does not fit the images, %zu of %lld show another one, with a focal length of "
        "about "
        "x %.3f: the poses are off, and less sure than usual%s; calibrate the camera\n",
        summary.focal_factors.size(), static_cast<long long>(summary.localized + summary.missed_by_calibration),
        Median(summary.focal_factors),
        summary.missed_by_calibration > 0
            ? absl::StrCat(", and ", summary.missed_by_calibration, " images were missed for it")
            : ""));
  }
  if (!summary.metric) text::Say("  the map is not aligned: poses are in its own units and frame (cairn align)\n");
}

// For photos of the map's own camera: the one that takes images of this size.
using OwnCamera = std::function<absl::StatusOr<Camera>(cv::Size size)>;

OwnCamera OwnCameraOf(const LocalizeTarget& map, const std::string& photo) {
  return [&](cv::Size size) { return CameraOfSize(map.cameras(), size, photo); };
}

absl::StatusOr<api::LocalizeQuery> QueryOf(const LocalizeOptions& options, const std::string& photo,
                                           const OwnCamera& own_camera) {
  const std::string& camera_path = options.input.open.camera_path;
  api::LocalizeQuery query;
  query.prior = options.prior;
  if (camera_path.empty()) {
    CAIRN_ASSIGN_OR_RETURN(query.image, io::ReadGrayImage(photo));
    CAIRN_ASSIGN_OR_RETURN(query.camera, own_camera(query.image.size()));
  } else {
    CAIRN_ASSIGN_OR_RETURN(const io::CameraFile camera, io::LoadCamera(camera_path));
    query.camera = camera.camera;
    CAIRN_ASSIGN_OR_RETURN(query.image,
                           io::ReadGrayImage(photo, cv::Size(query.camera.width_px, query.camera.height_px)));
  }
  const std::string& mask = options.input.open.mask_path;
  if (!mask.empty() && mask != "none") {
    CAIRN_ASSIGN_OR_RETURN(const image::MaskFiller hidden, io::LoadMask(mask, query.image.size()));
    hidden.Fill(&query.image);
  }
  return query;
}

// Those that are named; of a server's several at once, with commas between, as no name has one.
std::vector<std::string> NamedMaps(const LocalizeOptions& options) {
  if (options.server.empty()) return options.maps;
  return absl::StrSplit(absl::StrJoin(options.maps, ","), ',', absl::SkipEmpty());
}

absl::StatusOr<int> LocalizeInSeveral(const LocalizeOptions& options) {
  const std::string& photo = options.input.sequence;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<AcrossTarget> target, OpenAcrossTarget(options.server, options.maps));
  const auto own_camera = [&](cv::Size size) -> absl::StatusOr<Camera> {
    CAIRN_ASSIGN_OR_RETURN(const std::vector<CamerasOfMap> maps, target->Cameras());
    return CameraOfMaps(maps, size, photo);
  };
  CAIRN_ASSIGN_OR_RETURN(const api::LocalizeQuery query, QueryOf(options, photo, own_camera));
  CAIRN_ASSIGN_OR_RETURN(const api::AcrossAnswer across, target->Localize(query));
  return TellAcross(across, photo, options.json);
}

absl::StatusOr<int> LocalizePhoto(const LocalizeOptions& options, LocalizeTarget& localizer) {
  const std::string& photo = options.input.sequence;
  CAIRN_ASSIGN_OR_RETURN(const api::LocalizeQuery query, QueryOf(options, photo, OwnCameraOf(localizer, photo)));
  CAIRN_ASSIGN_OR_RETURN(const api::LocalizeAnswer answer, localizer.Localize(query));
  Summary summary;
  summary.together = {answer.component};
  summary.metric = answer.world_is_metric;
  summary.Add(answer, 0);
  CAIRN_RETURN_IF_ERROR(WriteOutputs(options, summary));
  if (options.json) {
    PrintJson(AnswerToJson(answer, options.input.sequence, 0));
  } else {
    PrintLocalizeAnswer(answer, options.input.sequence);
    PrintLensUse(answer.lens);
  }
  return answer.localized ? kOk : kNotLocalized;
}

// Photos one by one; the k-th has the time k seconds. One that cannot be read is told and counted.
absl::StatusOr<int> LocalizePhotos(const LocalizeOptions& options, LocalizeTarget& localizer) {
  SkippedFrames skipped("localize", /*quiet=*/false);
  Summary summary;
  summary.together = localizer.frame().components;
  summary.metric = localizer.frame().metric;
  std::vector<std::string> photos = {options.input.sequence};
  photos.insert(photos.end(), options.more_photos.begin(), options.more_photos.end());
  TimeNs time_ns = 0;
  for (const std::string& photo : photos) {
    const absl::StatusOr<api::LocalizeQuery> query = QueryOf(options, photo, OwnCameraOf(localizer, photo));
    if (!query.ok()) {
      skipped.Add(photo, query.status());
    } else {
      CAIRN_ASSIGN_OR_RETURN(const api::LocalizeAnswer answer, localizer.Localize(*query));
      summary.Add(answer, time_ns);
      summary.images.push_back(AnswerToJson(answer, photo, time_ns));
      if (!options.json) PrintLocalizeAnswer(answer, photo);
    }
    time_ns += 1'000'000'000;
  }
  if (summary.frames == 0) return absl::InvalidArgumentError("none of the photos can be used");
  CAIRN_RETURN_IF_ERROR(WriteOutputs(options, summary));
  LocalizeOptions all = options;
  all.verbose = true;
  PrintSummary(all, summary, skipped.count(), /*interrupted=*/false);
  return summary.localized > 0 ? kOk : kNotLocalized;
}

// On to what others have added to the map since. False if that cannot be read any more: what is known still answers.
bool Follow(LocalizeTarget& localizer, Summary* summary) {
  const absl::StatusOr<bool> newer = localizer.Refresh();
  if (!newer.ok()) {
    std::cerr << "\ncairn localize: " << newer.status().message() << "; going on with revision " << localizer.revision()
              << "\n";
    return false;
  }
  if (*newer && summary->metric) summary->together = localizer.frame().components;
  return true;
}

// Every image until the end, an error, or `stop`, each in the newest revision.
absl::Status LocalizeAll(const LocalizeOptions& options, io::FrameSource& source, LocalizeTarget& localizer,
                         const std::atomic<bool>& stop, SkippedFrames* skipped, Summary* summary) {
  Progress progress("localizing", source.info().num_frames, options.json || options.verbose);
  bool follows = true;
  while (!stop) {
    CAIRN_ASSIGN_OR_RETURN(const std::optional<io::SourceFrame> frame, source.Next());
    if (!frame) break;
    if (!frame->status.ok()) {
      skipped->Add(frame->path, frame->status);
      continue;
    }
    follows = follows && Follow(localizer, summary);
    CAIRN_ASSIGN_OR_RETURN(const api::LocalizeAnswer answer,
                           localizer.Localize({frame->gray, source.info().camera, frame->time_ns, options.prior}));
    summary->Add(answer, frame->time_ns);
    if (options.verbose && options.json) summary->images.push_back(AnswerToJson(answer, frame->path, frame->time_ns));
    if (options.verbose && !options.json) PrintLocalizeAnswer(answer, frame->path);
    progress.Update(frame->index + 1, absl::StrCat(summary->localized, " of ", summary->frames, " located"));
  }
  return absl::OkStatus();
}

absl::StatusOr<int> LocalizeSequence(const LocalizeOptions& options, LocalizeTarget& localizer,
                                     InterruptWatch* interrupt) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<io::FrameSource> source, OpenInput(options.input, "localize"));
  SkippedFrames skipped("localize", options.json);
  Summary summary;
  summary.together = localizer.frame().components;
  summary.metric = localizer.frame().metric;
  absl::Status status;
  {
    std::atomic<bool> stop = false;
    const InterruptWatch::Guard guard(interrupt, [&] { stop = true; });
    status = Guarded([&] { return LocalizeAll(options, *source, localizer, stop, &skipped, &summary); });
  }
  const bool interrupted = interrupt->exit_code() != 0;
  if (interrupted && absl::IsUnavailable(status)) status = absl::OkStatus();  // it waited for a server
  if (status.ok() && summary.frames == 0 && !interrupted) {
    return absl::DataLossError(
        absl::StrCat("none of the ", skipped.count(), " images of ", options.input.sequence, " could be used"));
  }
  const absl::Status written = WriteOutputs(options, summary);
  if (!status.ok()) return AfterError(status, {options.out, options.picture}, written);
  CAIRN_RETURN_IF_ERROR(written);
  PrintSummary(options, summary, skipped.count(), interrupted);
  if (interrupted) return interrupt->exit_code();
  return summary.localized > 0 ? kOk : kNotLocalized;
}

absl::StatusOr<int> Localize(LocalizeOptions options) {
  InterruptWatch interrupt;
  options.server.interrupt = &interrupt;
  options.maps = NamedMaps(options);
  const bool several = options.all_maps || options.maps.size() > 1;
  if (options.maps.empty() && !options.all_maps) return FailUsage("localize", "--map is required", options.json);
  if (!options.maps.empty()) options.map = options.maps[0];
  if (!options.maps.empty() && options.all_maps) {
    return FailUsage("localize", "--map names maps, --all-maps are all of them: give one of the two", options.json);
  }
  if (options.send != "image" && (options.server.empty() || several)) {
    return FailUsage("localize", "--send features is for one map of a server", options.json);
  }
  if (options.all_maps && options.server.empty()) {
    return FailUsage("localize", "--all-maps are those of a server: give --server HOST:PORT", options.json);
  }
  std::error_code error;
  if (!options.server.empty() && !options.picture.empty()) {
    return FailUsage("localize", "--picture draws a map file: not with --server", options.json);
  }
  absl::StatusOr<std::optional<api::PosePrior>> prior = ReadPrior(options.prior_text);
  if (!prior.ok()) return FailUsage("localize", std::string(prior.status().message()), options.json);
  options.prior = *std::move(prior);
  const bool photo = std::filesystem::is_regular_file(options.input.sequence, error);
  for (const std::string& another : options.more_photos) {
    if (photo && std::filesystem::is_regular_file(another, error)) continue;
    return FailUsage("localize",
                     absl::StrCat(photo ? another : options.input.sequence,
                                  " is no photo: several photos may be named, or one folder"),
                     options.json);
  }
  if (!std::filesystem::exists(options.input.sequence, error)) {
    return absl::NotFoundError(
        absl::StrCat(options.input.sequence, " does not exist: name a photo or a sequence's folder"));
  }
  const bool folder = std::filesystem::is_directory(options.input.sequence, error);
  if (!photo && !folder) {
    return absl::InvalidArgumentError(absl::StrCat(options.input.sequence, " ", WhyNoFile(options.input.sequence),
                                                   ": name a photo or a sequence's folder"));
  }
  if (folder && !options.independent) {
    return FailUsage(
        "localize",
        "give --independent: each image is located on its own; `cairn track` follows a camera from image to "
        "image",
        options.json);
  }
  std::vector<std::string> inputs = InputFiles(options.input);
  inputs.insert(inputs.end(), options.more_photos.begin(), options.more_photos.end());
  if (options.server.empty()) inputs.insert(inputs.end(), options.maps.begin(), options.maps.end());
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.out, options.picture}, inputs));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  for (const std::string* output : {&options.out, &options.picture}) {
    CAIRN_RETURN_IF_ERROR(CheckWritable(*output, options.overwrite));
  }
  for (const std::string& map : options.maps) TellLogDamage("localize", options.server, map);
  if (several) {
    const bool more = !options.more_photos.empty() || !options.out.empty() || !options.picture.empty();
    if (photo && !more && !options.prior) return LocalizeInSeveral(options);
    return FailUsage("localize", "several maps are asked for one photo at a time, without --out, --picture and --prior",
                     options.json);
  }
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<LocalizeTarget> localizer,
                         OpenLocalizeTarget(options.server, options.map));
  if (!options.more_photos.empty()) return LocalizePhotos(options, *localizer);
  return photo ? LocalizePhoto(options, *localizer) : LocalizeSequence(options, *localizer, &interrupt);
}

}  // namespace

void AddLocalizeCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("localize", "Find the cameras of a sequence, or of photos, in a map");
  auto options = std::make_shared<LocalizeOptions>();
  AddInputOptions(verb, &options->input);
  verb->get_option("DATASET")->description(
      "A photo, or the folder of a sequence: EuRoC, TUM RGB-D, TUM monoVO, KITTI, images with times.txt");
  verb->add_option("PHOTOS", options->more_photos, "Further photos");
  verb->add_option(
          "--map", options->maps,
          "Map file (.cairn), with --server the name of a map there; it is only read. Given several times (or, "
          "with --server, as names with commas between): in which of them was the photo taken?")
      ->allow_extra_args(false);
  verb->add_flag("--all-maps", options->all_maps, "In which of all maps of the server was the photo taken?");
  verb->add_option(
      "--out", options->out,
      "Write the poses found to this file (TUM format); of a map of several components those in the aligned "
      "ones, or in the largest");
  verb->add_option("--picture", options->picture, "Draw the map and the cameras found to this .png or .svg file");
  AddPriorOptions(verb, &options->prior_text);
  AddSendOption(verb, &options->send);
  verb->add_flag("--independent", options->independent,
                 "Locate each image on its own, without help from the ones before it (needed for a sequence)");
  verb->add_flag("--verbose", options->verbose, "Print the answer for each image (with --json: as `images`)");
  verb->add_flag("--overwrite", options->overwrite, "Replace files that exist");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Exit code 4 if no image was located. Beside a session that extends the map each image is looked for in the "
      "newest "
      "revision. Photos of the map's own camera, as they came from it, need no --camera, "
      "nor do those of a camera that is the same in all of several maps.\n"
      "Examples:\n"
      "  cairn localize photo.jpg another.jpg --map office.cairn\n"
      "  cairn localize second_visit --camera camera.yaml --map office.cairn --independent --out poses.txt\n"
      "  cairn localize photo.jpg --camera camera.yaml --map office.cairn\n"
      "  cairn localize photo.jpg --camera camera.yaml --map office.cairn --prior \"1.2 0.4 1.5 0 0 0 1\" "
      "--prior-sigma \"0.5 "
      "10\"\n"
      "  cairn --server localhost:7878 localize photo.jpg --camera camera.yaml --map office\n"
      "  cairn --server localhost:7878 localize photo.jpg --camera camera.yaml --all-maps");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    options->server.send_features = options->send == "features";
    *action = [=] {
      const absl::StatusOr<int> code = Localize(*options);
      return code.ok() ? *code : Fail("localize", code.status(), options->json);
    };
  });
}

}  // namespace cairn::cli
