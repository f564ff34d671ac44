// cairn diff: what two states of a map differ in.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

#include "absl/strings/str_format.h"
#include "base/median.h"
#include "cli/align_report.h"
#include "cli/cli.h"
#include "cli/component_report.h"
#include "cli/diff_since.h"
#include "cli/geo_options.h"
#include "cli/id_lists.h"
#include "cli/map_scene.h"
#include "cli/map_to_read.h"
#include "inspect/difference.h"
#include "inspect/measures.h"
#include "plot/scene_figure.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct DiffOptions {
  std::string first, second;
  ServerChoice server;
  std::optional<Revision> since;
  std::string picture;
  std::size_t limit = 10;
  bool as_it_stands = false;
  bool overwrite = false;
  bool json = false;
};

struct Compared {
  std::shared_ptr<const map::Snapshot> first, second;
  inspect::MapDifference difference;
};

absl::StatusOr<std::shared_ptr<const map::Snapshot>> LoadState(const ServerChoice& server, const std::string& map) {
  TellLogDamage("diff", server, map);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(server, map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(source.path(), store::OpenMode::kRead));
  return store->LoadSnapshot();
}

template <class Moves>
double MedianShift(const Moves& moves) {  // the largest first
  return moves.empty() ? 0.0 : moves[moves.size() / 2].shift;
}

std::string ShiftUnit(const inspect::MapDifference& difference) {
  const bool metres = !difference.fits.empty() && std::ranges::all_of(difference.fits, &inspect::ComponentFit::metres);
  return metres ? "m" : "map units";
}

void PrintDifference(const DiffOptions& options, const Compared& compared) {
  const inspect::MapDifference& d = compared.difference;
  std::printf("%s (revision %llu) to %s (revision %llu)\n", text::Shown(options.first).c_str(),
              static_cast<unsigned long long>(compared.first->revision()), text::Shown(options.second).c_str(),
              static_cast<unsigned long long>(compared.second->revision()));
  if (compared.first->info().id != compared.second->info().id) {
    std::fputs(
        text::Wrapped("two maps, as their ids say (cairn info): one was made from the other, packed, split, merged "
                      "or recovered, or both are of recordings that begin alike",
                      "  ", "    ")
            .c_str(),
        stdout);
  }
  if (d.same()) {
    std::printf("  nothing differs\n");
    return;
  }
  PrintIds("sessions added", d.sessions_added, options.limit);
  PrintIds("sessions removed", d.sessions_removed, options.limit);
  PrintIds("components added", d.components_added, options.limit);
  PrintIds("components gone or joined", d.components_gone, options.limit);
  PrintIds("components with another place in the world", d.realigned, options.limit);
  PrintIds("cameras added", d.cameras_added, options.limit);
  PrintIds("cameras removed", d.cameras_removed, options.limit);
  PrintIds("cameras with another lens or name", d.cameras_changed, options.limit);
  if (d.anchor_changed) {
    const auto anchor = [](const map::Snapshot& map) {
      return map.info().geo_anchor ? DescribeAnchor(*map.info().geo_anchor) : std::string("not known");
    };
    std::fputs(text::Wrapped(
                   absl::StrCat("place on the earth: ", anchor(*compared.first), ", then ", anchor(*compared.second)),
                   "  ", "    ")
                   .c_str(),
               stdout);
  }
  PrintIds("keyframes added", d.keyframes_added, options.limit);
  PrintIds("keyframes removed", d.keyframes_removed, options.limit);
  std::printf("  points: %zu added, %zu removed, %lld kept\n  observations: %lld before, %lld after\n",
              d.points_added.size(), d.points_removed.size(), static_cast<long long>(d.points_kept),
              static_cast<long long>(d.observations_before), static_cast<long long>(d.observations_after));
  const std::string unit = ShiftUnit(d);
  if (!d.keyframe_moves.empty()) {
    std::printf("  the %lld keyframes of both moved by %.3g %s (median), %.3g (most)\n",
                static_cast<long long>(d.keyframes_kept), MedianShift(d.keyframe_moves), unit.c_str(),
                d.keyframe_moves[0].shift);
  }
  if (!d.point_moves.empty()) {
    std::printf("  the %lld points of both moved by %.3g %s (median), %.3g (most)\n",
                static_cast<long long>(d.points_kept), MedianShift(d.point_moves), unit.c_str(),
                d.point_moves[0].shift);
  }
  for (const inspect::ComponentFit& fit : d.fits) {
    if (!fit.aligned) continue;
    std::printf("  component %u was laid onto component %u by %lld keyframes: scale %.6g\n", fit.second.value(),
                fit.first.value(), static_cast<long long>(fit.keyframes), fit.first_from_second.scale());
  }
  std::vector<std::vector<std::string>> rows;
  for (const inspect::KeyframeMove& move : d.keyframe_moves) {
    if (rows.size() == options.limit || move.shift == 0.0) break;
    rows.push_back(
        {absl::StrCat(move.id.value()), absl::StrFormat("%.3g", move.shift), absl::StrFormat("%.3g", move.turn_deg)});
  }
  if (rows.empty()) return;
  const auto moved = std::ranges::count_if(d.keyframe_moves, [](const auto& move) { return move.shift != 0.0; });
  std::fputs(
      text::TextTable({{"keyframe", false}, {absl::StrCat("moved [", unit, "]"), false}, {"turned [deg]", false}}, rows,
                      "  ")
          .c_str(),
      stdout);
  if (moved > static_cast<std::ptrdiff_t>(rows.size())) {
    std::printf("  ... %td more (--limit, --json)\n", moved - static_cast<std::ptrdiff_t>(rows.size()));
  }
}

void PrintDifferenceJson(const DiffOptions& options, const Compared& compared) {
  const inspect::MapDifference& d = compared.difference;
  nlohmann::ordered_json fits = nlohmann::ordered_json::array(), moves = fits;
  for (const inspect::ComponentFit& fit : d.fits) {
    fits.push_back({{"component", fit.first.value()},
                    {"other_component", fit.second.value()},
                    {"keyframes", fit.keyframes},
                    {"fitted", fit.aligned},
                    {"scale", fit.first_from_second.scale()}});
  }
  for (const inspect::KeyframeMove& move : d.keyframe_moves) {
    if (move.shift == 0.0 && move.turn_deg == 0.0) continue;
    moves.push_back({{"keyframe", move.id.value()}, {"shift", move.shift}, {"turn_deg", move.turn_deg}});
  }
  PrintJson({{"first", options.first},
             {"second", options.second},
             {"first_revision", compared.first->revision()},
             {"second_revision", compared.second->revision()},
             {"same_map", compared.first->info().id == compared.second->info().id},
             {"same", d.same()},
             {"unit", ShiftUnit(d)},
             {"sessions_added", IdsAsJson(d.sessions_added)},
             {"sessions_removed", IdsAsJson(d.sessions_removed)},
             {"components_added", IdsAsJson(d.components_added)},
             {"components_gone", IdsAsJson(d.components_gone)},
             {"components_realigned", IdsAsJson(d.realigned)},
             {"cameras_added", IdsAsJson(d.cameras_added)},
             {"cameras_removed", IdsAsJson(d.cameras_removed)},
             {"cameras_changed", IdsAsJson(d.cameras_changed)},
             {"geo_anchor_changed", d.anchor_changed},
             {"first_geo_anchor", AnchorAsJson(compared.first->info().geo_anchor)},
             {"second_geo_anchor", AnchorAsJson(compared.second->info().geo_anchor)},
             {"keyframes_added", IdsAsJson(d.keyframes_added)},
             {"keyframes_removed", IdsAsJson(d.keyframes_removed)},
             {"keyframes_kept", d.keyframes_kept},
             {"points_added", d.points_added.size()},
             {"points_removed", d.points_removed.size()},
             {"points_kept", d.points_kept},
             {"observations_before", d.observations_before},
             {"observations_after", d.observations_after},
             {"keyframe_shift_median", MedianShift(d.keyframe_moves)},
             {"point_shift_median", MedianShift(d.point_moves)},
             {"fits", fits},
             {"keyframe_moves", moves}});
}

// In the frame of the first map: what was kept, gone and new, and lines along which cameras moved.
absl::Status DrawDifference(const DiffOptions& options, const Compared& compared) {
  const map::Snapshot &first = *compared.first, &second = *compared.second;
  const inspect::MapDifference& d = compared.difference;
  const std::vector<ComponentId> shown = inspect::TogetherInOneFrame(first);
  const auto is_shown = [&](ComponentId id) { return std::ranges::find(shown, id) != shown.end(); };
  const auto fit_of = [&](ComponentId of_second) {
    const auto fit =
        std::ranges::find_if(d.fits, [&](const auto& f) { return f.second == of_second && is_shown(f.first); });
    return fit == d.fits.end() ? nullptr : &*fit;
  };
  plot::SceneFigure figure;
  figure.title = absl::StrCat(first.info().name, ": what has changed");
  figure.unit = cli::UnitOf(first, shown);
  figure.up = UpOf(first, shown);
  first.points().ForEach([&](const auto& point) {
    const ComponentId component = inspect::ComponentOf(first, *point);
    if (!is_shown(component)) return;
    const bool gone = std::ranges::binary_search(d.points_removed, point->id);
    figure.points.push_back({inspect::Placed(first, component, point->position),
                             gone ? plot::kVermilion.WithAlpha(0.5) : plot::Color{0.25, 0.25, 0.30, 0.3}});
  });
  const auto placed = [&](const inspect::ComponentFit& fit, const Sim3& second_from) {
    const Sim3 in_first = fit.first_from_second * second_from;
    return first.WorldFrom(fit.first) ? *first.WorldFrom(fit.first) * in_first : in_first;
  };
  second.points().ForEach([&](const auto& point) {
    if (!std::ranges::binary_search(d.points_added, point->id)) return;
    const auto* fit = fit_of(inspect::ComponentOf(second, *point));
    if (fit != nullptr) figure.points.push_back({placed(*fit, Sim3()) * point->position, plot::kGreen.WithAlpha(0.5)});
  });
  int kept = 0, added = 0, removed = 0;  // of what is drawn
  first.keyframes().ForEach([&](const auto& keyframe) {
    if (!is_shown(keyframe->component)) return;
    const bool gone = std::ranges::binary_search(d.keyframes_removed, keyframe->id);
    ++(gone ? removed : kept);
    figure.cameras.push_back({inspect::PlacedPose(first, *keyframe), gone ? plot::kVermilion : plot::kGray});
  });
  second.keyframes().ForEach([&](const auto& keyframe) {
    const auto* fit = fit_of(keyframe->component);
    if (fit == nullptr) return;
    const SE3 pose = placed(*fit, Sim3()).TransformPose(keyframe->camera_from_map.Inverse());
    if (std::ranges::binary_search(d.keyframes_added, keyframe->id)) {
      figure.cameras.push_back({pose, plot::kGreen});
      ++added;
    } else {
      figure.lines.push_back({inspect::PlacedPose(first, first.keyframe(keyframe->id)).translation(),
                              pose.translation(), plot::kBlue, 1.4});
    }
  });
  const std::string without = inspect::LeftOutBesides(first, shown).Text();
  figure.subtitle = absl::StrFormat("%d keyframes kept, %d added, %d removed%s%s", kept, added, removed,
                                    without.empty() ? "" : "; ", without);
  figure.legend = {{"kept", plot::kGray, plot::LegendEntry::Mark::kFrustum},
                   {"added", plot::kGreen, plot::LegendEntry::Mark::kFrustum},
                   {"removed", plot::kVermilion, plot::LegendEntry::Mark::kFrustum},
                   {"moved by", plot::kBlue, plot::LegendEntry::Mark::kLine}};
  plot::FigureOptions to;
  to.overwrite = options.overwrite;
  return plot::WriteSceneFigure(figure, options.picture, to);
}

absl::StatusOr<Compared> RunDiff(const DiffOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  CAIRN_RETURN_IF_ERROR(CheckDistinct(
      {options.picture}, {InputFile(options.server, options.first), InputFile(options.server, options.second)}));
  if (!options.picture.empty()) CAIRN_RETURN_IF_ERROR(CheckWritable(options.picture, options.overwrite));
  Compared compared;
  CAIRN_ASSIGN_OR_RETURN(compared.first, LoadState(options.server, options.first));
  CAIRN_ASSIGN_OR_RETURN(compared.second, LoadState(options.server, options.second));
  CAIRN_ASSIGN_OR_RETURN(compared.difference,
                         inspect::Compare(*compared.first, *compared.second, {.align = !options.as_it_stands}));
  if (!options.picture.empty()) CAIRN_RETURN_IF_ERROR(DrawDifference(options, compared));
  return compared;
}

int Diff(const DiffOptions& options) {
  if (options.since.has_value() == !options.second.empty()) {
    return FailUsage("diff", "give two maps, or one and --since", options.json);
  }
  if (options.since) {
    if (!options.picture.empty()) return FailUsage("diff", "--plot draws two maps: not with --since", options.json);
    const absl::Status status = DiffSince({options.first, options.server, *options.since, options.limit, options.json});
    return status.ok() ? static_cast<int>(kOk) : Fail("diff", status, options.json);
  }
  const absl::StatusOr<Compared> compared = RunDiff(options);
  if (!compared.ok()) return Fail("diff", compared.status(), options.json);
  if (options.json) {
    PrintDifferenceJson(options, *compared);
  } else {
    PrintDifference(options, *compared);
    if (!options.picture.empty()) std::printf("  picture: %s\n", text::Shown(options.picture).c_str());
  }
  return kOk;
}

}  // namespace

void AddDiffCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("diff", "What two states of a map differ in: added, removed, moved by how much");
  auto options = std::make_shared<DiffOptions>();
  verb->add_option("FIRST", options->first, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("SECOND", options->second,
                   "A later copy of it, or one that went on from the same; of the same server, too");
  verb->add_option("--since", options->since, "Instead of SECOND: what has changed in FIRST since this revision");
  verb->add_flag("--no-align", options->as_it_stands, "Compare positions as they stand, in frames that may be others");
  verb->add_option("--plot", options->picture, "Draw it: a file .png or .svg");
  verb->add_option("--limit", options->limit, "Rows of long lists")->capture_default_str()->check(CLI::PositiveNumber);
  verb->add_flag("--overwrite", options->overwrite, "Replace the picture");
  verb->add_flag("--json", options->json, "Answer in JSON, with lists in full");
  verb->footer(
      "Components are laid onto each other by the cameras of their common keyframes before they are compared.\n"
      "Examples:\n"
      "  cairn snapshot office.cairn before.cairn && cairn session remove office.cairn 3\n"
      "  cairn diff before.cairn office.cairn --plot change.png\n"
      "  cairn diff office.cairn --since 120 --json");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] { return Diff(*options); };
  });
}

}  // namespace cairn::cli
