#include "mapping/map_memory.h"

#include <algorithm>
#include <cstdint>
#include <unordered_map>

#include "absl/strings/str_format.h"

namespace cairn::mapping {
namespace {

using Entry = KeyframeTrajectory::Entry;

struct Seen {
  int points = 0;
  int outlasting = 0;  // the window
};

// Which points of the map were seen from keyframes further apart than the window is long, or of another segment or
// session.
class Memory {
 public:
  Memory(const std::vector<Entry>& entries, const map::Snapshot& map, const MapMemoryOptions& options)
      : entries_(entries), map_(map), window_(static_cast<std::size_t>(options.window_keyframes)) {
    for (std::size_t i = 0; i < entries.size(); ++i) {
      if (entries[i].keyframe && map.keyframes().Contains(entries[i].keyframe)) index_of_[entries[i].keyframe] = i;
    }
  }

  Seen Of(std::size_t entry) {
    Seen seen;
    const auto own = index_of_.find(entries_[entry].keyframe);
    if (!entries_[entry].keyframe || own == index_of_.end() || own->second != entry) return seen;
    for (const PointId point : map_.keyframe(entries_[entry].keyframe).points) {
      if (!point) continue;
      ++seen.points;
      seen.outlasting += Outlasts(point) ? 1 : 0;
    }
    return seen;
  }

 private:
  bool Outlasts(PointId id) {
    const auto [known, is_new] = outlasts_.try_emplace(id, false);
    if (!is_new) return known->second;
    std::size_t first = entries_.size(), last = 0;
    for (const map::Observation& observation : map_.point(id).observations) {
      const auto index = index_of_.find(observation.keyframe);
      if (index == index_of_.end()) return known->second = true;
      first = std::min(first, index->second);
      last = std::max(last, index->second);
    }
    return known->second =
               last > first && (last - first > window_ || entries_[first].segment != entries_[last].segment);
  }

  const std::vector<Entry>& entries_;
  const map::Snapshot& map_;
  const std::size_t window_;
  std::unordered_map<KeyframeId, std::size_t> index_of_;
  std::unordered_map<PointId, bool> outlasts_;
};

// What the keyframes within half a window of each entry see.
std::vector<Seen> Pooled(const std::vector<Entry>& entries, const std::vector<Seen>& seen, std::size_t radius) {
  std::vector<Seen> pooled(seen.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    for (std::size_t j = i > radius ? i - radius : 0; j < std::min(seen.size(), i + radius + 1); ++j) {
      if (entries[j].segment != entries[i].segment) continue;
      pooled[i].points += seen[j].points;
      pooled[i].outlasting += seen[j].outlasting;
    }
  }
  return pooled;
}

// Runs of the same value within a segment.
std::vector<Stretch> Runs(const Stretch& segment, const std::vector<std::uint8_t>& values) {
  std::vector<Stretch> runs;
  for (std::size_t i = segment.begin; i < segment.end; ++i) {
    if (runs.empty() || values[i] != values[i - 1]) runs.push_back({i, i});
    runs.back().end = i + 1;
  }
  return runs;
}

void AppendStretches(const Stretch& segment, std::size_t window, std::vector<std::uint8_t>* forgets,
                     std::vector<Stretch>* stretches) {
  const std::vector<Stretch> runs = Runs(segment, *forgets);
  for (const Stretch& run : runs) {
    if (runs.size() > 1 && run.end - run.begin <= window) {
      std::fill(forgets->begin() + static_cast<std::ptrdiff_t>(run.begin),
                forgets->begin() + static_cast<std::ptrdiff_t>(run.end), std::uint8_t{2});  // too short to tell
    }
  }
  // What is too short to tell goes with what is before it, at the beginning with what is after.
  std::uint8_t before = 2;
  for (std::size_t i = segment.begin; i < segment.end && before == 2; ++i) before = (*forgets)[i];
  if (before == 2) before = 1;  // nothing lasts
  for (std::size_t i = segment.begin; i < segment.end; ++i) {
    if ((*forgets)[i] == 2) (*forgets)[i] = before;
    before = (*forgets)[i];
  }
  for (const Stretch& run : Runs(segment, *forgets)) {
    if ((*forgets)[run.begin] != 0) stretches->push_back(run);
  }
}

}  // namespace

absl::Status MapMemoryOptions::Validate() const {
  if (window_keyframes < 1) return absl::InvalidArgumentError("map memory: window_keyframes must be at least 1");
  if (!(min_share >= 0.0 && min_share <= 1.0)) {
    return absl::InvalidArgumentError("map memory: min_share must be in [0, 1]");
  }
  return absl::OkStatus();
}

std::vector<Stretch> DirectStretches(const std::vector<Entry>& entries, const map::Snapshot& map,
                                     const MapMemoryOptions& options) {
  Memory memory(entries, map, options);
  std::vector<Seen> seen;
  for (std::size_t i = 0; i < entries.size(); ++i) seen.push_back(memory.Of(i));
  const auto window = static_cast<std::size_t>(options.window_keyframes);
  const std::vector<Seen> pooled = Pooled(entries, seen, window / 2);
  std::vector<std::uint8_t> forgets;
  for (const Seen& seen_around : pooled) {
    forgets.push_back(seen_around.outlasting < options.min_share * seen_around.points ? 1 : 0);
  }
  std::vector<Stretch> stretches;
  for (std::size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    while (end < entries.size() && entries[end].segment == entries[begin].segment) ++end;
    AppendStretches({begin, end}, window, &forgets, &stretches);
  }
  return stretches;
}

TrajectoryChoice ChooseTrajectory(const std::vector<Entry>& entries, std::span<const Stretch> stretches,
                                  bool loop_closed, bool lens_corrected) {
  if (loop_closed) return {true, "refined: a loop was closed"};
  if (lens_corrected) return {true, "refined: the lens was corrected, which the odometry did not know"};
  if (stretches.empty()) return {true, "refined: the map remembers points for longer than the odometry's window"};
  std::size_t direct = 0;
  for (const Stretch& stretch : stretches) direct += stretch.end - stretch.begin;
  if (direct == entries.size()) {
    return {false, "direct: the map remembers hardly any point for longer than the odometry's window"};
  }
  constexpr std::size_t kTold = 3;
  std::string where;
  for (std::size_t i = 0; i < std::min(kTold, stretches.size()); ++i) {
    const auto seconds = [&](std::size_t entry) { return ToSeconds(entries[entry].time_ns - entries.front().time_ns); };
    absl::StrAppendFormat(&where, "%s%.1f to %.1f s", i == 0 ? "" : ", ", seconds(stretches[i].begin),
                          seconds(stretches[i].end - 1));
  }
  if (stretches.size() > kTold) absl::StrAppend(&where, ", ...");
  return {2 * direct <= entries.size(),
          absl::StrCat("refined, but direct from ", where,
                       ", where the map remembers hardly any point for longer than the odometry's window")};
}

}  // namespace cairn::mapping
