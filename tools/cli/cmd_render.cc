// cairn render: a picture of a map.
#include <cstdio>
#include <map>
#include <memory>

#include "absl/strings/str_format.h"
#include "cli/cli.h"
#include "cli/component_report.h"
#include "cli/loaded_map.h"
#include "cli/map_scene.h"
#include "cli/map_to_read.h"
#include "inspect/measures.h"
#include "plot/scene_figure.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

const std::map<std::string, plot::SceneView> kRenderViews = {
    {"plan", plot::SceneView::kPlan}, {"side", plot::SceneView::kSide}, {"perspective", plot::SceneView::kPerspective}};
const std::map<std::string, SceneColors> kRenderColors = {{"session", SceneColors::kSession},
                                                          {"age", SceneColors::kAge},
                                                          {"error", SceneColors::kError},
                                                          {"observations", SceneColors::kObservations}};

struct RenderOptions {
  std::string map, out;
  ServerChoice server;
  std::string view = "plan", color = "session";
  std::uint32_t component = 0;
  double width_pt = 760.0;
  bool no_points = false;
  bool overwrite = false;
  bool json = false;
};

struct Rendered {
  std::vector<ComponentId> components;
  std::size_t cameras = 0, points = 0;
  std::string unit;
};

absl::StatusOr<Rendered> Render(const RenderOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.out));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.out}, {InputFile(options.server, options.map)}));
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.out, options.overwrite));
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const LoadedMap loaded, LoadMap("render", source.path()));
  CAIRN_RETURN_IF_ERROR(RequireKeyframes(options.map, *loaded.map));
  Rendered rendered;
  rendered.components = inspect::TogetherInOneFrame(*loaded.map);
  if (options.component != 0) {
    const ComponentId id(options.component);
    if (loaded.map->NumKeyframes(id) == 0) {
      return absl::NotFoundError(
          absl::StrCat(options.map, " has no keyframes in a component ", id.value(), " (cairn info)"));
    }
    rendered.components = {id};
  }
  plot::SceneFigure figure = SceneOf(*loaded.map, rendered.components, kRenderColors.at(options.color));
  figure.view = kRenderViews.at(options.view);
  rendered.cameras = figure.cameras.size();
  rendered.points = figure.points.size();
  rendered.unit = figure.unit;
  if (loaded.map->LiveComponents().size() > rendered.components.size()) {
    absl::StrAppend(&figure.title, " (", NameComponents(rendered.components), ")");
  }
  if (options.no_points) figure.points.clear();
  plot::FigureOptions to;
  to.width_pt = options.width_pt;
  to.overwrite = options.overwrite;
  CAIRN_RETURN_IF_ERROR(plot::WriteSceneFigure(figure, options.out, to));
  return rendered;
}

}  // namespace

void AddRenderCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("render", "Draw a map: from above, from the side, in perspective");
  auto options = std::make_shared<RenderOptions>();
  const auto names = [](const auto& map) {
    std::vector<std::string> all;
    for (const auto& [name, value] : map) all.push_back(name);
    return all;
  };
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("-o,--out", options->out, "Picture to write, .png or .svg")->required();
  verb->add_option("--view", options->view, "How it is looked at")
      ->check(CLI::IsMember(names(kRenderViews)))
      ->capture_default_str();
  verb->add_option("--color", options->color, "What colours tell")
      ->check(CLI::IsMember(names(kRenderColors)))
      ->capture_default_str();
  verb->add_option("--component", options->component,
                   "Only this one; by default all that are aligned to the world, or else the largest")
      ->check(CLI::PositiveNumber);
  verb->add_option("--width", options->width_pt, "Of the picture, points; a PNG has two pixels for each")
      ->check(CLI::Range(200.0, 5000.0))
      ->capture_default_str();
  verb->add_flag("--no-points", options->no_points, "Cameras only");
  verb->add_flag("--overwrite", options->overwrite, "Replace the picture");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "In metres in the world where components are aligned to it. Up is where the cameras' images are upright.\n"
      "Examples:\n"
      "  cairn render office.cairn -o office.png\n"
      "  cairn render office.cairn -o office.svg --view perspective --color error\n"
      "  cairn render office.cairn -o side.png --view side --color age --overwrite");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::StatusOr<Rendered> rendered = Render(*options);
      if (!rendered.ok()) return Fail("render", rendered.status(), options->json);
      if (options->json) {
        nlohmann::ordered_json components = nlohmann::ordered_json::array();
        for (const ComponentId id : rendered->components) components.push_back(id.value());
        PrintJson({{"map", options->map},
                   {"picture", options->out},
                   {"components", components},
                   {"keyframes", rendered->cameras},
                   {"points", rendered->points},
                   {"unit", rendered->unit}});
      } else {
        text::Say(absl::StrFormat("%s: %s and %s of %s\n", text::Shown(options->out),
                                  text::Keyframes(static_cast<std::int64_t>(rendered->cameras)),
                                  text::Points(static_cast<std::int64_t>(rendered->points)),
                                  NameComponents(rendered->components)));
      }
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli
