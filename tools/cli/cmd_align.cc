// cairn align: gives a component of a map its place and scale in the world, and the map its place on the earth.
#include <filesystem>
#include <numbers>

#include "cli/align_report.h"
#include "cli/cli.h"
#include "cli/geo_options.h"
#include "cli/input_options.h"
#include "cli/known_places.h"
#include "cli/map_to_read.h"
#include "cli/server_option.h"
#include "engine/map_alignment.h"
#include "eval/reference.h"

namespace cairn::cli {
namespace {

struct AlignOptions {
  std::string map;
  ServerChoice server;
  std::string groundtruth;
  eval::ReferenceOptions reference;
  PoseAlignmentOptions solver;
  GeoOptions geo;
  KnownPlacesOptions known;
  std::uint32_t component = 0;  // 0: the one with most keyframes that have a reference
  std::uint32_t session = 0;    // whose keyframes the reference is of; 0: of all
  double max_dt_s = 0.02;
  double sigma_rotation_deg = 0.0;
  bool positions_only = false;
  bool force = false;
  bool overwrite = false;
  bool json = false;
};

// With what the poses of --groundtruth turned out to be, if they are asked for.
absl::StatusOr<api::AlignRequest> RequestOf(const AlignOptions& options, std::optional<eval::Reference>* reference) {
  api::AlignRequest request;
  request.component = ComponentId(options.component);
  request.session = SessionId(options.session);
  request.max_dt_s = options.max_dt_s;
  request.overwrite = options.overwrite;
  request.force = options.force;
  if (!options.groundtruth.empty()) {
    CAIRN_ASSIGN_OR_RETURN(*reference, eval::LoadReference(options.groundtruth, options.reference));
    TellNotes("align", (*reference)->trajectory.notes);
    api::ReferencePoses poses{(*reference)->trajectory.poses, options.solver};
    poses.solver.sigma_rotation_rad = options.sigma_rotation_deg * std::numbers::pi / 180.0;
    poses.solver.use_orientations = !options.positions_only;
    request.by = std::move(poses);
    request.source = options.groundtruth;
  } else if (!options.known.empty()) {
    CAIRN_ASSIGN_OR_RETURN(request.by, ReadKnownPlaces(options.known));
    request.source = options.known.positions;
  } else if (!options.geo.positions.empty()) {
    CAIRN_ASSIGN_OR_RETURN(request.by, ReadGeoPositions(options.geo.positions));
    request.source = options.geo.positions;
  } else {
    CAIRN_ASSIGN_OR_RETURN(request.by, AnchorOf(options.geo));
  }
  return request;
}

absl::StatusOr<api::AlignAnswer> AlignFile(const std::string& path, const api::AlignRequest& request) {
  TellLogDamage("align", {}, path);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live, engine::LiveMap::Open(path));
  CAIRN_ASSIGN_OR_RETURN(api::AlignAnswer answer, engine::AlignMap(path, request, *live));
  CAIRN_RETURN_IF_ERROR(live->Close());
  return answer;
}

absl::StatusOr<api::AlignAnswer> AlignServed(const AlignOptions& options, api::AlignRequest request) {
  request.source = std::filesystem::path(request.source).filename().string();
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return service->Align(options.map, request);
}

absl::Status Align(const AlignOptions& options) {
  std::optional<eval::Reference> reference;
  CAIRN_ASSIGN_OR_RETURN(const api::AlignRequest request, RequestOf(options, &reference));
  CAIRN_ASSIGN_OR_RETURN(const api::AlignAnswer answer,
                         options.server.empty() ? AlignFile(options.map, request) : AlignServed(options, request));
  if (!options.known.empty()) {
    PrintKnownAlignment(options.map, answer, options.json);
    return absl::OkStatus();
  }
  const AlignReport report{options.map, reference ? &*reference : nullptr, options.positions_only, answer};
  if (options.json) {
    PrintJson(AlignReportAsJson(report));
  } else {
    PrintAlignReport(report);
  }
  return absl::OkStatus();
}

void AddReferenceOptions(CLI::App* verb, const std::shared_ptr<AlignOptions>& options) {
  verb->add_option("--groundtruth", options->groundtruth,
                   "Camera poses of the mapped sequence: TUM, EuRoC csv or KITTI");
  verb->add_option("--sensor", options->reference.sensor,
                   "File with T_BS, where the camera sits on the body that the poses are of (EuRoC's sensor.yaml); by "
                   "default the one of cam0 beside an EuRoC csv; none: poses as they are");
  verb->add_flag("--positions-only", options->positions_only, "Do not use the orientations of the reference");
  verb->add_option("--sigma-position", options->solver.sigma_position,
                   "Noise of the positions per axis, metres; estimated if not given")
      ->check(CLI::PositiveNumber);
  verb->add_option("--sigma-rotation", options->sigma_rotation_deg,
                   "Noise of the orientations per axis, degrees; estimated if not given")
      ->check(CLI::PositiveNumber);
  verb->add_option("--geo", options->geo.geo,
                   "Where the world's origin is on the earth: \"LATITUDE LONGITUDE HEIGHT\" (WGS 84, degrees, metres "
                   "above the ellipsoid); none: the map forgets it");
  verb->add_option("--heading", options->geo.heading_deg,
                   "With --geo: where the world's x axis points, degrees clockwise from true north (of --up x the y "
                   "axis, of --up y the z axis)")
      ->capture_default_str();
  verb->add_option("--up", options->geo.up,
                   "With --geo: the axis of the world that points upwards; -y where it is a camera's")
      ->check(CLI::IsMember({"x", "y", "z", "-x", "-y", "-z"}))
      ->capture_default_str();
  verb->add_option("--geo-positions", options->geo.positions,
                   "File with where keyframes were on the earth, three at least: `time latitude longitude height`, or "
                   "below a line `# keyframe latitude longitude height` by their numbers");
}

void AddKnownOptions(CLI::App* verb, const std::shared_ptr<AlignOptions>& options) {
  verb->add_option("--points", options->known.positions,
                   "File with the world positions of three places or more, metres, a line each: point ID X Y Z, "
                   "keyframe ID X Y Z, or pixel KEYFRAME U V X Y Z for what is seen there");
  verb->add_option("--distance", options->known.distances,
                   "Two places and how many metres they are apart, as \"point 12 point 57 3.2\"; gives the scale; may "
                   "be given several times");
  verb->add_option("--gravity", options->known.gravity,
                   "\"X Y Z\": where gravity points in the component's frame (the world's, if it is aligned), or "
                   "cameras: as their images stand on average; upwards becomes the world's z axis");
}

void AddOptions(CLI::App* verb, const std::shared_ptr<AlignOptions>& options) {
  verb->add_option("MAP", options->map,
                   "Map file (.cairn), with --server the name of a map there; what is found is stored in it")
      ->required();
  AddReferenceOptions(verb, options);
  AddKnownOptions(verb, options);
  verb->add_option("--component", options->component,
                   "Component to align; by default the one with most keyframes that have a reference")
      ->check(CLI::PositiveNumber);
  verb->add_option("--session", options->session,
                   "Session whose poses these are; by default every keyframe that has a pose at its time counts")
      ->check(CLI::PositiveNumber);
  verb->add_option("--max-dt", options->max_dt_s, "Largest time difference of keyframe and reference, seconds")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  verb->add_flag("--overwrite", options->overwrite, "Replace an alignment that the component has, or the map's --geo");
  verb->add_flag("--force", options->force,
                 "Align although many poses do not fit, few keyframes have one, the scale is not that of the "
                 "alignment there is, or a distance does not tell where in the world the component lies");
  verb->add_flag("--json", options->json, "Answer in JSON");
}

}  // namespace

void AddAlignCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand(
      "align", "Give a map its scale and place in the world from known camera poses, and its place on the earth");
  auto options = std::make_shared<AlignOptions>();
  AddOptions(verb, options);
  verb->footer(
      "One of --groundtruth, --geo, --geo-positions, --points, and --distance with or without --gravity.\n"
      "Examples:\n  cairn align office.cairn --groundtruth groundtruth.txt\n"
      "  cairn align office.cairn --component 2 --groundtruth state_groundtruth_estimate0/data.csv --sensor "
      "cam0/sensor.yaml\n"
      "  cairn align track.cairn --groundtruth gps.txt --positions-only\n"
      "  cairn align office.cairn --geo \"60.1699 24.9384 30\" --heading 45\n"
      "  cairn align street.cairn --geo-positions gnss.txt --max-dt 0.1\n"
      "  cairn align office.cairn --points surveyed.txt\n"
      "  cairn align office.cairn --distance \"pixel 3 120 200 pixel 3 510 210 1.80\" --gravity cameras\n"
      "  cairn --server localhost:7878 align office --groundtruth groundtruth.txt");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const int asked = static_cast<int>(!options->groundtruth.empty()) + static_cast<int>(!options->geo.geo.empty()) +
                        static_cast<int>(!options->geo.positions.empty());
      const bool known = !options->known.empty();
      for (const char* of_poses : {"--sensor", "--positions-only", "--sigma-position", "--sigma-rotation"}) {
        if (verb->count(of_poses) == 0 || !options->groundtruth.empty()) continue;
        return FailUsage("align", absl::StrCat(of_poses, " says something of --groundtruth, which is not given"),
                         options->json);
      }
      if (asked + static_cast<int>(known) != 1) {
        return FailUsage("align",
                         "give one of --groundtruth, --geo, --geo-positions, --points, --distance and --gravity (of "
                         "which the last two go together)",
                         options->json);
      }
      if (!options->known.positions.empty() && (!options->known.distances.empty() || !options->known.gravity.empty())) {
        return FailUsage("align", "--points say all: neither --distance nor --gravity goes with them", options->json);
      }
      const absl::Status status = Align(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("align", status, options->json);
    };
  });
}

}  // namespace cairn::cli
