#include "care/pruning.h"

#include <algorithm>
#include <map>
#include <queue>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "inspect/measures.h"
#include "map/edit.h"
#include "mapping/culling.h"

namespace cairn::care {
namespace {

// In a file, by docs/map-format.md: per feature the descriptor, the keypoint, the word and the link to its point; per
// keyframe the rows that go with it; per point its row; per pair of covisible keyframes one.
constexpr std::int64_t kFeatureBytes = 32 + 9 + 3 + 1, kKeyframeBytes = 600, kPointBytes = 49, kEdgeBytes = 22;
// Pages are not full to the last byte, and link to each other.
constexpr double kPageShare = 1.035;
constexpr std::int64_t kEmptyMapBytes = 70'000;

std::int64_t BytesOf(const map::Keyframe& keyframe) {
  return kKeyframeBytes + kFeatureBytes * static_cast<std::int64_t>(keyframe.features.size()) +
         kEdgeBytes * static_cast<std::int64_t>(keyframe.covisible.size()) / 2;
}

std::int64_t RawBytes(const map::Snapshot& map) {
  std::int64_t bytes = kPointBytes * static_cast<std::int64_t>(map.points().size());
  map.keyframes().ForEach([&](const auto& keyframe) { bytes += BytesOf(*keyframe); });
  return bytes;
}

// What a file takes whatever is in it, and how many bytes there come to one of RawBytes().
struct FileModel {
  double fixed = 0.0;
  double per_byte = 1.0;

  FileModel(const store::MapOverview& overview, std::int64_t raw) {
    double content = 0.0;
    for (const store::MapPart& part : overview.parts) {
      if (part.name == "vocabulary" || part.name == "log of changes") {
        fixed += static_cast<double>(part.bytes);
      } else if (part.name != "rest" && part.name != "free") {
        content += static_cast<double>(part.bytes);
      }
    }
    fixed += kEmptyMapBytes;
    if (raw > 0 && content > 0.0) per_byte = kPageShare * content / static_cast<double>(raw);
  }
  std::int64_t Bytes(std::int64_t raw) const {
    return static_cast<std::int64_t>(fixed + per_byte * static_cast<double>(raw));
  }
};

// Points that are seen from elsewhere are found from there; that somebody sees the same view counts as much, so that
// what is left stands evenly.
double Redundancy(const map::Edit& edit, KeyframeId id) {
  double seen = 0.0;
  for (const int observers : {1, 2, 3}) seen += mapping::RedundantShare(edit, id, observers) / 3.0;
  const map::Keyframe& keyframe = edit.keyframe(id);
  const int points = inspect::NumPoints(keyframe);
  const double same_view =
      points > 0 && !keyframe.covisible.empty() ? 1.0 * keyframe.covisible[0].shared_points / points : 0.0;
  return 0.5 * (seen + same_view);
}

class Pruner {
 public:
  Pruner(const std::shared_ptr<const map::Snapshot>& map, const FileModel& file, const PruneOptions& options)
      : map_(*map), edit_(map), file_(file), options_(options), raw_(RawBytes(*map)) {
    for (const ComponentId id : map->LiveComponents()) left_[id] = map->NumKeyframes(id);
  }

  void DropClutter() {
    std::vector<PointId> clutter;
    map_.points().ForEach([&](const auto& point) {
      if (mapping::IsClutter(*point, mapper_)) clutter.push_back(point->id);
    });
    for (const PointId id : clutter) edit_.ErasePoint(id);
    raw_ -= kPointBytes * static_cast<std::int64_t>(clutter.size());
  }

  // What goes makes nothing more redundant: a keyframe that is still ahead once it has been looked at anew is the next.
  void DropKeyframes() {
    using Ranked = std::pair<double, std::uint32_t>;
    std::priority_queue<Ranked> queue;
    map_.keyframes().ForEach([&](const auto& keyframe) {
      // Of two that are as redundant the younger goes: places of old keyframes are known best.
      if (keyframe->parent) queue.emplace(Redundancy(edit_, keyframe->id), keyframe->id.value());
    });
    while (!queue.empty() && !Done(queue.top().first)) {
      const KeyframeId id(queue.top().second);
      queue.pop();
      const map::Keyframe& keyframe = edit_.keyframe(id);
      if (left_[keyframe.component] <= options_.min_keyframes) continue;
      const double now = Redundancy(edit_, id);
      if (!queue.empty() && now < queue.top().first) {
        queue.emplace(now, id.value());
        continue;
      }
      if (Done(now)) break;
      Drop(keyframe);
    }
  }

  bool InBudget() const { return !options_.budget_bytes || file_.Bytes(raw_) <= *options_.budget_bytes; }
  std::int64_t bytes() const { return file_.Bytes(raw_); }
  map::Edit& edit() { return edit_; }

 private:
  bool Done(double redundancy) const {
    return options_.budget_bytes ? InBudget() : redundancy < options_.min_redundancy;
  }

  // A point that one keyframe is left to see can still be found: it stays.
  void Drop(const map::Keyframe& keyframe) {
    const KeyframeId id = keyframe.id;
    const std::int64_t bytes = BytesOf(map_.keyframe(id));
    std::int64_t unseen = 0;
    for (const PointId point : keyframe.points) unseen += point && edit_.point(point).observations.size() == 1 ? 1 : 0;
    --left_[keyframe.component];
    if (!edit_.EraseKeyframe(id, 1)) return;
    raw_ -= bytes + kPointBytes * unseen;
  }

  const map::Snapshot& map_;
  map::Edit edit_;
  const FileModel file_;
  const PruneOptions& options_;
  const mapping::FeatureMapperOptions mapper_;
  std::int64_t raw_;
  std::map<ComponentId, std::int64_t> left_;
};

}  // namespace

absl::Status PruneOptions::Validate() const {
  if (budget_bytes && *budget_bytes <= 0) return absl::InvalidArgumentError("prune: the budget must be positive");
  if (!(min_redundancy > 0.0 && min_redundancy <= 1.0)) {
    return absl::InvalidArgumentError("prune: the redundancy must be within (0, 1]");
  }
  if (min_keyframes < 2) return absl::InvalidArgumentError("prune: two keyframes at least must be left");
  return absl::OkStatus();
}

std::int64_t PredictBytes(const store::MapOverview& overview, const map::Snapshot& before, const map::Snapshot& map) {
  return FileModel(overview, RawBytes(before)).Bytes(RawBytes(map));
}

absl::StatusOr<PrunePlan> PlanPruning(const std::shared_ptr<const map::Snapshot>& map,
                                      const store::MapOverview& overview, const PruneOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const FileModel file(overview, RawBytes(*map));
  Pruner pruner(map, file, options);
  PrunePlan plan;
  plan.bytes_before = overview.summary.file_bytes;
  if (!options.budget_bytes || !pruner.InBudget()) pruner.DropClutter();
  pruner.DropKeyframes();
  if (!pruner.InBudget() && !options.as_far_as_possible) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "it cannot be made smaller than %.1f MB without losing whole components or more than all redundancy: of that "
        "%.1f MB are the vocabulary, the log and the file's own; see also cairn pack --localization-only",
        static_cast<double>(pruner.bytes()) / 1e6, file.fixed / 1e6));
  }
  plan.delta = pruner.edit().Finish("prune");
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> after, map->Apply(plan.delta));
  plan.keyframes = static_cast<std::int64_t>(plan.delta.removed_keyframes.size());
  plan.points = static_cast<std::int64_t>(plan.delta.removed_points.size());
  plan.keyframes_left = static_cast<std::int64_t>(after->keyframes().size());
  plan.points_left = static_cast<std::int64_t>(after->points().size());
  plan.bytes_after = PredictBytes(overview, *map, *after);
  return plan;
}

}  // namespace cairn::care
