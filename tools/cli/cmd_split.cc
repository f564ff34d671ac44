// cairn split: parts of a map as maps of their own.
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "absl/strings/str_format.h"
#include "care/selection.h"
#include "care/whole_map.h"
#include "cli/cli.h"
#include "cli/loaded_map.h"
#include "inspect/measures.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

constexpr std::size_t kFilesOfMap = 8;  // that a map has open while it is written, at most

struct SplitCommand {
  std::string map, out;
  std::string by;
  std::vector<double> box;
  bool overwrite = false;
  bool json = false;
};

struct Part {
  std::string name;  // "component-2"
  std::function<bool(const map::Keyframe&)> keep;
  std::string file = {};
  std::int64_t keyframes = 0, points = 0;
};

std::vector<Part> PartsOf(const SplitCommand& command, const map::Snapshot& map) {
  std::vector<Part> parts;
  if (!command.box.empty()) {
    const Vector3d low(command.box[0], command.box[1], command.box[2]);
    const Vector3d high(command.box[3], command.box[4], command.box[5]);
    const auto inside = [&map, low, high](const map::Keyframe& keyframe) {
      const Vector3d at = inspect::Placed(map, keyframe.component, keyframe.CenterInMap());
      return (at.array() >= low.array()).all() && (at.array() < high.array()).all();
    };
    parts.push_back({"inside", inside});
    parts.push_back({"outside", [inside](const map::Keyframe& keyframe) { return !inside(keyframe); }});
    return parts;
  }
  if (command.by == "component") {
    for (const ComponentId id : map.LiveComponents()) {
      parts.push_back({absl::StrCat("component-", id.value()),
                       [id](const map::Keyframe& keyframe) { return keyframe.component == id; }});
    }
    return parts;
  }
  for (const auto& [id, session] : map.sessions()) {
    const SessionId wanted = id;
    bool any = false;
    map.keyframes().ForEach([&](const auto& keyframe) { any |= keyframe->session == wanted; });
    if (!any) continue;
    parts.push_back({absl::StrCat("session-", id.value()),
                     [wanted](const map::Keyframe& keyframe) { return keyframe.session == wanted; }});
  }
  return parts;
}

// So many more than usual, if the system lets the process have them; if not, opening one says so.
void AllowOpenFiles(std::size_t more) {
  rlimit limit = {};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, limit.rlim_cur + more);
  setrlimit(RLIMIT_NOFILE, &limit);
}

absl::StatusOr<std::vector<Part>> RunSplit(const SplitCommand& command) {
  CAIRN_ASSIGN_OR_RETURN(const LoadedMap loaded, LoadMap("split", command.map));
  CAIRN_RETURN_IF_ERROR(RequireKeyframes(command.map, *loaded.map));
  std::vector<Part> parts = PartsOf(command, *loaded.map);
  FreshFolder folder(command.out);
  std::error_code error;
  std::filesystem::create_directories(command.out, error);
  if (error) return absl::InvalidArgumentError(absl::StrCat(command.out, ": ", error.message()));
  const std::string stem = std::filesystem::path(command.map).stem().string();
  std::vector<std::shared_ptr<const map::Snapshot>> made;
  // All are made before the first one is written.
  for (Part& part : parts) {
    part.file = (std::filesystem::path(command.out) / absl::StrCat(stem, "-", part.name, ".cairn")).string();
    CAIRN_RETURN_IF_ERROR(CheckDistinct({part.file}, {command.map}));
    CAIRN_RETURN_IF_ERROR(CheckWritable(part.file, command.overwrite, /*is_map=*/true));
    const map::MapInfo info =
        care::NewMapInfo(loaded.map->info(), absl::StrCat(loaded.map->info().name, " ", part.name));
    absl::StatusOr<std::shared_ptr<const map::Snapshot>> map = care::SelectKeyframes(*loaded.map, info, part.keep);
    if (!map.ok()) return Annotate(map.status(), part.name);
    part.keyframes = static_cast<std::int64_t>((*map)->keyframes().size());
    part.points = static_cast<std::int64_t>((*map)->points().size());
    made.push_back(*std::move(map));
  }
  // All are written before the first one gets its name.
  AllowOpenFiles(kFilesOfMap * parts.size());
  std::vector<std::unique_ptr<store::MapStore>> written;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    CAIRN_ASSIGN_OR_RETURN(written.emplace_back(),
                           care::PrepareNewMap(*made[i], made[i]->info(), loaded.Vocabulary(), parts[i].file,
                                               command.overwrite, absl::StrCat("split off ", parts[i].name)));
  }
  for (const std::unique_ptr<store::MapStore>& store : written) CAIRN_RETURN_IF_ERROR(store->Close());
  folder.Keep();
  return parts;
}

void PrintSplit(const SplitCommand& command, const std::vector<Part>& parts) {
  if (command.json) {
    nlohmann::ordered_json json = nlohmann::ordered_json::array();
    for (const Part& part : parts) {
      json.push_back(
          {{"part", part.name}, {"file", part.file}, {"keyframes", part.keyframes}, {"points", part.points}});
    }
    PrintJson({{"map", command.map}, {"parts", json}});
    return;
  }
  for (const Part& part : parts) {
    text::Say(absl::StrFormat("%s: %s, %s\n", text::Shown(part.file), text::Keyframes(part.keyframes),
                              text::Points(part.points)));
  }
}

}  // namespace

void AddSplitCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("split", "Parts of a map as maps of their own");
  auto command = std::make_shared<SplitCommand>();
  verb->add_option("MAP", command->map, "Map file (.cairn); it is only read")->required();
  CLI::Option* const by = verb->add_option("--by", command->by, "What becomes a map: each component, or each session")
                              ->check(CLI::IsMember({"component", "session"}));
  verb->add_option("--box", command->box,
                   "X0 Y0 Z0 X1 Y1 Z1: two maps, of the cameras in this box and of the others; metres in the world "
                   "where a component is aligned, else map units")
      ->expected(6)
      ->excludes(by);
  verb->add_option("-o,--out", command->out, "Folder that they are written to, as MAP-component-1.cairn and so on")
      ->required();
  verb->add_flag("--overwrite", command->overwrite, "Replace maps that are there");
  verb->add_flag("--json", command->json, "Answer in JSON");
  verb->footer(
      "Each is whole by itself: points that its keyframes see, cameras, the vocabulary. Ids and alignments stay.\n"
      "Examples:\n"
      "  cairn split office.cairn --by component -o parts\n"
      "  cairn split office.cairn --box -5 -5 -2 5 5 4 -o parts --json");
  verb->callback([=] {
    *action = [=] {
      if (command->by.empty() == command->box.empty()) {
        return FailUsage("split", "give --by or --box", command->json);
      }
      for (std::size_t i = 0; !command->box.empty() && i < 3; ++i) {
        if (command->box[i] < command->box[i + 3]) continue;
        return FailUsage("split",
                         absl::StrFormat("--box: %c0 is %g and %c1 %g: the smaller corner comes first", "XYZ"[i],
                                         command -> box[i], "XYZ"[i], command -> box[i + 3]),
                         command->json);
      }
      const absl::StatusOr<std::vector<Part>> parts = RunSplit(*command);
      if (!parts.ok()) return Fail("split", parts.status(), command->json);
      PrintSplit(*command, *parts);
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli
