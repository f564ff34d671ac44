#include "care/merging.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_set>
#include <utility>

#include "care/adjustment.h"
#include "care/whole_map.h"
#include "inspect/difference.h"
#include "map/edit.h"
#include "mapping/feature_mapper_options.h"
#include "mapping/point_fusion.h"
#include "tracking/map_view.h"

namespace cairn::care {
namespace {

// The head of a map that is only made.
class HeadInMemory final : public mapping::MapHead {
 public:
  explicit HeadInMemory(std::shared_ptr<const tracking::MapView> view) : view_(std::move(view)) {}
  const std::shared_ptr<const tracking::MapView>& View() const override { return view_; }
  absl::Status Commit(map::Delta delta, const mapping::KeyframeScales& /*scales*/) override {
    CAIRN_ASSIGN_OR_RETURN(view_, view_->After(delta));
    return absl::OkStatus();
  }

 private:
  std::shared_ptr<const tracking::MapView> view_;
};

// What came of one image in one run, whatever is left of its features.
bool SameShot(const map::Keyframe& a, const map::Keyframe& b) {
  if (a.direct_segment != b.direct_segment || !inspect::SameButForId(a, b)) return false;
  if (a.features.size() != b.features.size()) return a.direct_segment >= 0;  // one is packed; given poses prove little
  return a.features.Get()->features.descriptors == b.features.Get()->features.descriptors;
}

// The sessions of `map` of which every keyframe is in the other map, too.
std::vector<SessionId> SessionsIn(const map::Snapshot& map, const map::Snapshot& other) {
  std::multimap<TimeNs, const map::Keyframe*> others;
  other.keyframes().ForEach([&](const auto& keyframe) { others.emplace(keyframe->time_ns, keyframe.get()); });
  std::map<SessionId, bool> all_there;
  map.keyframes().ForEach([&](const auto& keyframe) {
    bool& all = all_there.try_emplace(keyframe->session, true).first->second;
    const auto [first, last] = others.equal_range(keyframe->time_ns);
    all = all && std::any_of(first, last, [&](const auto& entry) { return SameShot(*keyframe, *entry.second); });
  });
  std::vector<SessionId> sessions;
  for (const auto& [id, all] : all_there) {
    if (all) sessions.push_back(id);
  }
  return sessions;
}

// What both have would be there twice. Two runs of one recording may have begun alike.
absl::Status CheckNothingTwice(const map::Snapshot& first, const map::Snapshot& second) {
  bool common = false;
  first.keyframes().ForEach(
      [&](const auto& keyframe) { common |= inspect::SameKeyframe(*keyframe, second) != nullptr; });
  if (common && first.info().id == second.info().id) {
    return absl::FailedPreconditionError(
        "they have keyframes in common: two copies of one map, not two maps (cairn diff says what they differ in)");
  }
  const auto refuse = [](SessionId session, const char* of, const char* other) {
    return absl::FailedPreconditionError(absl::StrCat("they have keyframes in common: session ", session.value(),
                                                      " of the ", of, " map is all in the ", other,
                                                      " one, of which it is a copy or with which it was merged before "
                                                      "(cairn session remove takes one out of a map)"));
  };
  if (const auto there = SessionsIn(second, first); !there.empty()) return refuse(there[0], "second", "first");
  if (const auto there = SessionsIn(first, second); !there.empty()) return refuse(there[0], "first", "second");
  return absl::OkStatus();
}

bool IsAligned(const map::Snapshot& map, ComponentId id) { return map.WorldFrom(id).has_value(); }

// Whether the second map's world has become that of the whole: the first has none, or components of both worlds were
// found to be one. Others may be two.
bool WorldIsKept(const map::Snapshot& first, const map::Snapshot& second, const std::vector<MergeAttempt>& attempts) {
  if (std::ranges::none_of(first.LiveComponents(), [&](ComponentId id) { return IsAligned(first, id); })) return true;
  return std::ranges::any_of(attempts, [&](const MergeAttempt& attempt) {
    return attempt.joined_into && IsAligned(second, attempt.component) && IsAligned(first, attempt.joined_into);
  });
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> WithAnchor(const std::shared_ptr<const map::Snapshot>& merged,
                                                                const map::GeoAnchor& anchor) {
  map::Edit edit(merged);
  map::MapInfo info = edit.info();
  info.geo_anchor = anchor;
  edit.SetInfo(info);
  return merged->Apply(edit.Finish("merge"));
}

class Merging {
 public:
  Merging(const std::shared_ptr<const map::Snapshot>& first, std::shared_ptr<const tracking::MapView> both,
          const MergeOptions& options, std::int64_t wall_clock_ns)
      : first_(*first), options_(options), wall_clock_ns_(wall_clock_ns), head_(std::move(both)) {}

  absl::Status Join(const std::function<bool(int, int)>& progress) {
    CAIRN_ASSIGN_OR_RETURN(mapping::ComponentJoiner joiner, mapping::ComponentJoiner::Create(options_.join));
    const std::vector<KeyframeId> keyframes = Added();
    for (std::size_t i = 0; i < keyframes.size(); ++i) {
      const ComponentId component = head_.View()->map().keyframe(keyframes[i]).component;
      if (IsAdded(component)) {
        CAIRN_ASSIGN_OR_RETURN(const mapping::JoinReport report, joiner.Process(keyframes[i], wall_clock_ns_, head_));
        Note(component, keyframes[i], report);
      }
      if (progress && !progress(static_cast<int>(i + 1), static_cast<int>(keyframes.size()))) {
        return absl::CancelledError("interrupted");
      }
    }
    return absl::OkStatus();
  }

  // Along the whole overlap, as a session would have done on its way, and then the adjustment of all.
  absl::Status Settle(Merged* merged) {
    const std::shared_ptr<const map::Snapshot> map = head_.View()->snapshot();
    map::Edit edit(map);
    mapping::GridCache grids;
    const mapping::FeatureMapperOptions usual;
    for (const KeyframeId id : FromTheSeams(*map)) {
      const auto around =
          mapping::SurroundingKeyframes(edit, id, usual.fusion_neighbours, usual.fusion_second_neighbours, {});
      mapping::FusionOptions fusion;
      fusion.radius_px = usual.fusion_radius_px;
      const mapping::FusionCounts counts = mapping::FuseAround(edit, id, around, grids, fusion);
      fused_[map->keyframe(id).component] += counts.fused;
      edit.UpdateCovisibility(id);
    }
    const std::vector<ComponentId> joined(joined_.begin(), joined_.end());
    CAIRN_ASSIGN_OR_RETURN(AdjustedChange change, AdjustAfter(map, edit.Finish("merge"), joined));
    merged->adjusted_keyframes = change.keyframes;
    merged->adjustment_rmse_px = change.rmse_px;
    return head_.Commit(std::move(change.delta), {});
  }

  bool joined() const { return !joined_.empty(); }
  const tracking::MapView& view() const { return *head_.View(); }

  std::vector<MergeAttempt> TakeAttempts() {
    std::vector<MergeAttempt> attempts;
    const auto before = first_.next_component().value() - 1;
    for (auto& [id, attempt] : attempts_) {
      attempt.component = ComponentId(id.value() - before);
      if (attempt.joined_into) attempt.fused_points += fused_[attempt.joined_into];
      attempts.push_back(std::move(attempt));
    }
    return attempts;
  }

 private:
  bool IsAdded(ComponentId id) const { return id >= first_.next_component(); }
  bool IsAdded(KeyframeId id) const { return id >= first_.next_keyframe(); }

  // Those of the second map, one session after the other, in the order of time: what is found lately must agree.
  std::vector<KeyframeId> Added() const {
    std::vector<const map::Keyframe*> keyframes;
    head_.View()->map().keyframes().ForEach([&](const auto& keyframe) {
      if (IsAdded(keyframe->id)) keyframes.push_back(keyframe.get());
    });
    std::ranges::stable_sort(keyframes, {}, [](const map::Keyframe* keyframe) {
      return std::make_pair(keyframe->session, keyframe->time_ns);
    });
    std::vector<KeyframeId> ids;
    for (const map::Keyframe* keyframe : keyframes) ids.push_back(keyframe->id);
    return ids;
  }

  void Note(ComponentId component, KeyframeId keyframe, const mapping::JoinReport& report) {
    MergeAttempt& attempt = attempts_[component];
    ++attempt.keyframes;
    if (!report.seen) return;
    ++attempt.seen;
    if (!report.rejected.empty()) ++attempt.rejected[report.rejected];
    const bool further = report.joined || report.sightings_agreeing > attempt.sightings_agreeing || !attempt.nearest;
    if (further) {
      attempt.nearest = report.seen_in;
      attempt.sightings_agreeing = report.sightings_agreeing;
      attempt.sightings_checked = report.sightings_checked;
      attempt.neighbours_agreeing = report.evidence.neighbours_agreeing;
      attempt.neighbours_checked = report.evidence.neighbours_checked;
    }
    if (!report.joined) return;
    seams_.push_back(keyframe);
    attempt.scale = report.scale;
    attempt.fused_points += report.fused_points;
    // Two of the second map may have been joined to each other before.
    if (IsAdded(report.into)) return;
    joined_.insert(report.into);
    for (auto& [id, other] : attempts_) {
      if (view().map().Resolve(id) == report.into) other.joined_into = report.into;
    }
  }

  // The second map's keyframes that are in a joined component, from where they were joined on along what they share.
  std::vector<KeyframeId> FromTheSeams(const map::Snapshot& map) const {
    std::vector<KeyframeId> order;
    std::unordered_set<KeyframeId> known;
    const auto reach = [&](KeyframeId id) {
      if (IsAdded(id) && joined_.contains(map.keyframe(id).component) && known.insert(id).second) order.push_back(id);
    };
    for (const KeyframeId seam : seams_) reach(seam);
    for (std::size_t i = 0; i < order.size(); ++i) {
      for (const map::CovisibilityEdge& edge : map.keyframe(order[i]).covisible) reach(edge.keyframe);
    }
    return order;
  }

  const map::Snapshot& first_;
  const MergeOptions& options_;
  const std::int64_t wall_clock_ns_;
  HeadInMemory head_;
  std::map<ComponentId, MergeAttempt> attempts_;  // as the merged map calls them
  std::set<ComponentId> joined_;                  // of the first map
  std::vector<KeyframeId> seams_;
  std::map<ComponentId, int> fused_;
};

}  // namespace

absl::StatusOr<Merged> MergeMaps(const std::shared_ptr<const map::Snapshot>& first, const map::Snapshot& second,
                                 const std::shared_ptr<const place::Vocabulary>& words, const MergeOptions& options,
                                 std::int64_t wall_clock_ns, const std::function<bool(int, int)>& progress) {
  if (first->keyframes().empty() || second.keyframes().empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("the ", first->keyframes().empty() ? "first" : "second", " map has no keyframes"));
  }
  if (words == nullptr) {
    return absl::FailedPreconditionError("the first map has no vocabulary, so that no place can be found in it");
  }
  CAIRN_RETURN_IF_ERROR(CheckNothingTwice(*first, second));
  CAIRN_ASSIGN_OR_RETURN(const auto before, tracking::MapView::Create(first, words));
  CAIRN_ASSIGN_OR_RETURN(const map::Delta beside, Beside(*first, second, words.get(), "merge"));
  CAIRN_ASSIGN_OR_RETURN(const auto both, before->After(beside));
  Merging merging(first, both, options, wall_clock_ns);
  CAIRN_RETURN_IF_ERROR(merging.Join(progress));
  Merged merged;
  if (merging.joined()) CAIRN_RETURN_IF_ERROR(merging.Settle(&merged));
  merged.attempts = merging.TakeAttempts();
  if (!merging.joined() && !options.allow_apart) return merged;
  merged.map = merging.view().snapshot();
  const auto& anchor = second.info().geo_anchor;
  if (anchor && !first->info().geo_anchor && WorldIsKept(*first, second, merged.attempts)) {
    CAIRN_ASSIGN_OR_RETURN(merged.map, WithAnchor(merged.map, *anchor));
  }
  return merged;
}

}  // namespace cairn::care
