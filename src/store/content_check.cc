#include "store/content_check.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/guarded.h"
#include "store/checked_keyframe.h"
#include "store/each_row.h"
#include "store/map_reader.h"
#include "store/point_check.h"
#include "store/ready_check.h"
#include "store/ready_keyframe_check.h"

namespace cairn::store {
namespace {

bool IsRigid(const SE3& pose) {
  return pose.translation().allFinite() && pose.rotation().coeffs().allFinite() &&
         std::abs(pose.rotation().norm() - 1.0) < 1e-6;
}

class ContentCheck {
 public:
  ContentCheck(Database* database, const FindingSink& sink, OfferedWork* shared, Database* beside)
      : database_(database),
        shared_(shared),
        beside_(beside),
        sink_([this, &sink](const Finding& finding) {
          ++num_findings_;
          return sink(finding);
        }),
        reader_(database, sink_),
        ready_(database, sink_) {}

  absl::Status Run() {
    CAIRN_RETURN_IF_ERROR(reader_.ReadInfo());
    CAIRN_RETURN_IF_ERROR(ready_.Begin(reader_.map_row().revision));
    CAIRN_RETURN_IF_ERROR(CheckRows());
    CAIRN_RETURN_IF_ERROR(reader_.CheckVocabulary());
    CAIRN_RETURN_IF_ERROR(reader_.CheckChanges());
    if (num_findings_ > 0) return ReadPoints();
    const absl::Status linked = CheckLinks();
    if (num_findings_ > 0) return ReadPoints();
    CAIRN_RETURN_IF_ERROR(linked);
    CAIRN_ASSIGN_OR_RETURN(const bool sound, CheckAllPoints());
    if (!sound) CAIRN_RETURN_IF_ERROR(ReadPoints());
    if (num_findings_ > 0) return absl::OkStatus();
    if (!sound) return Report(kPointsTable.name, 0, "what is read of it differs from one time to the next");
    return CheckReady();
  }

 private:
  absl::Status Report(absl::string_view table, std::int64_t id, absl::string_view message) {
    return sink_(Finding{std::string(table), id, std::string(message)});
  }

  CheckedKeyframe* FindKeyframe(std::int64_t id) { return store::FindKeyframe(std::span(keyframes_), id); }

  // --- each row by itself ---

  auto Reporting() {
    return [this](absl::string_view table, std::int64_t id, absl::string_view message) {
      return Report(table, id, message);
    };
  }
  template <class Use>
  absl::Status ForEachRow(const TableSpec& table, Use use) {
    return store::ForEachRow(database_, table, kNewestFormat, Reporting(), std::move(use));
  }
  template <class Value, class Use>
  absl::Status ForEach(const TableSpec& table, Use use) {
    return ForEachChecked<Value>(database_, table, kNewestFormat, Reporting(), std::move(use));
  }

  absl::Status CheckRows() {
    CAIRN_RETURN_IF_ERROR(reader_.ReadDescription());
    map_row_ = reader_.map_row();
    cameras_ = reader_.content().cameras;
    ranges_ = PointRanges::Of(map_row_.next_point);
    ranges_.ready = ready_.compares();
    CAIRN_RETURN_IF_ERROR(ReadKeyframes());
    CAIRN_RETURN_IF_ERROR(ReadFeatures());
    CAIRN_RETURN_IF_ERROR(ReadPointIds());
    CAIRN_RETURN_IF_ERROR(ReadEdges());
    CAIRN_RETURN_IF_ERROR(
        CheckCount("keyframes", static_cast<std::int64_t>(keyframes_.size()), map_row_.keyframe_count));
    return CheckCount("covisibility", num_edges_, map_row_.covisibility_count);
  }

  absl::Status CheckCount(absl::string_view table, std::int64_t good, std::int64_t expected) {
    if (good == expected) return absl::OkStatus();
    return Report(table, 0, absl::StrCat("there are ", good, " good rows instead of ", expected));
  }

  absl::Status ReadKeyframes() {
    return ForEach<map::Keyframe>(kKeyframesTable, [&](map::Keyframe&& keyframe) -> absl::Status {
      if (!IsRigid(keyframe.camera_from_map) || !IsRigid(keyframe.camera_from_direct)) {
        return Report("keyframes", keyframe.id.value(), "a pose is not a rigid transform");
      }
      if (keyframe.id >= map_row_.next_keyframe) {
        CAIRN_RETURN_IF_ERROR(Report("keyframes", keyframe.id.value(), "an id that was never given"));
      }
      CheckedKeyframe& known = keyframes_.emplace_back();
      known.head = {keyframe.id, keyframe.session, keyframe.camera, keyframe.component, keyframe.camera_from_map, 0};
      known.parent = keyframe.parent;
      return absl::OkStatus();
    });
  }

  absl::Status ReadFeatures() {
    const absl::string_view table = kFeaturesTable.name;
    CAIRN_ASSIGN_OR_RETURN(const std::optional<std::uint32_t> num_words, ReadNumWords(database_));
    const absl::Status read = ForEachRow(kFeaturesTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
      CheckedKeyframe* known = FindKeyframe(id);
      if (known == nullptr) return Report(table, id, "there is no such keyframe");
      const auto camera = std::ranges::find(cameras_, known->head.camera, &map::MapCamera::id);
      const bool found = camera != cameras_.end();
      if (!found) CAIRN_RETURN_IF_ERROR(Report("keyframes", id, "its camera is missing"));
      const auto blobs = FeatureBlobsFromRow(row, found ? &camera->pinhole : nullptr, map_row_.info.orb.num_levels);
      if (!blobs.ok()) return Report(table, id, blobs.status().message());
      const std::vector<std::uint32_t> words = blobs->Words();
      const absl::string_view wrong = num_words ? WrongWords(words, *num_words) : "";
      if (!wrong.empty()) return Report(table, id, wrong);
      known->has_features = true;
      known->head.num_features = static_cast<std::uint32_t>(blobs->size());
      ready_.TakeWords(known->head.id, words);
      return absl::OkStatus();
    });
    CAIRN_RETURN_IF_ERROR(read);
    for (const CheckedKeyframe& known : keyframes_) {
      if (!known.has_features) {
        CAIRN_RETURN_IF_ERROR(Report(table, known.head.id.value(), "no good row for the keyframe"));
      }
    }
    return absl::OkStatus();
  }

  absl::Status ReadPointIds() {
    const absl::string_view table = kKeyframePointsTable.name;
    observed_.resize(map_row_.next_point.value());
    std::size_t good = 0;
    CAIRN_RETURN_IF_ERROR(ForEachRow(kKeyframePointsTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
      CheckedKeyframe* known = FindKeyframe(id);
      if (known == nullptr) return Report(table, id, "there is no such keyframe");
      if (!known->has_features) return absl::OkStatus();
      const auto points = PointIdsFromRow(row, known->head.num_features);
      if (!points.ok()) return Report(table, id, points.status().message());
      for (const PointId point : *points) {
        if (!point) continue;
        if (point >= map_row_.next_point) {
          return Report(table, id, absl::StrCat("point ", point.value(), " is missing"));
        }
        observed_[point.value()] = true;
        known->ranges.set(ranges_.RangeOf(point));
      }
      ++good;
      return absl::OkStatus();
    }));
    return good == keyframes_.size() ? absl::OkStatus() : Report(table, 0, "not every keyframe has a good row");
  }

  // Each by itself: only if there is something to be told of, as CheckAllPoints() goes through them as well.
  absl::Status ReadPoints() {
    std::int64_t good = 0;
    CAIRN_RETURN_IF_ERROR(ForEach<PointRow>(kPointsTable, [&](PointRow&& row) -> absl::Status {
      ++good;
      const std::int64_t id = row.id.value();
      if (row.id >= map_row_.next_point) return Report("points", id, "an id that was never given");
      if (!row.position.allFinite()) return Report("points", id, "the position is not finite");
      // That it does is found when all of its observations are together.
      return observed_[row.id.value()] ? absl::OkStatus()
                                       : Report("points", id, "the reference keyframe does not observe the point");
    }));
    return CheckCount("points", good, map_row_.point_count);
  }

  absl::Status ReadEdges() {
    return ForEach<EdgeRow>(kCovisibilityTable, [&](EdgeRow&& edge) -> absl::Status {
      ++num_edges_;
      const CheckedKeyframe* a = FindKeyframe(edge.a.value());
      const CheckedKeyframe* b = FindKeyframe(edge.b.value());
      const auto names = absl::StrCat(edge.a.value(), " - ", edge.b.value());
      if (a == nullptr || b == nullptr) {
        return Report("covisibility", edge.a.value(), absl::StrCat("a keyframe of ", names, " is missing"));
      }
      if (a->head.component == b->head.component) return absl::OkStatus();
      return Report("covisibility", edge.a.value(), absl::StrCat(names, " are in different components"));
    });
  }

  // --- all together ---

  absl::Status CheckLinks() {
    CAIRN_ASSIGN_OR_RETURN(const auto heads, reader_.Assemble());
    if (const absl::Status status = heads->CheckConsistency(); !status.ok()) return Report("", 0, status.message());
    if (map_row_.revision == 0 && !keyframes_.empty()) return Report("map", 1, "revision 0, but the map is not empty");
    for (const CheckedKeyframe& known : keyframes_) {
      const std::int64_t id = known.head.id.value();
      const auto wrong = [&](absl::string_view what) { return Report("keyframes", id, what); };
      if (!heads->sessions().contains(known.head.session)) CAIRN_RETURN_IF_ERROR(wrong("its session is missing"));
      const auto component = heads->components().find(known.head.component);
      if (component == heads->components().end()) {
        CAIRN_RETURN_IF_ERROR(wrong("its component is missing"));
      } else if (component->second.joined) {
        CAIRN_RETURN_IF_ERROR(wrong("its component has been joined to another"));
      }
      if (!known.parent) continue;
      const CheckedKeyframe* parent = FindKeyframe(known.parent.value());
      if (parent == nullptr) {
        CAIRN_RETURN_IF_ERROR(wrong("the parent is missing"));
      } else if (parent->head.component != known.head.component) {
        CAIRN_RETURN_IF_ERROR(wrong("the parent is in another component"));
      }
    }
    return num_findings_ > 0 ? absl::OkStatus() : CheckTree();
  }

  absl::Status CheckTree() {
    std::vector<std::uint32_t> visit(keyframes_.size(), 0);  // in which walk up the tree it was met first
    for (std::uint32_t i = 0; i < keyframes_.size(); ++i) {
      for (const CheckedKeyframe* at = &keyframes_[i]; at != nullptr;) {
        std::uint32_t& met = visit[static_cast<std::size_t>(at - keyframes_.data())];
        if (met == i + 1) return Report("keyframes", 0, "the parents of some keyframes form a circle");
        if (met != 0) break;
        met = i + 1;
        at = at->parent ? FindKeyframe(at->parent.value()) : nullptr;
      }
    }
    return absl::OkStatus();
  }

  // What one thread has found of the points, and of the pages of keyframes.
  struct Share {
    std::map<std::uint32_t, std::vector<Finding>> in_range;
    std::vector<Finding> in_pages;
    std::int64_t num_points = 0;
    std::size_t num_findings = 0;
    absl::Status status;

    FindingSink To(std::vector<Finding>* findings) {
      return [this, findings](const Finding& finding) {
        findings->push_back(finding);
        return ++num_findings < kMaxFindings ? absl::OkStatus() : absl::ResourceExhaustedError("too many findings");
      };
    }
  };

  // Points with all that observe them, and pages of keyframes, in this thread and in whoever shares in it. False, and
  // the rest is left, as soon as a point is not good by itself.
  absl::StatusOr<bool> CheckAllPoints() {
    const auto outside = database_->QueryInt(
        absl::StrCat("SELECT EXISTS (SELECT 1 FROM points WHERE id < 0 OR id >= ", map_row_.next_point.value(), ")"));
    if (IsDamaged(outside.status()) || (outside.ok() && *outside != 0)) return false;
    CAIRN_RETURN_IF_ERROR(outside.status());
    Share mine, theirs;
    const auto work = [this](Database* database, Share* share) {
      share->status = Guarded([&] { return WorkOn(database, share); });
      if (!share->status.ok()) give_up_ = true;
    };
    if (shared_ == nullptr) {
      work(database_, &mine);
    } else {
      shared_->Share([&] { work(database_, &mine); },
                     [&] {
                       if (SeesTheSame(beside_)) work(beside_, &theirs);
                     });
    }
    if (!all_sound_) return false;
    mine.in_range.merge(theirs.in_range);
    for (const auto& [range, findings] : mine.in_range) CAIRN_RETURN_IF_ERROR(Tell(findings));
    if (num_findings_ == 0) CAIRN_RETURN_IF_ERROR(Tell(mine.in_pages));
    if (num_findings_ == 0) CAIRN_RETURN_IF_ERROR(Tell(theirs.in_pages));
    for (const Share* share : {&mine, &theirs}) {
      if (share->num_findings < kMaxFindings) CAIRN_RETURN_IF_ERROR(share->status);
    }
    return mine.num_points + theirs.num_points == map_row_.point_count;
  }

  absl::Status Tell(const std::vector<Finding>& findings) {
    for (const Finding& finding : findings) CAIRN_RETURN_IF_ERROR(sink_(finding));
    return absl::OkStatus();
  }

  // Whether the map has not been changed between the beginnings of the two transactions.
  bool SeesTheSame(Database* other) const {
    const auto revision = other->QueryInt("SELECT revision FROM map");
    return revision.ok() && static_cast<Revision>(*revision) == map_row_.revision;
  }

  // Of what nobody else has begun with.
  absl::Status WorkOn(Database* database, Share* share) {
    if (ranges_.ready && !pages_begun_.exchange(true)) {
      CAIRN_RETURN_IF_ERROR(CheckReadyKeyframes(database, keyframes_, share->To(&share->in_pages)));
    }
    PointCheck check(database, ranges_, keyframes_);
    while (!give_up_) {
      const std::uint32_t range = next_range_++;
      if (range >= ranges_.size()) break;
      CAIRN_ASSIGN_OR_RETURN(const bool sound, check.Check(range, share->To(&share->in_range[range])));
      if (!sound) all_sound_ = false;
      if (!sound) give_up_ = true;
    }
    share->num_points = check.num_points();
    return absl::OkStatus();
  }

  // --- what is ready to be queried ---

  absl::Status CheckReady() {
    if (!ready_.compares()) return absl::OkStatus();
    ReadyIndex index;
    index.revision = map_row_.revision;
    index.next_keyframe = map_row_.next_keyframe;
    index.next_point = map_row_.next_point;
    for (const map::MapCamera& camera : cameras_) index.focal_px.emplace_back(camera.id, camera.pinhole.fx_px);
    for (const CheckedKeyframe& known : keyframes_) index.AddKeyframe(known.head);
    for (std::uint32_t id = 1; id < observed_.size(); ++id) {
      if (observed_[id]) index.AddPoint(PointId(id));
    }
    return ready_.CheckIndex(std::move(index));
  }

  Database* const database_;
  OfferedWork* const shared_;
  Database* const beside_;
  std::size_t num_findings_ = 0;
  const FindingSink sink_;
  MapReader reader_;
  ReadyCheck ready_;
  MapRow map_row_;
  std::vector<map::MapCamera> cameras_;
  std::vector<CheckedKeyframe> keyframes_;  // ascending
  std::vector<bool> observed_;              // by id: points that keyframes observe
  std::int64_t num_edges_ = 0;
  PointRanges ranges_;
  std::atomic<std::uint32_t> next_range_ = 0;
  std::atomic<bool> pages_begun_ = false;
  std::atomic<bool> all_sound_ = true;  // each point by itself
  std::atomic<bool> give_up_ = false;
};

}  // namespace

absl::Status CheckContentByRows(Database* database, const FindingSink& sink, OfferedWork* shared, Database* beside) {
  return ContentCheck(database, sink, shared, beside).Run();
}

}  // namespace cairn::store
