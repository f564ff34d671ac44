// cairn info: what is in a map.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "cli/align_report.h"
#include "cli/cli.h"
#include "cli/component_report.h"
#include "cli/geo_options.h"
#include "cli/input_options.h"
#include "cli/loaded_map.h"
#include "cli/map_scene.h"
#include "cli/map_to_read.h"
#include "cli/pictures.h"
#include "cli/server_option.h"
#include "cli/session_report.h"
#include "cli/unix_time.h"
#include "host/inspect.h"
#include "inspect/measures.h"
#include "map/overview.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

using text::Shown;
using text::Wrapped;

// Of components, cameras, sessions: all of it fits one screen.
constexpr std::size_t kListed = 4;

struct InfoOptions {
  std::string map;
  ServerChoice server;
  std::string picture;
  bool digest = false;
  bool plan = false;
  bool overwrite = false;
  bool json = false;
};

nlohmann::ordered_json IdsAsJson(const std::vector<ComponentId>& ids) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const ComponentId id : ids) json.push_back(id.value());
  return json;
}

double Percent(std::int64_t bytes, std::int64_t of) {
  return of == 0 ? 0.0 : std::round(1000.0 * static_cast<double>(bytes) / static_cast<double>(of)) / 10.0;
}

// A session with what its keyframes say of it.
struct ToldSession {
  const map::Session* session = nullptr;
  std::int64_t keyframes = 0;
  double duration_s = 0.0;  // of one that is not complete: as far as the map goes
};

std::vector<ToldSession> ToldSessions(const map::MapOverview& map) {
  std::vector<ToldSession> told;
  for (const map::Session& session : map.sessions) {
    ToldSession& next = told.emplace_back();
    next.session = &session;
    TimeNs last_ns = session.last_ns;
    for (const map::KeyframeShare& share : map.shares) {
      if (share.session != session.id) continue;
      next.keyframes += share.keyframes;
      last_ns = std::max(last_ns, share.last_ns);
    }
    next.duration_s = ToSeconds(std::max<TimeNs>(0, last_ns - session.first_ns));  // 0: no image came
  }
  return told;
}

nlohmann::ordered_json SessionAsJson(const ToldSession& told, bool being_written) {
  const map::Session& session = *told.session;
  return {{"id", session.id.value()},
          {"source", session.source},
          {"camera", session.camera.value()},
          {"keyframes", told.keyframes},
          {"duration_s", told.duration_s},
          {"complete", session.complete},
          {"cut_off", !session.complete && !being_written},
          {"removed", session.removed},
          {"policy", map::SessionPolicyName(session.policy)},
          {"result", map::SessionResultName(session.result)},
          {"components", IdsAsJson(session.components)},
          {"loops", LoopsAsJson(session)},
          {"trajectory", TrajectoryAsJson(session)},
          {"software_version", session.software_version},
          {"started", FormatUnixTime(session.started_unix_ns)},
          {"settings", SettingsAsJson(session)}};
}

// Null: there is nothing that it could be measured of.
nlohmann::ordered_json Known(bool known, double value) { return known ? nlohmann::ordered_json(value) : nullptr; }

nlohmann::ordered_json Describe(const map::MapOverview& map) {
  const map::StoredSummary& summary = map.summary;
  const map::MapQuality& quality = map.quality;
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array(), sessions = cameras, sizes = cameras;
  for (const map::MapCamera& camera : map.cameras) {
    cameras.push_back({{"id", camera.id.value()},
                       {"name", camera.name},
                       {"model", camera.model.Describe()},
                       {"lens", LensAsJson(camera)}});
  }
  for (const ToldSession& told : ToldSessions(map)) sessions.push_back(SessionAsJson(told, map.being_written));
  for (const map::MapPart& part : map.parts) {
    sizes.push_back({{"part", part.name}, {"bytes", part.bytes}, {"percent", Percent(part.bytes, summary.file_bytes)}});
  }
  return {{"id", summary.info.id},
          {"name", summary.info.name},
          {"revision", summary.revision},
          {"format_version", summary.format_version},
          {"writing", map.being_written},
          {"keyframes", summary.keyframes},
          {"points", summary.points},
          {"components", ComponentsAsJson(ToldComponents(map))},
          {"fragments", FragmentsAsJson(FragmentsOf(ToldComponents(map), map.sessions, map.being_written))},
          {"geo_anchor", AnchorAsJson(summary.info.geo_anchor)},
          {"features_per_keyframe", Known(quality.keyframes > 0, quality.features)},
          {"points_per_keyframe", Known(quality.keyframes > 0, quality.points)},
          {"covisible_keyframes", Known(quality.keyframes > 0, quality.covisible)},
          {"observations_per_point", Known(summary.points > 0, quality.observations_per_point)},
          {"reprojection_rms_px", Known(quality.error_keyframes > 0, quality.error_rms_px)},
          {"reprojection_median_px", Known(quality.error_keyframes > 0, quality.error_median_px)},
          {"keyframes_looked_at", quality.keyframes},
          {"keyframes_projected", quality.error_keyframes},
          {"vocabulary_hash", absl::StrCat(absl::Hex(summary.info.vocabulary_hash, absl::kZeroPad16))},
          {"bytes", summary.file_bytes},
          {"sizes", sizes},
          {"created", FormatUnixTime(summary.info.created_unix_ns)},
          {"software_version", summary.info.software_version},
          {"cameras", cameras},
          {"sessions", sessions}};
}

std::string Megabytes(std::int64_t bytes) {
  const double mb = static_cast<double>(bytes) / 1e6;
  return mb >= 1000.0 ? absl::StrFormat("%.2f GB", mb / 1000.0) : absl::StrFormat("%.1f MB", mb);
}

void PrintSizes(const map::MapOverview& map) {
  const std::int64_t all = map.summary.file_bytes;
  std::printf(
      "  %s%s\n", Megabytes(all).c_str(),
      map.quality.all ? ":" : absl::StrFormat(", shares estimated from %d keyframes:", map.quality.keyframes).c_str());
  std::string shares;
  for (const map::MapPart& part : map.parts) {
    if (Percent(part.bytes, all) < 0.1) continue;
    absl::StrAppendFormat(&shares, "%s%s\u00a0%.1f\u00a0%%", shares.empty() ? "" : ", ", part.name,
                          Percent(part.bytes, all));
  }
  shares = Wrapped(shares, "    ", "    ");
  std::printf("%s", absl::StrReplaceAll(shares, {{"\u00a0", " "}}).c_str());
}

void PrintCameras(const map::MapOverview& map) {
  for (std::size_t i = 0; i < std::min(map.cameras.size(), kListed); ++i) {
    const map::MapCamera& camera = map.cameras[i];
    const auto lens = LensAsJson(camera);
    const auto value = [&](const char* key) { return lens[key].get<double>(); };
    std::printf("%s", Wrapped(absl::StrCat("camera ", camera.id.value(), ", ", Shown(camera.name), ": ",
                                           camera.model.Describe()),
                              "  ", "    ")
                          .c_str());
    if (lens.is_null()) continue;
    std::printf(
        "    lens corrected by the map: focal length x %.4f, k1 %.4f, k2 %.4f\n"
        "    (%.2f px on average, up to %.2f px)\n",
        value("focal_scale"), value("k1"), value("k2"), value("shift_rms_px"), value("shift_max_px"));
  }
  if (map.cameras.size() > kListed) {
    std::printf("  ... %zu more cameras (ls MAP cameras)\n", map.cameras.size() - kListed);
  }
}

// The newest ones.
void PrintSessions(const map::MapOverview& map) {
  const std::vector<ToldSession> sessions = ToldSessions(map);
  const std::size_t left_out = sessions.size() - std::min(sessions.size(), kListed);
  if (left_out > 0) std::printf("  ... %zu earlier sessions (ls MAP sessions)\n", left_out);
  for (std::size_t i = left_out; i < sessions.size(); ++i) {
    const auto& [session, keyframes, duration_s] = sessions[i];
    const std::string started = FormatUnixTime(session->started_unix_ns);
    const char* came_out = session->removed                                  ? ", removed since"
                           : keyframes == 0                                  ? ", added nothing"
                           : session->result == map::SessionResult::kLocated ? ", in an earlier component"
                           : session->result == map::SessionResult::kApart   ? ", joined to no earlier component"
                                                                             : "";
    const char* state = session->complete   ? ""
                        : map.being_written ? " (running, or cut off)"
                                            : " (cut off before its end)";
    std::printf("%s",
                Wrapped(absl::StrFormat("session %u: %s, camera %u, %.1f s, %s%s, by cairn %s%s%s", session->id.value(),
                                        Shown(session->source), session->camera.value(), duration_s,
                                        text::Keyframes(keyframes), came_out, Shown(session->software_version),
                                        started.empty() ? "" : absl::StrCat(" on ", started), state),
                        "  ", "    ")
                    .c_str());
    if (sessions.size() <= kListed) PrintLoopsAndTrajectory(*session, "    ");
  }
}

void PrintQuality(const map::StoredSummary& summary, const map::MapQuality& quality) {
  std::printf("  %s with %.0f features (%.0f with a point), %.1f covisible each\n",
              text::Keyframes(summary.keyframes).c_str(), quality.features, quality.points, quality.covisible);
  const std::string error =
      quality.error_keyframes == 0
          ? "not known"
          : absl::StrFormat("%.2f px RMS, %.2f px median%s", quality.error_rms_px, quality.error_median_px,
                            quality.error_keyframes < summary.keyframes
                                ? absl::StrCat(" (in ", quality.error_keyframes, " of the keyframes)")
                                : "");
  const std::string seen = absl::StrFormat("%s, seen %.1f times each; error %s", text::Points(summary.points),
                                           quality.observations_per_point, error);
  std::fputs(Wrapped(seen, "  ", "    ").c_str(), stdout);
}

void Print(const map::MapOverview& map, const std::string& name) {
  const map::StoredSummary& summary = map.summary;
  const map::MapQuality& quality = map.quality;
  std::printf("%s: map \"%s\", revision %llu%s\n", Shown(name).c_str(), Shown(summary.info.name).c_str(),
              static_cast<unsigned long long>(summary.revision), map.being_written ? ", being extended" : "");
  if (summary.keyframes == 0) {
    std::printf("  no keyframes (cairn run --extend maps into it)\n");
  } else {
    PrintQuality(summary, quality);
  }
  const std::vector<ToldComponent> components = ToldComponents(map);
  PrintComponents(components, "  ", kListed);
  PrintFragments(FragmentsOf(components, map.sessions, map.being_written), Shown(name), "  ");
  if (const auto& anchor = map.summary.info.geo_anchor) {
    std::printf("%s", Wrapped(absl::StrCat("on the earth at ", DescribeAnchor(*anchor)), "  ", "    ").c_str());
  }
  PrintSizes(map);
  std::printf("  vocabulary %s, id %s\n",
              absl::StrCat(absl::Hex(summary.info.vocabulary_hash, absl::kZeroPad16)).c_str(), summary.info.id.c_str());
  PrintCameras(map);
  PrintSessions(map);
}

// What takes the whole map to be told.
struct InfoOfWhole {
  std::string digest, plan;  // empty: not asked for
  bool drawn = false;        // the picture that was asked for: not of a map without keyframes
};

absl::StatusOr<InfoOfWhole> LookAtAll(const InfoOptions& options, store::MapStore& file) {
  InfoOfWhole whole;
  if (options.digest) {
    CAIRN_ASSIGN_OR_RETURN(whole.digest, file.ContentDigest());
  }
  if (options.plan) {
    CAIRN_RETURN_IF_ERROR(LookInto(file, /*few=*/true, [&](const map::Snapshot& map) {
      constexpr int kPlanColumns = 72;
      whole.plan = BraillePlan(map, inspect::TogetherInOneFrame(map), kPlanColumns);
      return absl::OkStatus();
    }));
  }
  if (!options.picture.empty()) {
    CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> snapshot, file.LoadSnapshot());
    whole.drawn = !snapshot->keyframes().empty();
    if (whole.drawn) CAIRN_RETURN_IF_ERROR(DrawMap(*snapshot, options.picture));
  }
  return whole;
}

void AddWhole(const InfoOptions& options, const InfoOfWhole& whole, nlohmann::ordered_json* info) {
  if (options.digest) (*info)["digest"] = whole.digest;
  if (options.plan) (*info)["plan"] = whole.plan;
  if (!options.picture.empty()) (*info)["picture"] = whole.drawn ? nlohmann::ordered_json(options.picture) : nullptr;
}

void PrintWhole(const InfoOptions& options, const InfoOfWhole& whole) {
  for (const absl::string_view line : absl::StrSplit(whole.plan, '\n', absl::SkipEmpty())) {
    std::printf("  %.*s\n", static_cast<int>(line.size()), line.data());
  }
  if (options.digest) std::printf("  content digest %s\n", whole.digest.c_str());
  if (options.picture.empty()) return;
  std::printf("  picture: %s\n",
              whole.drawn ? text::Shown(options.picture).c_str() : "none, as there is nothing to draw");
}

bool NeedsAll(const InfoOptions& options) { return options.digest || options.plan || !options.picture.empty(); }

absl::StatusOr<map::MapOverview> ReadOverview(const InfoOptions& options) {
  if (options.server.empty()) return host::ReadOverview(options.map);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return service->Overview(options.map);
}

absl::Status Info(const InfoOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.picture, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.picture}, {InputFile(options.server, options.map)}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  CAIRN_ASSIGN_OR_RETURN(const map::MapOverview map, ReadOverview(options));
  TellNotes("info", map.notes);
  InfoOfWhole whole;
  if (NeedsAll(options)) {
    CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(options.server, options.map));
    CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                           store::OpenMapStore(source.path(), store::OpenMode::kRead));
    CAIRN_ASSIGN_OR_RETURN(whole, LookAtAll(options, *file));
  }
  if (options.json) {
    nlohmann::ordered_json info = Describe(map);
    AddWhole(options, whole, &info);
    PrintJson(info);
  } else {
    Print(map, options.map);
    PrintWhole(options, whole);
  }
  return absl::OkStatus();
}

}  // namespace

void AddInfoCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("info", "Describe a map: size, sessions, cameras, alignment");
  auto options = std::make_shared<InfoOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("--picture", options->picture, "Draw the map from above to this .png or .svg file");
  verb->add_flag("--plan", options->plan, "Where the cameras were, from above, in dots (UTF-8 braille)");
  verb->add_flag("--digest", options->digest, "Also print a hash of the content, equal for equal maps");
  verb->add_flag("--overwrite", options->overwrite, "Replace the picture if it exists");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "The map is not loaded: it takes the same time at any size. Means, and shares of the file, are those of at most\n"
      "256 keyframes, spread evenly. What is not looked at may be damaged.\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 5 version.\n"
      "Examples:\n"
      "  cairn info office.cairn --picture office.png\n"
      "  cairn info office.cairn --plan\n"
      "  cairn --server localhost:7878 info office");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::Status status = Info(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("info", status, options->json);
    };
  });
}

}  // namespace cairn::cli
