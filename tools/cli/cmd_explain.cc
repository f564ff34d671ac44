// cairn explain: why an image is, or is not, found in a map.
#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <set>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/map_camera.h"
#include "cli/map_to_read.h"
#include "cli/newest_view.h"
#include "client/map_reader.h"
#include "client/query_image.h"
#include "inspect/explanation.h"
#include "inspect/measures.h"
#include "io/camera_file.h"
#include "io/frame_source.h"
#include "plot/inspect_figures.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

constexpr std::size_t kShownCandidates = 5;

struct ExplainCommand {
  std::string map;
  ServerChoice server;
  std::string image;
  std::string camera;
  std::string picture;
  bool overwrite = false;
  bool json = false;
};

// The image as it was compared with the map, and what came of it.
struct Explained {
  cv::Mat image;  // of the pinhole's size
  client::QueryFeatures query;
  inspect::Explanation explanation;
};

absl::StatusOr<Camera> CameraFor(const ExplainCommand& command, const map::Snapshot& map, const cv::Mat& image) {
  if (!command.camera.empty()) {
    CAIRN_ASSIGN_OR_RETURN(const io::CameraFile file, io::LoadCamera(command.camera));
    return file.camera;
  }
  return CameraOfSize(CamerasOf(map), image.size(), command.image);
}

absl::StatusOr<Explained> ExplainImage(const ExplainCommand& command, const tracking::MapView& view) {
  const map::Snapshot& map = view.map();
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat raw, io::ReadGrayImage(command.image));
  CAIRN_ASSIGN_OR_RETURN(const Camera camera, CameraFor(command, map, raw));
  CAIRN_RETURN_IF_ERROR(client::CheckImage(raw, camera, "explain"));
  CAIRN_ASSIGN_OR_RETURN(const image::Undistorter undistorter, image::Undistorter::Create(camera));
  Explained explained;
  CAIRN_ASSIGN_OR_RETURN(explained.image, undistorter.Undistort(raw));
  for (const double scale : client::ScalesFor(map, undistorter.pinhole())) {
    CAIRN_ASSIGN_OR_RETURN(explained.query, client::ExtractQuery(map, undistorter, explained.image, scale, 0));
    CAIRN_ASSIGN_OR_RETURN(explained.explanation,
                           inspect::Explain(view, explained.query.pinhole, explained.query.features));
    const tracking::Relocalization& result = explained.explanation.result;
    if (result.localized || !result.rivals.empty()) break;
  }
  return explained;
}

// The keyframe that observes most of these points.
KeyframeId KeyframeOf(const map::Snapshot& map, const std::vector<tracking::GroupMatch>& matches) {
  std::map<KeyframeId, int> seen;
  for (const tracking::GroupMatch& match : matches) {
    for (const map::Observation& observation : map.point(match.point).observations) ++seen[observation.keyframe];
  }
  const auto most = std::ranges::max_element(seen, {}, [](const auto& entry) { return entry.second; });
  return most == seen.end() ? KeyframeId() : most->first;
}

// The keyframe that is drawn beside the image: of the answer, or of the group that got furthest.
KeyframeId Beside(const map::Snapshot& map, const inspect::Explanation& e) {
  if (e.result.localized) return e.result.place.reference_keyframe;
  if (!e.result.rivals.empty()) return e.result.rivals[0].reference_keyframe;
  if (e.best_group < 0) return KeyframeId();
  const tracking::TracedGroup& group = e.trace.groups[static_cast<std::size_t>(e.best_group)];
  const KeyframeId of_matches = KeyframeOf(map, group.matches);
  return of_matches ? of_matches : group.keyframes[0];
}

// What is drawn, where nothing was found: the group that got furthest.
const tracking::TracedGroup* GroupDrawn(const inspect::Explanation& e) {
  const bool found = e.result.localized || !e.result.rivals.empty();
  return found || e.best_group < 0 ? nullptr : &e.trace.groups[static_cast<std::size_t>(e.best_group)];
}

absl::Status DrawMatches(const ExplainCommand& command, const map::Snapshot& map, const Explained& explained) {
  const inspect::Explanation& e = explained.explanation;
  plot::MatchFigure figure;
  figure.title = e.result.localized ? "Found" : absl::StrCat("Not found: ", inspect::StageName(e.result.stage));
  figure.subtitle = e.result.localized
                        ? absl::StrFormat("%d inliers in %d of %d parts of the image", e.result.counts.inliers,
                                          e.result.counts.cells, e.result.counts.visible_cells)
                        : text::Cut(e.result.reason, 120);
  const tracking::TracedGroup* const drawn_group = GroupDrawn(e);
  if (drawn_group != nullptr && drawn_group->tried && !drawn_group->attempt.reason.empty()) {
    figure.subtitle = text::Cut(drawn_group->attempt.reason, 120);
  }
  figure.left = {"the image", explained.query.pinhole.width_px, explained.query.pinhole.height_px, explained.image, {}};
  for (const image::Keypoint& keypoint : explained.query.features.keypoints) {
    figure.left.features.emplace_back(keypoint.x_px, keypoint.y_px);
  }
  plot::FigureOptions to;
  to.overwrite = command.overwrite;
  to.width_pt = 1000.0;
  const KeyframeId beside = Beside(map, e);
  if (!beside) return plot::WriteMatchFigure(figure, command.picture, to);  // it was compared with none
  const map::Keyframe& keyframe = map.keyframe(beside);
  const Pinhole& pinhole = map.pinhole(keyframe.camera);
  const std::string of_group =
      drawn_group == nullptr ? "" : absl::StrCat(" of the group of ", drawn_group->keyframes[0].value());
  figure.right = {absl::StrCat("keyframe ", beside.value(), of_group, " (the map keeps no image)"),
                  pinhole.width_px,
                  pinhole.height_px,
                  cv::Mat(),
                  {}};
  std::map<PointId, std::uint32_t> feature_of;
  const auto features = keyframe.features.Get();
  for (std::uint32_t i = 0; i < keyframe.points.size(); ++i) {
    const image::Keypoint& keypoint = features->features.keypoints[i];
    figure.right.features.emplace_back(keypoint.x_px, keypoint.y_px);
    if (keyframe.points[i]) feature_of.emplace(keyframe.points[i], i);
  }
  std::set<std::pair<std::uint32_t, PointId>> drawn;
  const auto add = [&](std::uint32_t feature, PointId point, bool inlier) {
    const auto at = feature_of.find(point);
    if (at == feature_of.end() || !drawn.insert({feature, point}).second) return;
    figure.matches.push_back({figure.left.features[feature], figure.right.features[at->second], inlier});
  };
  const tracking::TracedGroup* group =
      e.best_group >= 0 ? &e.trace.groups[static_cast<std::size_t>(e.best_group)] : nullptr;
  const std::vector<tracking::PointObservation>* inliers = e.result.localized         ? &e.result.place.inliers
                                                           : !e.result.rivals.empty() ? &e.result.rivals[0].inliers
                                                           : group != nullptr         ? &group->attempt.place.inliers
                                                                                      : nullptr;
  if (inliers != nullptr) {
    for (const tracking::PointObservation& inlier : *inliers) add(inlier.feature, inlier.point, true);
  }
  if (group != nullptr) {
    for (const tracking::GroupMatch& match : group->matches) add(match.feature, match.point, false);
  }
  return plot::WriteMatchFigure(figure, command.picture, to);
}

nlohmann::ordered_json CountsAsJson(const tracking::RelocalizationCounts& counts) {
  return {{"features", counts.features},
          {"candidates", counts.candidates},
          {"word_matches", counts.word_matches},
          {"pnp_inliers", counts.pnp_inliers},
          {"guided_matches", counts.guided_matches},
          {"inliers", counts.inliers},
          {"visible_points", counts.visible},
          {"cells", counts.cells},
          {"visible_cells", counts.visible_cells}};
}

void PrintExplanationJson(const ExplainCommand& command, const map::Snapshot& map, const inspect::Explanation& e) {
  nlohmann::ordered_json candidates = nlohmann::ordered_json::array(), groups = candidates, near = candidates,
                         rivals = candidates;
  for (const place::Candidate& candidate : e.trace.candidates) {
    candidates.push_back(
        {{"keyframe", candidate.id}, {"score", candidate.score}, {"common_words", candidate.common_words}});
  }
  for (const tracking::TracedGroup& group : e.trace.groups) {
    nlohmann::ordered_json& json = groups.emplace_back();
    json = {{"keyframe", group.keyframes[0].value()},
            {"keyframes", group.keyframes.size()},
            {"matches", group.matches.size()},
            {"tried", group.tried}};
    if (!group.tried) continue;
    json["stage"] = inspect::StageName(group.attempt.stage);
    json["reason"] = group.attempt.reason;
    json["counts"] = CountsAsJson(group.attempt.counts);
  }
  for (const inspect::NearKeyframe& keyframe : e.near) {
    near.push_back({{"keyframe", keyframe.keyframe.value()},
                    {"distance", keyframe.distance},
                    {"distance_over_depth", keyframe.distance_share},
                    {"angle_deg", keyframe.angle_deg}});
  }
  for (const tracking::FoundPlace& rival : e.result.rivals) {
    rivals.push_back({{"keyframe", rival.reference_keyframe.value()}, {"inliers", rival.inliers.size()}});
  }
  nlohmann::ordered_json json = {{"map", command.map}, {"revision", map.revision()}, {"image", command.image}};
  json.update({{"localized", e.result.localized},
               {"beyond_doubt", e.result.beyond_doubt},
               {"stage", inspect::StageName(e.result.stage)},
               {"reason", e.result.reason},
               {"counts", CountsAsJson(e.result.counts)},
               {"candidates", candidates},
               {"groups", groups},
               {"rivals", rivals},
               {"near_keyframes", near},
               {"advice", e.advice}});
  if (!command.picture.empty()) {
    const KeyframeId beside = Beside(map, e);
    json["drawn_keyframe"] = beside ? nlohmann::ordered_json(beside.value()) : nlohmann::ordered_json();
  }
  PrintJson(json);
}

void PrintExplanation(const ExplainCommand& command, const inspect::Explanation& e, bool compared) {
  const tracking::RelocalizationCounts& counts = e.result.counts;
  std::string head = absl::StrCat(text::Shown(command.image), ": ",
                                  e.result.localized ? "found" : absl::StrCat("not found, ", e.result.reason));
  if (e.result.localized) {
    absl::StrAppend(&head, " at keyframe ", e.result.place.reference_keyframe.value(),
                    e.result.beyond_doubt ? ", beyond doubt" : "");
  }
  std::fputs(text::Wrapped(head, "", "  ").c_str(), stdout);
  std::printf("  1 features    %d\n", counts.features);
  std::printf("  2 candidates  %d keyframes share words with it", counts.candidates);
  for (std::size_t i = 0; i < std::min(e.trace.candidates.size(), kShownCandidates); ++i) {
    const place::Candidate& candidate = e.trace.candidates[i];
    std::printf("%s%u (%.3f)", i == 0 ? ":\n                " : ", ", candidate.id, candidate.score);
  }
  std::printf("\n  3 matches     %d with the points of the best group of keyframes\n", counts.word_matches);
  std::printf("  4 pnp         %d of them agree on a pose\n", counts.pnp_inliers);
  std::printf("  5 refinement  %d of %d points in view found, in %d of %d parts of the image\n", counts.inliers,
              counts.visible, counts.cells, counts.visible_cells);
  std::printf("  6 rivals      %zu other places that fit\n", e.result.rivals.empty() ? 0 : e.result.rivals.size() - 1);
  std::vector<std::vector<std::string>> rows;
  for (const tracking::TracedGroup& group : e.trace.groups) {
    rows.push_back({absl::StrCat(group.keyframes[0].value()), absl::StrCat(group.matches.size()),
                    group.tried ? absl::StrCat(group.attempt.counts.pnp_inliers) : "-",
                    group.tried ? absl::StrCat(group.attempt.counts.inliers) : "-",
                    group.tried ? inspect::StageName(group.attempt.stage) : "not tried"});
  }
  if (!rows.empty()) {
    std::fputs(
        text::TextTable(
            {{"around keyframe", false}, {"matches", false}, {"pnp", false}, {"inliers", false}, {"came to", true}},
            rows, "  ")
            .c_str(),
        stdout);
  }
  rows.clear();
  for (const inspect::NearKeyframe& near : e.near) {
    rows.push_back({absl::StrCat(near.keyframe.value()), absl::StrFormat("%.3g", near.distance),
                    absl::StrFormat("%.2f", near.distance_share), absl::StrFormat("%.0f", near.angle_deg)});
  }
  if (!rows.empty()) {
    std::fputs(text::TextTable(
                   {{"near keyframe", false}, {"distance", false}, {"over depth", false}, {"degrees aside", false}},
                   rows, "  ")
                   .c_str(),
               stdout);
  }
  for (const std::string& advice : e.advice) std::fputs(text::Wrapped(advice, "  * ", "    ").c_str(), stdout);
  if (command.picture.empty()) return;
  std::printf("  picture: %s%s\n", text::Shown(command.picture).c_str(),
              compared ? "" : "\n    the image alone: it was compared with no keyframe");
}

absl::StatusOr<bool> RunExplain(const ExplainCommand& command) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(command.picture, command.overwrite));
  CAIRN_RETURN_IF_ERROR(
      CheckDistinct({command.picture}, {InputFile(command.server, command.map), command.image, command.camera}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(command.picture));
  TellLogDamage("explain", command.server, command.map);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(command.server, command.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::MapReader> reader, client::MapReader::Open(source.path()));
  CAIRN_ASSIGN_OR_RETURN(const Explained explained, AskNewest(*reader, [&](const tracking::MapView& view) {
                           return ExplainImage(command, view);
                         }));
  const map::Snapshot& map = reader->view()->map();
  if (!command.picture.empty()) CAIRN_RETURN_IF_ERROR(DrawMatches(command, map, explained));
  if (command.json) {
    PrintExplanationJson(command, map, explained.explanation);
  } else {
    PrintExplanation(command, explained.explanation, Beside(map, explained.explanation).valid());
  }
  return explained.explanation.result.localized;
}

}  // namespace

void AddExplainCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("explain", "Why an image is, or is not, found in a map, and what would help");
  auto command = std::make_shared<ExplainCommand>();
  verb->add_option("MAP", command->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("IMAGE", command->image, "One image file")->required();
  verb->add_option("--camera", command->camera,
                   "Its calibration (camera.yaml); else that of the map's camera of the same size");
  verb->add_option("--picture", command->picture, "Draw the matches side by side to this .png or .svg file");
  verb->add_flag("--overwrite", command->overwrite, "Replace the picture if it exists");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "The search is the one of cairn localize. Distances are metres where the map is aligned, else map units.\n"
      "Exit codes: 0 found, 1 failure, 2 usage, 3 map damaged, 4 not found, 5 version.\n"
      "Examples:\n"
      "  cairn explain office.cairn photo.jpg --picture matches.png\n"
      "  cairn explain office.cairn photo.jpg --camera phone.yaml --json");
  verb->callback([=, &app] {
    command->server = ServerOf(app);
    *action = [=] {
      const auto found = RunExplain(*command);
      if (!found.ok()) return Fail("explain", found.status(), command->json);
      return static_cast<int>(*found ? kOk : kNotLocalized);
    };
  });
}

}  // namespace cairn::cli
