#include "cli/map_run_report.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "cli/component_report.h"
#include "cli/sample_statistics.h"
#include "cli/session_report.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// Processor time of the stages of the feature module, per keyframe.
nlohmann::ordered_json StageStatistics(const std::vector<mapping::KeyframeReport>& reports) {
  using mapping::StageTimes;
  constexpr std::pair<const char*, double StageTimes::*> kStages[] = {{"all", &StageTimes::cpu_ms},
                                                                      {"extract", &StageTimes::extract_ms},
                                                                      {"track", &StageTimes::track_ms},
                                                                      {"relocate", &StageTimes::relocate_ms},
                                                                      {"new_points", &StageTimes::new_points_ms},
                                                                      {"fuse", &StageTimes::fuse_ms},
                                                                      {"adjust", &StageTimes::adjust_ms},
                                                                      {"cull", &StageTimes::cull_ms},
                                                                      {"commit", &StageTimes::commit_ms}};
  nlohmann::ordered_json stages;
  for (const auto& [name, time] : kStages) {
    SampleReservoir samples;
    for (const mapping::KeyframeReport& report : reports) samples.Add(static_cast<float>(report.times.*time));
    stages[name] = SampleStatistics(samples);
  }
  return stages;
}

// What the feature module made of each keyframe of the odometry.
nlohmann::ordered_json KeyframeStates(const std::vector<mapping::KeyframeReport>& reports) {
  nlohmann::ordered_json states = nlohmann::ordered_json::array();
  for (const mapping::KeyframeReport& report : reports) {
    states.push_back({{"t", ToSeconds(report.time_ns)},
                      {"state", mapping::FeatureStateName(report.state)},
                      {"inliers", report.inliers},
                      {"inserted", report.inserted},
                      {"relocated", report.relocated},
                      {"restarted", report.restarted}});
  }
  return states;
}

// "41 good, 3 poor, 11 lost", in this order, and what ended the losses.
std::string StateSummary(const std::vector<mapping::KeyframeReport>& reports) {
  using mapping::FeatureState;
  constexpr FeatureState kStates[] = {FeatureState::kInitializing, FeatureState::kGood, FeatureState::kPoor,
                                      FeatureState::kLost};
  std::string summary;
  for (const FeatureState state : kStates) {
    const auto count = std::count_if(reports.begin(), reports.end(), [&](const auto& r) { return r.state == state; });
    if (count == 0) continue;
    absl::StrAppend(&summary, summary.empty() ? "" : ", ", count, " ", mapping::FeatureStateName(state));
  }
  const auto restarts = std::count_if(reports.begin(), reports.end(), [](const auto& r) { return r.restarted; });
  const auto relocated = std::count_if(reports.begin(), reports.end(), [](const auto& r) { return r.relocated; });
  if (relocated > 0) absl::StrAppend(&summary, "; found again in the map ", relocated, " times");
  if (restarts > 0) absl::StrAppend(&summary, "; started again from the odometry's depths ", restarts, " times");
  return summary;
}

// The components of the map, with what this session has in each.
nlohmann::ordered_json SharesAsJson(const map::Snapshot& map, const engine::SessionReport& report, TimeNs first_ns) {
  nlohmann::ordered_json json = ComponentsAsJson(ToldComponents(map));
  for (nlohmann::ordered_json& component : json) {
    const auto share = std::ranges::find(report.components, ComponentId(component["id"].get<ComponentId::Value>()),
                                         &engine::ComponentShare::id);
    component["frames"] = share == report.components.end() ? 0 : share->frames;
    if (share == report.components.end() || share->frames == 0) continue;
    component["from_s"] = ToSeconds(share->first_ns - first_ns);
    component["to_s"] = ToSeconds(share->last_ns - first_ns);
  }
  return json;
}

nlohmann::ordered_json JoinsAsJson(const engine::SessionReport& report, TimeNs first_ns) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < report.joins.size(); ++i) {
    const mapping::JoinReport& join = report.joins[i];
    nlohmann::ordered_json one = {{"at_s", ToSeconds(report.join_times_ns[i] - first_ns)},
                                  {"component", join.component.value()},
                                  {"into", join.into.value()},
                                  {"matches", join.evidence.guided_matches},
                                  {"scale", join.scale},
                                  {"keyframes_agreeing", join.evidence.neighbours_agreeing + join.sightings_agreeing},
                                  {"keyframes_checked", join.evidence.neighbours_checked + join.sightings_checked},
                                  {"alignments_apart_m", nullptr}};
    if (join.gap) one["alignments_apart_m"] = join.gap->shift;
    json.push_back(std::move(one));
  }
  return json;
}

// Of the poses in the files.
struct PoseQuality {
  std::int64_t poses = 0;
  std::int64_t below = 0;  // the limit
};

PoseQuality CountQuality(const engine::SessionReport& report) {
  PoseQuality count;
  for (const engine::FramePose& frame : report.frame_poses) {
    if (!frame.map_from_camera || frame.component != ComponentOfFiles(report)) continue;
    ++count.poses;
    count.below += frame.quality < mapping::kQualityLimit ? 1 : 0;
  }
  return count;
}

nlohmann::ordered_json QualityAsJson(const engine::SessionReport& report, const map::Snapshot& map, TimeNs first_ns) {
  if (!report.quality) return nullptr;
  const mapping::TrajectoryQuality& quality = *report.quality;
  const std::optional<Sim3>& world_from_map = map.WorldFrom(ComponentOfFiles(report));
  const double scale = world_from_map ? world_from_map->scale() : 1.0;
  const PoseQuality count = CountQuality(report);
  nlohmann::ordered_json json = {{"trajectory", quality.quality},    {"limit", mapping::kQualityLimit},
                                 {"poses_below", count.below},       {"sigma_position", scale * quality.position_sigma},
                                 {"spread", scale * quality.spread}, {"weakest_points", nullptr},
                                 {"weakest_at_s", nullptr},          {"warning", quality.warning}};
  if (quality.weakest_points >= 0) {
    json["weakest_points"] = quality.weakest_points;
    json["weakest_at_s"] = ToSeconds(quality.weakest_ns - first_ns);
  }
  return json;
}

// The first line: what must be known before anything else is believed.
void PrintDoubt(const engine::SessionReport& report) {
  if (!report.quality) return;
  const PoseQuality count = CountQuality(report);
  if (!report.quality->warning.empty()) {
    text::Say(absl::StrFormat("NOT RELIABLE (quality %.2f, limit %.2f): %s\n", report.quality->quality,
                              mapping::kQualityLimit, report.quality->warning));
  } else if (2 * count.below > count.poses) {
    text::Say(absl::StrFormat(
        "NOT RELIABLE: %lld of %lld poses have a quality below %.2f (--quality FILE tells which)\n",
        static_cast<long long>(count.below), static_cast<long long>(count.poses), mapping::kQualityLimit));
  }
}

// How many keyframes show another calibration, against the rest of the map; 0 if these are too few to tell.
int ContradictCalibration(const engine::SessionReport& report) {
  constexpr int kEnough = 3;
  const auto found = report.joins_rejected.find(mapping::kCalibrationRefused);
  return found != report.joins_rejected.end() && found->second >= kEnough ? found->second : 0;
}

void PrintCalibration(const engine::SessionReport& report) {
  if (const int keyframes = ContradictCalibration(report); keyframes > 0) {
    text::Say(absl::StrFormat(
        "WARNING: the calibration does not fit: %d keyframes show another focal length, or principal point, against "
        "the rest of the map; what was mapped is bent, and not joined where it shows; calibrate the camera\n",
        keyframes));
  }
}

// "found in component 1 after 0.4 s (joined at 2.1 s)", "component 2, joined component 1 at 12.3 s", or what it means
// that neither happened.
std::string WhereItIs(const engine::SessionReport& report, const map::Session& session) {
  const auto seconds = [&](TimeNs time_ns) { return absl::StrFormat("%.1f s", ToSeconds(time_ns - session.first_ns)); };
  if (report.located) {
    // Found before there was a component of its own to speak of, or with it.
    const mapping::JoinReport& first = report.joins.front();
    const std::string joined = seconds(report.join_times_ns.front());
    std::string text = report.located->time_ns < report.join_times_ns.front()
                           ? absl::StrCat("found in component ", report.located->component.value(), " after ",
                                          seconds(report.located->time_ns), ", proven and joined at ", joined)
                           : absl::StrCat("component ", first.component.value(), ", joined component ",
                                          first.into.value(), " at ", joined);
    for (std::size_t i = 1; i < report.joins.size(); ++i) {
      absl::StrAppend(&text, "; component ", report.joins[i].component.value(), " joined component ",
                      report.joins[i].into.value(), " at ", seconds(report.join_times_ns[i]));
    }
    return text;
  }
  if (session.policy == map::SessionPolicy::kCreate) return "";
  std::string text =
      absl::StrCat("component ", report.component.value(),
                   ", a place of its own: nothing that this session saw was found in the rest of the map");
  int attempts = 0;
  for (const auto& [why, count] : report.joins_rejected) attempts += count;
  if (attempts > 0) {
    const auto most =
        std::ranges::max_element(report.joins_rejected, {}, [](const auto& entry) { return entry.second; });
    absl::StrAppend(&text, " beyond doubt (", attempts, " keyframes looked alike; mostly: ", most->first, ")");
  }
  return text;
}

void PrintShares(const engine::SessionReport& report, const map::Session& session) {
  const auto with_frames = std::ranges::count_if(report.components, [](const auto& share) { return share.frames > 0; });
  if (with_frames < 2) return;
  text::Say(absl::StrFormat(
      "  this session is in %lld components: tracking was lost, and began anew where nothing known was seen.\n"
      "  Each is right in itself, but how they lie to each other is not known; files hold component %u alone\n",
      static_cast<long long>(with_frames), ComponentOfFiles(report).value()));
  for (const engine::ComponentShare& share : report.components) {
    if (share.frames == 0) continue;
    text::Say(absl::StrFormat("    component %u: %s, %lld frames from %.1f to %.1f s\n", share.id.value(),
                              text::Keyframes(share.keyframes), static_cast<long long>(share.frames),
                              ToSeconds(share.first_ns - session.first_ns),
                              ToSeconds(share.last_ns - session.first_ns)));
  }
}

nlohmann::ordered_json ReportAsJson(const std::string& map_name, const engine::SessionReport& report,
                                    const map::Snapshot& map, const io::SourceInfo& info, const FeedReport& feed,
                                    const InterruptWatch& interrupt, std::optional<std::int64_t> live_poses) {
  const map::Session& session = map.sessions().at(report.session);
  nlohmann::ordered_json json = {{"map", map_name}};
  AddFrameAndUnit(map.WorldFrom(ComponentOfFiles(report)).has_value(), &json);
  AddFeedJson(feed, info, report.frames_tracked, interrupt, &json);
  json.update(
      {{"direct_keyframes", report.direct_keyframes},
       {"keyframes", report.keyframes},
       {"points", report.points},
       {"segments", report.odometry.segments},
       {"recoveries", report.odometry.recoveries},
       {"session", report.session.value()},
       {"result", map::SessionResultName(report.result)},
       {"component", report.component.value()},
       {"component_of_files", ComponentOfFiles(report).value()},
       {"located_after_s",
        report.located ? nlohmann::ordered_json(ToSeconds(report.located->time_ns - session.first_ns)) : nullptr},
       {"joined", JoinsAsJson(report, session.first_ns)},
       {"joins_rejected", report.joins_rejected},
       {"calibration_contradicted", ContradictCalibration(report) > 0},
       {"components", SharesAsJson(map, report, session.first_ns)},
       {"feature_losses", report.feature_losses},
       {"loops", LoopsAsJson(session)},
       {"loops_rejected", report.loops_rejected},
       {"trajectory", TrajectoryAsJson(session)},
       {"quality", QualityAsJson(report, map, session.first_ns)},
       {"lens", LensAsJson(report.lens)},
       {"frame_ms", SampleStatistics(report.frame_ms)},
       {"frame_ms_correcting", SampleStatistics(report.frame_ms_correcting)},
       {"loop_correction_ms", SampleStatistics(report.correction_ms)},
       {"loop_adjustment_ms", SampleStatistics(report.adjustment_ms)},
       {"track_ms", SampleStatistics(report.odometry.track.samples_ms)},
       {"keyframe_ms", SampleStatistics(report.keyframe_ms)},
       {"keyframe_cpu_ms", StageStatistics(report.keyframe_reports)},
       {"keyframe_states", KeyframeStates(report.keyframe_reports)},
       {"loop_search_ms", SampleStatistics(report.loop_search_ms)}});
  if (live_poses) json["live_poses"] = *live_poses;
  return json;
}

void PrintForPeople(const RunOptions& options, const engine::SessionReport& report, const map::Session& session,
                    const io::SourceInfo& info, const FeedReport& feed, const InterruptWatch& interrupt,
                    std::optional<std::int64_t> live_poses) {
  PrintDoubt(report);
  PrintCalibration(report);
  text::Say(absl::StrFormat("%s: %s, %s\n", text::Shown(options.map), text::Keyframes(report.keyframes),
                            text::Points(report.points)));
  if (const std::string where = WhereItIs(report, session); !where.empty()) text::Say(absl::StrFormat("  %s\n", where));
  for (const mapping::JoinReport& join : report.joins) {
    if (!join.gap) continue;
    text::Say(absl::StrFormat(
        "  components %u and %u were both aligned to the world, %.3f m and %.2f deg apart where they meet: the "
        "alignment of %u stays\n",
        join.component.value(), join.into.value(), join.gap->shift, join.gap->turn_deg, join.into.value()));
  }
  PrintFeed(feed, info, report.frames_tracked, interrupt);
  text::Say(
      absl::StrFormat("  per frame %.2f ms median, %.2f ms mean; per keyframe %.0f ms median in the feature module\n",
                      report.frame_ms.Percentile(0.5), report.frame_ms.mean(), report.keyframe_ms.Percentile(0.5)));
  PrintLoopsAndTrajectory(session, "  ");
  PrintShares(report, session);
  if (report.lens) text::Say(absl::StrFormat("  lens %s\n", report.lens->reason));
  text::Say(absl::StrFormat("  keyframes of the odometry in the feature module: %s\n",
                            StateSummary(report.keyframe_reports)));
  if (report.odometry.recoveries > 0) {
    text::Say(absl::StrFormat("  the odometry began at a view that the map knows: %lld of %lld starts\n",
                              static_cast<long long>(report.odometry.recoveries),
                              static_cast<long long>(report.odometry.segments)));
  }
  if (report.feature_losses > 0) {
    text::Say(absl::StrFormat("  the feature map was lost %lld times%s\n",
                              static_cast<long long>(report.feature_losses),
                              report.odometry.segments < 2 ? "; the odometry bridged it" : ""));
  }
  if (live_poses) {
    text::Say(absl::StrFormat("  %lld of %lld frames had a pose in the map when they were tracked\n",
                              static_cast<long long>(*live_poses), static_cast<long long>(report.frames)));
    if (!feed.realtime && !options.session.deterministic) {
      text::Say("  read as fast as possible, frames are ahead of the map: --realtime answers as for a live camera\n");
    }
  }
}

}  // namespace

ComponentId ComponentOfFiles(const engine::SessionReport& report) {
  const auto most = std::ranges::max_element(report.components, {}, &engine::ComponentShare::frames);
  return most == report.components.end() ? report.component : most->id;
}

void PrintMapRunReport(const RunOptions& options, const engine::SessionReport& report, const map::Snapshot& map,
                       const io::SourceInfo& info, const FeedReport& feed, const InterruptWatch& interrupt,
                       std::optional<std::int64_t> live_poses) {
  if (options.json) {
    PrintJson(ReportAsJson(options.map, report, map, info, feed, interrupt, live_poses));
  } else {
    PrintForPeople(options, report, map.sessions().at(report.session), info, feed, interrupt, live_poses);
  }
}

}  // namespace cairn::cli
