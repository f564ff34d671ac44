#include "cli/described_map.h"

#include <algorithm>
#include <cstdio>

#include "cli/align_report.h"
#include "cli/component_report.h"
#include "cli/geo_options.h"
#include "cli/unix_time.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

long long L(std::int64_t value) { return static_cast<long long>(value); }

std::vector<Fragment> Fragments(const api::MapDescription& map) {
  std::vector<FragmentCandidate> candidates;
  for (const api::ComponentInfo& component : map.components) {
    candidates.push_back({component.id, component.session, component.keyframes, component.joined_into,
                          component.world_from_component.has_value()});
  }
  return FragmentsOf(candidates, map.sessions, map.summary.writing);
}

}  // namespace

nlohmann::ordered_json SummaryAsJson(const api::MapSummary& map) {
  if (!map.status.ok()) return {{"name", map.name}, {"error", std::string(map.status.message())}};
  return {{"name", map.name},           {"id", map.id},
          {"title", map.title},         {"revision", map.revision},
          {"keyframes", map.keyframes}, {"points", map.points},
          {"cameras", map.cameras},     {"components", map.components},
          {"sessions", map.sessions},   {"format_version", map.format_version},
          {"bytes", map.file_bytes},    {"open", map.open},
          {"writing", map.writing},     {"geo_anchor", AnchorAsJson(map.geo_anchor)}};
}

nlohmann::ordered_json DescribedMapAsJson(const api::MapDescription& map) {
  nlohmann::ordered_json json = SummaryAsJson(map.summary);
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array(), components = cameras, sessions = cameras;
  for (const api::CameraInfo& camera : map.cameras) {
    cameras.push_back({{"id", camera.id.value()},
                       {"name", camera.name},
                       {"model", camera.camera.Describe()},
                       {"lens_corrected", camera.lens_corrected}});
  }
  for (const api::ComponentInfo& component : map.components) {
    components.push_back({{"id", component.id.value()},
                          {"keyframes", component.keyframes},
                          {"begun_by_session", component.session.value()},
                          {"aligned", component.world_from_component.has_value()},
                          {"joined_into", component.joined_into ? nlohmann::ordered_json(component.joined_into.value())
                                                                : nlohmann::ordered_json(nullptr)}});
  }
  for (const map::Session& session : map.sessions) {
    sessions.push_back({{"id", session.id.value()},
                        {"source", session.source},
                        {"camera", session.camera.value()},
                        {"duration_s", ToSeconds(std::max<TimeNs>(0, session.last_ns - session.first_ns))},
                        {"complete", session.complete},
                        {"removed", session.removed},
                        {"policy", map::SessionPolicyName(session.policy)},
                        {"result", map::SessionResultName(session.result)},
                        {"software_version", session.software_version},
                        {"started", FormatUnixTime(session.started_unix_ns)}});
  }
  // In place of their numbers.
  json["cameras"] = cameras;
  json["components"] = components;
  json["fragments"] = FragmentsAsJson(Fragments(map));
  json["sessions"] = sessions;
  return json;
}

void PrintDescribedMap(const api::MapDescription& map) {
  const api::MapSummary& summary = map.summary;
  std::printf("%s: map \"%s\", revision %lld%s\n", text::Shown(summary.name).c_str(),
              text::Shown(summary.title).c_str(), L(static_cast<std::int64_t>(summary.revision)),
              summary.writing ? ", being extended" : "");
  std::printf("  %lld keyframes, %lld points, %.1f MB, id %s\n", L(summary.keyframes), L(summary.points),
              static_cast<double>(summary.file_bytes) / 1e6, summary.id.c_str());
  if (summary.geo_anchor) std::printf("  on the earth at %s\n", DescribeAnchor(*summary.geo_anchor).c_str());
  for (const api::ComponentInfo& component : map.components) {
    if (component.joined_into) {
      std::printf("  component %u was joined to %u\n", component.id.value(), component.joined_into.value());
    } else {
      std::printf("  component %u: %lld keyframes, %s\n", component.id.value(), L(component.keyframes),
                  component.world_from_component ? "aligned to the world" : "not aligned (cairn align)");
    }
  }
  PrintFragments(Fragments(map), text::Shown(summary.name), "  ");
  for (const api::CameraInfo& camera : map.cameras) {
    std::printf("  camera %u, %s: %s%s\n", camera.id.value(), text::Shown(camera.name).c_str(),
                camera.camera.Describe().c_str(), camera.lens_corrected ? ", lens corrected by the map" : "");
  }
  for (const map::Session& session : map.sessions) {
    const std::string started = FormatUnixTime(session.started_unix_ns);
    std::printf("  session %u: %s, camera %u, %.1f s, by cairn %s%s%s%s\n", session.id.value(),
                text::Shown(session.source).c_str(), session.camera.value(),
                ToSeconds(std::max<TimeNs>(0, session.last_ns - session.first_ns)),
                text::Shown(session.software_version).c_str(), started.empty() ? "" : " on ", started.c_str(),
                session.complete  ? ""
                : summary.writing ? " (running, or cut off)"
                                  : " (cut off)");
  }
}

}  // namespace cairn::cli
