// cairn coverage: how likely an image is to be found in a map, by where it was taken.
#include <algorithm>
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
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

// Components that share a frame with that of most tests: those can be drawn together.
std::vector<ComponentId> Drawn(const map::Snapshot& map, const inspect::Coverage& coverage) {
  std::vector<ComponentId> aligned;
  ComponentId most;
  for (const ComponentId id : map.LiveComponents()) {
    if (map.WorldFrom(id)) aligned.push_back(id);
    if (!most || map.NumKeyframes(id) > map.NumKeyframes(most)) most = id;
  }
  if (aligned.empty() && most && !coverage.tests.empty()) aligned.push_back(most);
  return aligned;
}

bool InWorld(const map::Snapshot& map, const inspect::Coverage& coverage) {
  const std::vector<ComponentId> drawn = Drawn(map, coverage);
  return !drawn.empty() && map.WorldFrom(drawn[0]).has_value();
}

absl::Status DrawCoverage(const map::Snapshot& map, const inspect::Coverage& coverage, const CoverageCommand& command) {
  const std::vector<ComponentId> drawn = Drawn(map, coverage);
  const auto is_drawn = [&](ComponentId id) { return std::ranges::find(drawn, id) != drawn.end(); };
  const auto on_ground = [&](const Vector3d& v) {
    return Eigen::Vector2d(coverage.right.dot(v), coverage.ahead.dot(v));
  };
  plot::HeatFigure figure;
  figure.title = absl::StrCat("Coverage of ", map.info().name);
  figure.subtitle = absl::StrFormat("%.0f %% of %d views found without their own keyframe", 100.0 * coverage.share,
                                    coverage.tests.size());
  figure.axis_unit = InWorld(map, coverage) ? "m" : "map units";
  if (!coverage.right_name.empty()) {
    figure.axes[0] = coverage.right_name;
    figure.axes[1] = coverage.ahead_name;
  }
  figure.cell_size = coverage.cell_size;
  for (const inspect::CoverageCell& cell : coverage.cells) {
    if (!is_drawn(cell.component)) continue;
    figure.cells.push_back({cell.x * coverage.cell_size, cell.y * coverage.cell_size, cell.share(),
                            absl::StrCat(cell.found, "/", cell.tests)});
  }
  for (const inspect::CoverageTest& test : coverage.tests) {
    if (!is_drawn(test.component)) continue;
    figure.marks.push_back({on_ground(test.placed_from_camera.translation()),
                            on_ground(test.placed_from_camera.RotationMatrix().col(2)),
                            test.result == inspect::CoverageResult::kFound});
  }
  map.points().ForEach([&](const auto& point) {
    const ComponentId component = inspect::ComponentOf(map, *point);
    if (is_drawn(component)) figure.points.push_back(on_ground(inspect::Placed(map, component, point->position)));
  });
  plot::FigureOptions to;
  to.overwrite = command.overwrite;
  return plot::WriteHeatFigure(figure, command.picture, to);
}

void PrintCoverageJson(const CoverageCommand& command, const map::Snapshot& map, const inspect::Coverage& coverage) {
  const auto axis = [](const Vector3d& v) { return nlohmann::ordered_json{v.x(), v.y(), v.z()}; };
  nlohmann::ordered_json cells = nlohmann::ordered_json::array(), tests = cells;
  for (const inspect::CoverageCell& cell : coverage.cells) {
    cells.push_back({{"component", cell.component.value()},
                     {"x", cell.x},
                     {"y", cell.y},
                     {"center", axis(cell.center)},
                     {"unit", map.WorldFrom(cell.component) ? "m" : "map units"},
                     {"views", cell.tests},
                     {"found", cell.found},
                     {"share", cell.share()}});
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
  nlohmann::ordered_json json = {
      {"map", command.map},
      {"revision", map.revision()},
      {"share", none ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(coverage.share)},
      {"views", coverage.tests.size()},
      {"not_tested", coverage.not_tested},
      {"cell_size", none ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(coverage.cell_size)},
      {"right", axis(coverage.right)},
      {"ahead", axis(coverage.ahead)}};
  AddFrameAndUnit(InWorld(map, coverage), &json);
  json.update({{"cells", cells}, {"tests", tests}, {"warnings", coverage.warnings}});
  if (!command.picture.empty())
    json["picture"] = none ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(command.picture);
  PrintJson(json);
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
  constexpr std::size_t kShownCells = 20;
  std::vector<inspect::CoverageCell> cells = coverage.cells;
  std::ranges::stable_sort(cells, {}, [](const inspect::CoverageCell& cell) { return cell.share(); });
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < std::min(cells.size(), kShownCells); ++i) {
    const inspect::CoverageCell& cell = cells[i];
    const auto at = [&](int axis) { return absl::StrFormat("%.2f", cell.center[axis]); };
    rows.push_back({absl::StrCat(cell.component.value()), at(0), at(1), at(2), absl::StrCat(cell.tests),
                    absl::StrCat(cell.found), absl::StrFormat("%.0f %%", 100.0 * cell.share())});
  }
  const bool world = InWorld(map, coverage);
  std::printf("  cells of %.3g %s by their centres%s, the worst first\n", coverage.cell_size, world ? "m" : "map units",
              world ? " in the world" : "");
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
  if (cells.size() > kShownCells) std::printf("  ... %zu more (--json)\n", cells.size() - kShownCells);
  for (const std::string& warning : coverage.warnings) {
    std::fputs(text::Wrapped(absl::StrCat("warning: ", warning), "  ", "    ").c_str(), stdout);
  }
  if (!command.picture.empty()) std::printf("  picture: %s\n", text::Shown(command.picture).c_str());
}

absl::StatusOr<inspect::Coverage> RunCoverage(const CoverageCommand& command) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(command.picture, command.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({command.picture}, {InputFile(command.server, command.map)}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(command.picture));
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
      "The map is only read. Lengths are metres in the world where it is aligned, else map units. Cells lie on the\n"
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
      return static_cast<int>(coverage->share < command->fail_below ? kNotLocalized : kOk);
    };
  });
}

}  // namespace cairn::cli
