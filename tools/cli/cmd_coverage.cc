// cairn coverage: how likely an image is to be found in a map, by where it was taken.
#include <algorithm>
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/cli.h"
#include "cli/map_to_read.h"
#include "cli/newest_view.h"
#include "client/map_reader.h"
#include "inspect/coverage.h"
#include "inspect/measures.h"
#include "plot/inspect_figures.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct CoverageCommand {
  std::string map;
  ServerChoice server;
  std::string picture;
  inspect::CoverageOptions options;
  double fail_below = 0.0;
  bool overwrite = false;
  bool json = false;
};

const char* NameOf(inspect::CoverageResult result) {
  switch (result) {
    case inspect::CoverageResult::kFound:
      return "found";
    case inspect::CoverageResult::kWrongPlace:
      return "wrong place";
    case inspect::CoverageResult::kMissed:
      return "missed";
  }
  return "";
}

// Of components that the picture leaves out, as they are in a frame of their own; empty: it shows all.
std::string NotDrawn(const inspect::Coverage& coverage) {
  if (coverage.grounds.size() < 2) return "";
  std::vector<std::uint32_t> others;
  for (std::size_t i = 1; i < coverage.grounds.size(); ++i) {
    for (const ComponentId id : coverage.grounds[i].components) others.push_back(id.value());
  }
  std::ranges::sort(others);
  constexpr std::size_t kNamed = 6;
  const bool one = others.size() == 1;
  if (others.size() > kNamed) return absl::StrCat(others.size(), " components in frames of their own are not drawn");
  return absl::StrCat(one ? "component " : "components ", absl::StrJoin(others, ", "),
                      one ? ", in a frame of its own, is not drawn" : ", in frames of their own, are not drawn");
}

const char* UnitOf(const inspect::CoverageGround& ground) { return ground.in_world ? "m" : "map units"; }

// The first of the grounds.
absl::Status DrawCoverage(const map::Snapshot& map, const inspect::Coverage& coverage, const CoverageCommand& command) {
  const inspect::CoverageGround& ground = coverage.grounds[0];
  const auto on_ground = [&](const Vector3d& v) { return Eigen::Vector2d(ground.right.dot(v), ground.ahead.dot(v)); };
  plot::HeatFigure figure;
  figure.title = absl::StrCat("Coverage of ", map.info().name);
  figure.subtitle = absl::StrFormat("%.0f %% of %d views found without their own keyframe",
                                    100.0 * ground.found / ground.tests, ground.tests);
  if (const std::string left_out = NotDrawn(coverage); !left_out.empty()) {
    absl::StrAppend(&figure.subtitle, "; ", left_out);
  }
  figure.axis_unit = UnitOf(ground);
  if (!ground.right_name.empty()) {
    figure.axes[0] = ground.right_name;
    figure.axes[1] = ground.ahead_name;
  }
  figure.cell_size = ground.cell_size;
  for (const inspect::CoverageCell& cell : ground.cells) {
    figure.cells.push_back({cell.x * ground.cell_size, cell.y * ground.cell_size, cell.share(),
                            absl::StrCat(cell.found, "/", cell.tests)});
  }
  for (const inspect::CoverageTest& test : coverage.tests) {
    if (!ground.Holds(test.component)) continue;
    figure.marks.push_back({on_ground(test.placed_from_camera.translation()),
                            on_ground(test.placed_from_camera.RotationMatrix().col(2)),
                            test.result == inspect::CoverageResult::kFound});
  }
  map.points().ForEach([&](const auto& point) {
    const ComponentId component = inspect::ComponentOf(map, *point);
    if (ground.Holds(component)) figure.points.push_back(on_ground(inspect::Placed(map, component, point->position)));
  });
  plot::FigureOptions to;
  to.overwrite = command.overwrite;
  return plot::WriteHeatFigure(figure, command.picture, to);
}

nlohmann::ordered_json AsJson(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

nlohmann::ordered_json GroundAsJson(const inspect::CoverageGround& ground) {
  nlohmann::ordered_json components = nlohmann::ordered_json::array();
  for (const ComponentId id : ground.components) components.push_back(id.value());
  nlohmann::ordered_json json = {{"components", components}};
  AddFrameAndUnit(ground.in_world, &json);
  json.update({{"cell_size", ground.cell_size},
               {"right", AsJson(ground.right)},
               {"ahead", AsJson(ground.ahead)},
               {"views", ground.tests},
               {"found", ground.found}});
  return json;
}

void PrintCoverageJson(const CoverageCommand& command, const map::Snapshot& map, const inspect::Coverage& coverage) {
  nlohmann::ordered_json cells = nlohmann::ordered_json::array(), tests = cells, grounds = cells;
  for (const inspect::CoverageGround& ground : coverage.grounds) {
    grounds.push_back(GroundAsJson(ground));
    for (const inspect::CoverageCell& cell : ground.cells) {
      cells.push_back({{"component", cell.component.value()},
                       {"x", cell.x},
                       {"y", cell.y},
                       {"center", AsJson(cell.center)},
                       {"unit", UnitOf(ground)},
                       {"cell_size", ground.cell_size},
                       {"views", cell.tests},
                       {"found", cell.found},
                       {"share", cell.share()}});
    }
  }
  for (const inspect::CoverageTest& test : coverage.tests) {
    const Vector3d& at = test.placed_from_camera.translation();
    tests.push_back({{"keyframe", test.keyframe.value()},
                     {"component", test.component.value()},
                     {"position", {at.x(), at.y(), at.z()}},
                     {"also_left_out", test.left_out},
                     {"result", NameOf(test.result)},
                     {"inliers", test.inliers}});
  }
  const bool none = coverage.tests.empty();
  const auto known = [&](const nlohmann::ordered_json& value) { return none ? nlohmann::ordered_json() : value; };
  nlohmann::ordered_json json = {{"map", command.map},
                                 {"revision", map.revision()},
                                 {"share", known(coverage.share)},
                                 {"views", coverage.tests.size()},
                                 {"not_tested", coverage.not_tested}};
  // Of the first ground, which is the only one of most maps.
  const inspect::CoverageGround first = none ? inspect::CoverageGround() : coverage.grounds[0];
  json.update({{"cell_size", known(first.cell_size)}, {"right", AsJson(first.right)}, {"ahead", AsJson(first.ahead)}});
  AddFrameAndUnit(first.in_world, &json);
  json.update({{"grounds", grounds}, {"cells", cells}, {"tests", tests}, {"warnings", coverage.warnings}});
  if (!command.picture.empty()) json["picture"] = known(command.picture);
  PrintJson(json);
}

// At most so many of a ground; how many.
constexpr std::size_t kShownCells = 20;
std::size_t PrintCells(const inspect::CoverageGround& ground, std::size_t at_most) {
  std::vector<inspect::CoverageCell> cells = ground.cells;
  std::ranges::stable_sort(cells, {}, [](const inspect::CoverageCell& cell) { return cell.share(); });
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < std::min(cells.size(), at_most); ++i) {
    const inspect::CoverageCell& cell = cells[i];
    const auto at = [&](int axis) { return absl::StrFormat("%.2f", cell.center[axis]); };
    rows.push_back({absl::StrCat(cell.component.value()), at(0), at(1), at(2), absl::StrCat(cell.tests),
                    absl::StrCat(cell.found), absl::StrFormat("%.0f %%", 100.0 * cell.share())});
  }
  const std::string frame =
      ground.in_world ? " in the world" : absl::StrCat(" in the frame of component ", ground.components[0].value());
  const std::string head =
      absl::StrFormat("cells of %.3g %s by their centres%s, the worst first", ground.cell_size, UnitOf(ground), frame);
  std::fputs(text::Wrapped(head, "  ", "    ").c_str(), stdout);
  if (!rows.empty()) {
    std::fputs(text::TextTable({{"component", false},
                                {"x", false},
                                {"y", false},
                                {"z", false},
                                {"views", false},
                                {"found", false},
                                {"share", false}},
                               rows, "  ")
                   .c_str(),
               stdout);
  }
  if (cells.size() > rows.size()) std::printf("  ... %zu more (--json)\n", cells.size() - rows.size());
  return rows.size();
}

void PrintCoverage(const CoverageCommand& command, const map::Snapshot& map, const inspect::Coverage& coverage) {
  if (coverage.tests.empty()) {
    const std::string why = map.keyframes().empty()
                                ? "it has no keyframes (cairn run --extend maps into it)"
                                : absl::StrCat("none of its ", map.keyframes().size(),
                                               " keyframes can be taken out of it, so that nothing can be asked");
    std::fputs(text::WrappedOn(stdout, absl::StrCat(text::Shown(command.map), ": ", why)).c_str(), stdout);
    if (!command.picture.empty()) std::printf("  picture: none, as there is nothing to draw\n");
    return;
  }
  std::printf("%s:\n  %.0f %% of %zu views are found without their own keyframe (%d not tested)\n",
              text::Shown(command.map).c_str(), 100.0 * coverage.share, coverage.tests.size(), coverage.not_tested);
  std::size_t left = kShownCells;
  for (const inspect::CoverageGround& ground : coverage.grounds) left -= PrintCells(ground, left);
  for (const std::string& warning : coverage.warnings) {
    std::fputs(text::Wrapped(absl::StrCat("warning: ", warning), "  ", "    ").c_str(), stdout);
  }
  if (command.picture.empty()) return;
  const std::string left_out = NotDrawn(coverage);
  std::fputs(
      text::Wrapped(absl::StrCat("picture: ", text::Shown(command.picture), left_out.empty() ? "" : "; ", left_out),
                    "  ", "    ")
          .c_str(),
      stdout);
}

absl::StatusOr<inspect::Coverage> RunCoverage(const CoverageCommand& command) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(command.picture, command.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({command.picture}, {InputFile(command.server, command.map)}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(command.picture));
  TellLogDamage("coverage", command.server, command.map);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(command.server, command.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::MapReader> reader, client::MapReader::Open(source.path()));
  const std::int64_t views = std::min<std::int64_t>(
      command.options.max_tests, static_cast<std::int64_t>(reader->view()->map().keyframes().size()));
  Progress progress("trying", views, command.json);
  const auto measure = [&](const tracking::MapView& view) {
    return inspect::MeasureCoverage(view, command.options, [&](int done, int) {
      progress.Update(done);
      return true;
    });
  };
  CAIRN_ASSIGN_OR_RETURN(inspect::Coverage coverage, AskNewest(*reader, measure));
  progress.Finish();
  const map::Snapshot& map = reader->view()->map();
  if (!command.picture.empty() && !coverage.tests.empty()) {
    CAIRN_RETURN_IF_ERROR(DrawCoverage(map, coverage, command));
  }
  if (command.json) {
    PrintCoverageJson(command, map, coverage);
  } else {
    PrintCoverage(command, map, coverage);
  }
  return coverage;
}

}  // namespace

void AddCoverageCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("coverage", "How likely an image is to be found, by where it was taken");
  auto command = std::make_shared<CoverageCommand>();
  verb->add_option("MAP", command->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("--picture", command->picture, "Draw a heat map to this .png or .svg file");
  verb->add_option("--cell", command->options.cell_size,
                   "Side of a cell, metres or map units; 0: a quarter of the median depth")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  verb->add_option("--views", command->options.max_tests, "At most so many keyframes are tried, spread evenly")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  verb->add_option("--fail-below", command->fail_below, "Exit with 4 if a smaller share of all views is found")
      ->check(CLI::Range(0.0, 1.0));
  verb->add_flag("--overwrite", command->overwrite, "Replace the picture if it exists");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "Each keyframe is taken out of the map, with those that share 70 % of its points, and looked for in the rest.\n"
      "The map is only read. Lengths are metres in the world where it is aligned, else map units: components that are\n"
      "not aligned are told, each in its own frame, after those that are, and not drawn with them. Cells lie on the\n"
      "ground: z (or what points upwards) is how high the cameras were there.\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 4 below --fail-below, 5 version.\n"
      "Examples:\n"
      "  cairn coverage office.cairn --picture coverage.png\n"
      "  cairn coverage office.cairn --fail-below 0.8 --json");
  verb->callback([=, &app] {
    command->server = ServerOf(app);
    *action = [=] {
      const auto coverage = RunCoverage(*command);
      if (!coverage.ok()) return Fail("coverage", coverage.status(), command->json);
      if (coverage->share >= command->fail_below) return static_cast<int>(kOk);
      std::fprintf(stderr, "cairn coverage: %.1f %% of the views are found, less than --fail-below %g%s\n",
                   100.0 * coverage->share, command->fail_below,
                   coverage->tests.empty() ? ": the map has no view to look for" : "");
      return static_cast<int>(kNotLocalized);
    };
  });
}

}  // namespace cairn::cli
