// cairn info: what is in a map.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "cli/cli.h"
#include "cli/component_report.h"
#include "cli/described_map.h"
#include "cli/pictures.h"
#include "cli/server_option.h"
#include "cli/session_report.h"
#include "cli/unix_time.h"
#include "health/map_vocabulary.h"
#include "store/map_store.h"
#include "store/writer_lock.h"

namespace cairn::cli {
namespace {

struct InfoOptions {
  std::string map;
  std::string server;
  std::string picture;
  bool digest = false;
  bool overwrite = false;
  bool json = false;
};

// Of all keyframes: features, features with a point, and neighbours in the covisibility graph.
struct Means {
  double features = 0.0;
  double matched = 0.0;
  double neighbours = 0.0;
};

Means ComputeMeans(const map::Snapshot& map) {
  Means means;
  map.keyframes().ForEach([&](const auto& keyframe) {
    means.features += static_cast<double>(keyframe->points.size());
    for (const PointId point : keyframe->points) means.matched += point ? 1.0 : 0.0;
    for (const map::CovisibilityEdge& edge : keyframe->covisible) {
      means.neighbours += edge.shared_points >= map::kMinCovisiblePoints ? 1.0 : 0.0;
    }
  });
  const double count = std::max<double>(1.0, static_cast<double>(map.keyframes().size()));
  return {means.features / count, means.matched / count, means.neighbours / count};
}

double MeanObservations(const map::Snapshot& map) {
  double sum = 0.0;
  map.points().ForEach([&](const auto& point) { sum += static_cast<double>(point->observations.size()); });
  return map.points().empty() ? 0.0 : sum / static_cast<double>(map.points().size());
}

nlohmann::ordered_json IdsAsJson(const std::vector<ComponentId>& ids) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const ComponentId id : ids) json.push_back(id.value());
  return json;
}

nlohmann::ordered_json Describe(const map::Snapshot& map, std::uintmax_t bytes, bool being_written) {
  const Means means = ComputeMeans(map);
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array(), sessions = nlohmann::ordered_json::array();
  for (const auto& [id, camera] : map.cameras()) {
    cameras.push_back(
        {{"id", id.value()}, {"name", camera.name}, {"model", camera.model.Describe()}, {"lens", LensAsJson(camera)}});
  }
  for (const auto& [id, session] : map.sessions()) {
    std::int64_t keyframes = 0;
    const SessionId session_id = id;
    TimeNs last_ns = session.last_ns;  // of one that is not complete: as far as the map goes
    map.keyframes().ForEach([&](const auto& keyframe) {
      if (keyframe->session != session_id) return;
      ++keyframes;
      last_ns = std::max(last_ns, keyframe->time_ns);
    });
    sessions.push_back({{"id", id.value()},
                        {"source", session.source},
                        {"camera", session.camera.value()},
                        {"keyframes", keyframes},
                        {"duration_s", ToSeconds(last_ns - session.first_ns)},
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
                        {"settings", nlohmann::ordered_json::parse(session.settings_json, nullptr, false)}});
  }
  return {{"id", map.info().id},
          {"name", map.info().name},
          {"revision", map.revision()},
          {"keyframes", map.keyframes().size()},
          {"points", map.points().size()},
          {"components", ComponentsAsJson(map)},
          {"features_per_keyframe", means.features},
          {"points_per_keyframe", means.matched},
          {"covisible_keyframes", means.neighbours},
          {"observations_per_point", MeanObservations(map)},
          {"vocabulary_hash", absl::StrCat(absl::Hex(map.info().vocabulary_hash, absl::kZeroPad16))},
          {"bytes", bytes},
          {"created", FormatUnixTime(map.info().created_unix_ns)},
          {"software_version", map.info().software_version},
          {"cameras", cameras},
          {"sessions", sessions}};
}

void Print(const nlohmann::ordered_json& info, const map::Snapshot& map, const std::string& path) {
  const auto number = [&](const char* key) { return info[key].get<double>(); };
  std::printf("%s: map \"%s\", revision %lld\n", path.c_str(), info["name"].get<std::string>().c_str(),
              info["revision"].get<long long>());
  std::printf("  %lld keyframes with %.0f features (%.0f of them with a point), %.1f covisible each\n",
              info["keyframes"].get<long long>(), number("features_per_keyframe"), number("points_per_keyframe"),
              number("covisible_keyframes"));
  std::printf("  %lld points, seen %.1f times each\n", info["points"].get<long long>(),
              number("observations_per_point"));
  PrintComponents(map, "  ");
  std::printf("  %.1f MB, vocabulary %s, id %s\n", number("bytes") / 1e6,
              info["vocabulary_hash"].get<std::string>().c_str(), info["id"].get<std::string>().c_str());
  for (const auto& camera : info["cameras"]) {
    std::printf("  camera %lld, %s: %s\n", camera["id"].get<long long>(), camera["name"].get<std::string>().c_str(),
                camera["model"].get<std::string>().c_str());
    if (camera["lens"].is_null()) continue;
    const auto lens = [&](const char* key) { return camera["lens"][key].get<double>(); };
    std::printf(
        "    lens corrected by the map: focal length x %.4f, k1 %.4f, k2 %.4f (%.2f px on average, up to %.2f px)\n",
        lens("focal_scale"), lens("k1"), lens("k2"), lens("shift_rms_px"), lens("shift_max_px"));
  }
  for (const auto& session : info["sessions"]) {
    std::printf(
        "  session %lld: %s, camera %lld, %.1f s, %lld keyframes%s, by cairn %s%s%s\n", session["id"].get<long long>(),
        session["source"].get<std::string>().c_str(), session["camera"].get<long long>(),
        session["duration_s"].get<double>(), session["keyframes"].get<long long>(),
        session["keyframes"] == 0        ? ", added nothing"
        : session["result"] == "located" ? ", in an earlier component"
        : session["result"] == "apart"   ? ", joined to no earlier component"
                                         : "",
        session["software_version"].get<std::string>().c_str(),
        session["started"].get<std::string>().empty() ? "" : (" on " + session["started"].get<std::string>()).c_str(),
        session["complete"].get<bool>()  ? ""
        : session["cut_off"].get<bool>() ? " (cut off: its process has ended)"
                                         : " (running, or cut off)");
    PrintLoopsAndTrajectory(map.sessions().at(SessionId(session["id"].get<SessionId::Value>())), "    ");
  }
}

absl::Status Info(const InfoOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.picture, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.picture}, {options.map}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                         store::OpenMapStore(options.map, store::OpenMode::kRead));
  for (const std::string& note : file->notes()) std::cerr << "cairn info: " << note << "\n";
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, file->LoadSnapshot());
  CAIRN_ASSIGN_OR_RETURN(const health::MapVocabulary vocabulary, health::LoadVocabulary(*file));
  if (!vocabulary.note.empty()) std::cerr << "cairn info: " << vocabulary.note << "\n";
  std::error_code error;
  const bool being_written = store::WriterLock::IsHeld(std::filesystem::weakly_canonical(options.map, error).string());
  nlohmann::ordered_json info = Describe(*map, std::filesystem::file_size(options.map, error), being_written);
  if (options.digest) {
    CAIRN_ASSIGN_OR_RETURN(info["digest"], file->ContentDigest());
  }
  if (!options.picture.empty()) CAIRN_RETURN_IF_ERROR(DrawMap(*map, options.picture));
  if (options.json) {
    PrintJson(info);
  } else {
    Print(info, *map, options.map);
    if (options.digest) std::printf("  content digest %s\n", info["digest"].get<std::string>().c_str());
    if (!options.picture.empty()) std::printf("  picture: %s\n", options.picture.c_str());
  }
  return absl::OkStatus();
}

absl::Status InfoOfServed(const InfoOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  CAIRN_ASSIGN_OR_RETURN(const api::MapDescription map, service->Describe(options.map));
  if (options.json) {
    PrintJson(DescribedMapAsJson(map));
  } else {
    PrintDescribedMap(map);
  }
  return absl::OkStatus();
}

}  // namespace

void AddInfoCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("info", "Describe a map: size, sessions, cameras, alignment");
  auto options = std::make_shared<InfoOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("--picture", options->picture, "Draw the map from above to this .png or .svg file");
  verb->add_flag("--digest", options->digest, "Also print a hash of the content, equal for equal maps");
  verb->add_flag("--overwrite", options->overwrite, "Replace the picture if it exists");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Examples:\n"
      "  cairn info office.cairn --picture office.png\n"
      "  cairn --server localhost:7878 info office");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const bool served = !options->server.empty();
      if (served && (options->digest || !options->picture.empty())) {
        return FailUsage("info", "--digest and --picture need the map file: not with --server", options->json);
      }
      const absl::Status status = served ? InfoOfServed(*options) : Info(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("info", status, options->json);
    };
  });
}

}  // namespace cairn::cli
