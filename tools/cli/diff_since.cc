#include "cli/diff_since.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "cli/align_report.h"
#include "cli/cli.h"
#include "cli/geo_options.h"
#include "cli/id_lists.h"
#include "cli/map_to_read.h"
#include "map/changed_rows.h"
#include "store/map_store.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// What became of the rows of a kind since a revision, by id.
template <class IdType>
struct ChangesOf {
  std::vector<IdType> added, changed, removed, came_and_went;

  std::vector<IdType> Put() const {
    std::vector<IdType> put;
    std::ranges::merge(added, changed, std::back_inserter(put));
    return put;
  }
};

struct ChangesOfIds {
  bool told_apart = false;  // false: what was added is among what changed, and what came and went among what is removed
  ChangesOf<CameraId> cameras;
  ChangesOf<SessionId> sessions;
  ChangesOf<ComponentId> components;
  ChangesOf<KeyframeId> keyframes;
  ChangesOf<PointId> points;
};

template <class IdType>
void Sort(IdType id, bool there, const std::optional<IdType>& first_new, ChangesOf<IdType>* changes) {
  const bool is_new = first_new && !(id < *first_new);
  (there ? (is_new ? changes->added : changes->changed) : (is_new ? changes->came_and_went : changes->removed))
      .push_back(id);
}

ChangesOfIds Sort(const map::ChangedRows& rows, const map::Snapshot& map) {
  ChangesOfIds changes;
  const auto& first_new = rows.first_new;
  changes.told_apart = first_new.has_value();
  const auto first = [&](auto map::FirstNewIds::*kind) {
    return first_new ? std::optional((*first_new).*kind) : std::nullopt;
  };
  for (const CameraId id : rows.cameras) {
    Sort(id, map.cameras().contains(id), first(&map::FirstNewIds::camera), &changes.cameras);
  }
  for (const SessionId id : rows.sessions) {
    Sort(id, map.sessions().contains(id), first(&map::FirstNewIds::session), &changes.sessions);
  }
  for (const ComponentId id : rows.components) {
    Sort(id, map.components().contains(id), first(&map::FirstNewIds::component), &changes.components);
  }
  for (const map::ChangedKeyframe& row : rows.keyframes) {
    Sort(row.id, map.keyframes().Contains(row.id), first(&map::FirstNewIds::keyframe), &changes.keyframes);
  }
  for (const PointId id : rows.points) {
    Sort(id, map.points().Contains(id), first(&map::FirstNewIds::point), &changes.points);
  }
  return changes;
}

template <class IdType>
void PrintChanges(absl::string_view what, bool told_apart, const ChangesOf<IdType>& changes, std::size_t limit) {
  const auto print = [&](absl::string_view how, const std::vector<IdType>& ids) {
    PrintIds(absl::StrCat(what, " ", how), ids, limit);
  };
  print("added", changes.added);
  print(told_apart ? "changed" : "added or changed", changes.changed);
  print(told_apart ? "removed" : "gone, also such as had come since", changes.removed);
  print("that came and went", changes.came_and_went);
}

}  // namespace

absl::Status DiffSince(const DiffSinceOptions& options) {
  TellLogDamage("diff", options.server, options.map);
  CAIRN_ASSIGN_OR_RETURN(const MapToRead source, MapToRead::Open(options.server, options.map));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         store::OpenMapStore(source.path(), store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, store->LoadSnapshot());
  CAIRN_ASSIGN_OR_RETURN(const auto rows, store->ReadChangedRows(options.since));
  if (!rows) {
    return absl::FailedPreconditionError(absl::StrCat(options.map, " does not know what has changed since revision ",
                                                      options.since, ": it is at ", map->revision(),
                                                      " and keeps the newest ", store::kMaxDeltaRevisions, " changes"));
  }
  const ChangesOfIds changes = Sort(*rows, *map);
  if (options.json) {
    const auto known = [&](nlohmann::ordered_json value) { return changes.told_apart ? std::move(value) : nullptr; };
    PrintJson({{"map", options.map},
               {"since", options.since},
               {"revision", map->revision()},
               {"info_put", rows->info},
               {"geo_anchor", AnchorAsJson(map->info().geo_anchor)},
               {"told_apart", changes.told_apart},
               {"cameras_put", IdsAsJson(rows->cameras)},
               {"cameras_added", known(IdsAsJson(changes.cameras.added))},
               {"sessions_put", IdsAsJson(rows->sessions)},
               {"sessions_added", known(IdsAsJson(changes.sessions.added))},
               {"components_put", IdsAsJson(rows->components)},
               {"components_added", known(IdsAsJson(changes.components.added))},
               {"keyframes_put", IdsAsJson(changes.keyframes.Put())},
               {"keyframes_added", known(IdsAsJson(changes.keyframes.added))},
               {"keyframes_removed", IdsAsJson(changes.keyframes.removed)},
               {"keyframes_came_and_went", known(IdsAsJson(changes.keyframes.came_and_went))},
               {"points_put", changes.points.Put().size()},
               {"points_added", known(changes.points.added.size())},
               {"points_removed", changes.points.removed.size()},
               {"points_came_and_went", known(changes.points.came_and_went.size())}});
    return absl::OkStatus();
  }
  std::printf("%s: revision %llu to %llu\n", text::Shown(options.map).c_str(),
              static_cast<unsigned long long>(options.since), static_cast<unsigned long long>(map->revision()));
  if (rows->info) {
    const auto& anchor = map->info().geo_anchor;
    std::fputs(text::Wrapped(absl::StrCat("what is said of the map as a whole; place on the earth: ",
                                          anchor ? DescribeAnchor(*anchor) : "not known"),
                             "  ", "    ")
                   .c_str(),
               stdout);
  }
  PrintChanges("cameras", changes.told_apart, changes.cameras, options.limit);
  PrintChanges("sessions", changes.told_apart, changes.sessions, options.limit);
  PrintChanges("components", changes.told_apart, changes.components, options.limit);
  PrintChanges("keyframes", changes.told_apart, changes.keyframes, options.limit);
  const auto& points = changes.points;
  if (changes.told_apart) {
    std::printf("  points: %zu added, %zu changed, %zu removed; %zu came and went\n", points.added.size(),
                points.changed.size(), points.removed.size(), points.came_and_went.size());
  } else {
    std::printf("  points: %zu added or changed, %zu gone\n", points.changed.size(), points.removed.size());
    std::fputs(text::Wrapped("What is new, and what came and went, is not known of a map that has forgotten its first "
                             "changes, or was begun by recover or of an older format.",
                             "  ", "  ")
                   .c_str(),
               stdout);
  }
  return absl::OkStatus();
}

}  // namespace cairn::cli
