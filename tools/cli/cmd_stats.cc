// cairn stats: how good a map is, in distributions.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/cli.h"
#include "cli/map_to_read.h"
#include "inspect/statistics.h"
#include "plot/inspect_figures.h"
#include "store/map_store.h"
#include "text/bars.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct StatsOptions {
  std::string map;
  ServerChoice server;
  std::uint32_t session = 0;
  std::string histogram;
  std::string picture;
  bool overwrite = false;
  bool json = false;
};

nlohmann::ordered_json DistributionAsJson(const inspect::Distribution& d) {
  nlohmann::ordered_json json = {{"count", d.count}};
  if (!d.unit.empty()) json["unit"] = d.unit;
  if (d.count == 0) return json;
  json.update({{"min", d.min},
               {"median", d.median},
               {"mean", d.mean},
               {"p90", d.p90},
               {"max", d.max},
               {"histogram", {{"low", d.low}, {"step", d.step}, {"counts", d.bins}}}});
  return json;
}

std::string Brief(double value) {
  if (value == std::round(value) && std::abs(value) < 1e6) return absl::StrFormat("%.0f", value);
  return absl::StrFormat("%.3g", value);
}

void PrintTable(const std::vector<inspect::Distribution>& all) {
  const bool blocks = text::TerminalTakesBlocks();
  std::printf("%-22s %6s %6s %6s %6s  %s\n", "", "min", "median", "p90", "max", "from min to p99");
  for (const inspect::Distribution& d : all) {
    if (d.count == 0) {
      std::printf("%-22s none\n", d.name.c_str());
      continue;
    }
    std::printf("%-22s %6s %6s %6s %6s |%s|\n", d.name.c_str(), Brief(d.min).c_str(), Brief(d.median).c_str(),
                Brief(d.p90).c_str(), Brief(d.max).c_str(), text::Sparkline(d.bins, blocks).c_str());
  }
}

void PrintHistogram(const inspect::Distribution& d) {
  std::printf("%s: %s\n", d.name.c_str(), d.what.c_str());
  if (d.count == 0) {
    std::printf("  none\n");
    return;
  }
  std::printf("  %lld values from %s to %s,\n  mean %s, median %s, nine in ten below %s\n",
              static_cast<long long>(d.count), Brief(d.min).c_str(), Brief(d.max).c_str(), Brief(d.mean).c_str(),
              Brief(d.median).c_str(), Brief(d.p90).c_str());
  const bool blocks = text::TerminalTakesBlocks();
  const std::int64_t most = *std::ranges::max_element(d.bins);
  for (std::size_t i = 0; i < d.bins.size(); ++i) {
    const bool last = i + 1 == d.bins.size();
    std::printf("%10s%s %8lld %s\n", Brief(d.low + d.step * static_cast<double>(i)).c_str(), last ? "+" : " ",
                static_cast<long long>(d.bins[i]), text::Bar(d.bins[i], most, 58, blocks).c_str());
  }
}

absl::Status Draw(const std::vector<inspect::Distribution>& all, const std::string& title,
                  const StatsOptions& options) {
  plot::HistogramFigure figure;
  figure.title = title;
  for (const inspect::Distribution& d : all) {
    figure.panels.push_back({d.name, d.what, d.low, d.step, d.bins, d.median});
  }
  plot::FigureOptions to;
  to.overwrite = options.overwrite;
  to.width_pt = 980.0;
  return plot::WriteHistogramFigure(figure, options.picture, to);
}

absl::Status Stats(const StatsOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckWritable(options.picture, options.overwrite));
  CAIRN_RETURN_IF_ERROR(CheckDistinct({options.picture}, {InputFile(options.server, options.map)}));
  CAIRN_RETURN_IF_ERROR(CheckPicture(options.picture));
  TellLogDamage("stats", options.server, options.map);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file,
                         store::OpenMapStore(source.path(), store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, file->LoadSnapshot());
  if (options.session != 0 && !map->sessions().contains(SessionId(options.session))) {
    return absl::NotFoundError(absl::StrCat(options.map, ": there is no session ", options.session));
  }
  const auto all = inspect::Statistics(*map, SessionId(options.session));
  const auto chosen = std::ranges::find(all, options.histogram, &inspect::Distribution::name);
  if (!options.histogram.empty() && chosen == all.end()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "there is no distribution \"", options.histogram, "\"; there are ",
        absl::StrJoin(all, ", ", [](std::string* out, const inspect::Distribution& d) { out->append(d.name); })));
  }
  const bool drawn = !options.picture.empty() && std::ranges::any_of(all, [](const auto& d) { return d.count > 0; });
  if (drawn) CAIRN_RETURN_IF_ERROR(Draw(all, map->info().name, options));
  if (options.json) {
    nlohmann::ordered_json json = {{"map", options.map}, {"revision", map->revision()}};
    if (!options.picture.empty()) json["picture"] = drawn ? nlohmann::ordered_json(options.picture) : nullptr;
    for (const inspect::Distribution& d : all) {
      if (options.histogram.empty() || d.name == options.histogram) json[d.name] = DistributionAsJson(d);
    }
    PrintJson(json);
  } else if (options.histogram.empty()) {
    PrintTable(all);
  } else {
    PrintHistogram(*chosen);
  }
  if (!options.json && !options.picture.empty()) {
    std::printf("picture: %s\n", drawn ? text::Shown(options.picture).c_str() : "none, as there is nothing to draw");
  }
  return absl::OkStatus();
}

}  // namespace

void AddStatsCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("stats", "How good a map is: track lengths, errors, covisibility, depth");
  auto options = std::make_shared<StatsOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_option("--session", options->session, "Only the keyframes and points of this session")
      ->check(CLI::PositiveNumber);
  verb->add_option("--histogram", options->histogram, "One distribution, as a histogram");
  verb->add_option("--picture", options->picture, "Draw all of them to this .png or .svg file");
  verb->add_flag("--overwrite", options->overwrite, "Replace the picture if it exists");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Lengths are metres where the component is aligned, else map units.\n"
      "Exit codes: 0 ok, 1 failure, 2 usage, 3 map damaged, 5 version.\n"
      "Examples:\n"
      "  cairn stats office.cairn --picture office_stats.png\n"
      "  cairn stats office.cairn --histogram point_error_px --session 2");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::Status status = Stats(*options);
      if (absl::IsInvalidArgument(status) && store::FaultOf(status) == store::Fault::kNone) {
        return FailUsage("stats", std::string(status.message()), options->json);
      }
      return status.ok() ? static_cast<int>(kOk) : Fail("stats", status, options->json);
    };
  });
}

}  // namespace cairn::cli
