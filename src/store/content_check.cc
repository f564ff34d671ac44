#include "store/content_check.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "store/each_row.h"
#include "store/map_reader.h"
#include "store/ready_check.h"

namespace cairn::store {
namespace {

// Points are looked at in so many ranges of ids at most; of each keyframe it is kept in which it observes some.
constexpr std::size_t kMostRanges = 256;
constexpr std::uint32_t kFewestIdsPerRange = 1 << 15;

bool IsRigid(const SE3& pose) {
  return pose.translation().allFinite() && pose.rotation().coeffs().allFinite() &&
         std::abs(pose.rotation().norm() - 1.0) < 1e-6;
}

// What is kept of every keyframe.
struct KnownKeyframe {
  ReadyKeyframe head;
  KeyframeId parent;
  bool has_features = false, has_points = false;
  std::bitset<kMostRanges> ranges;  // in which it observes points
};

class ContentCheck {
 public:
  ContentCheck(Database* database, const FindingSink& sink)
      : database_(database),
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

  KnownKeyframe* FindKeyframe(std::int64_t id) {
    const auto at = std::lower_bound(keyframes_.begin(), keyframes_.end(), id, [](const auto& known, std::int64_t key) {
      return static_cast<std::int64_t>(known.head.id.value()) < key;
    });
    return at == keyframes_.end() || static_cast<std::int64_t>(at->head.id.value()) != id ? nullptr : &*at;
  }

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
    const std::uint64_t per_range = map_row_.next_point.value() / kMostRanges + 1;
    ids_per_range_ = static_cast<std::uint32_t>(std::max<std::uint64_t>(
        (per_range + kPointsPerPage - 1) / kPointsPerPage * kPointsPerPage, kFewestIdsPerRange));
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
      KnownKeyframe& known = keyframes_.emplace_back();
      known.head = {keyframe.id, keyframe.session, keyframe.camera, keyframe.component, keyframe.camera_from_map, 0};
      known.parent = keyframe.parent;
      return absl::OkStatus();
    });
  }

  absl::Status ReadFeatures() {
    const absl::string_view table = kFeaturesTable.name;
    CAIRN_ASSIGN_OR_RETURN(const std::optional<std::uint32_t> num_words, ReadNumWords(database_));
    const absl::Status read = ForEachRow(kFeaturesTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
      KnownKeyframe* known = FindKeyframe(id);
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
    for (const KnownKeyframe& known : keyframes_) {
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
      KnownKeyframe* known = FindKeyframe(id);
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
        known->ranges.set(point.value() / ids_per_range_);
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
      const KnownKeyframe* a = FindKeyframe(edge.a.value());
      const KnownKeyframe* b = FindKeyframe(edge.b.value());
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
    for (const KnownKeyframe& known : keyframes_) {
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
      const KnownKeyframe* parent = FindKeyframe(known.parent.value());
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
      for (const KnownKeyframe* at = &keyframes_[i]; at != nullptr;) {
        std::uint32_t& met = visit[static_cast<std::size_t>(at - keyframes_.data())];
        if (met == i + 1) return Report("keyframes", 0, "the parents of some keyframes form a circle");
        if (met != 0) break;
        met = i + 1;
        at = at->parent ? FindKeyframe(at->parent.value()) : nullptr;
      }
    }
    return absl::OkStatus();
  }

  // With all that observe them. False, and the rest is left, as soon as one is not good by itself.
  absl::StatusOr<bool> CheckAllPoints() {
    const auto outside = database_->QueryInt(
        absl::StrCat("SELECT EXISTS (SELECT 1 FROM points WHERE id < 0 OR id >= ", map_row_.next_point.value(), ")"));
    if (IsDamaged(outside.status()) || (outside.ok() && *outside != 0)) return false;
    CAIRN_RETURN_IF_ERROR(outside.status());
    std::int64_t points = 0;
    for (std::uint32_t range = 0; range * std::uint64_t{ids_per_range_} < map_row_.next_point.value(); ++range) {
      const std::uint32_t first = range * ids_per_range_;
      CAIRN_ASSIGN_OR_RETURN(const bool good, ReadRange(first, std::uint64_t{first} + ids_per_range_));
      if (!good) return false;
      points += static_cast<std::int64_t>(num_in_range_);
      CAIRN_RETURN_IF_ERROR(CheckPoints(range, first));
    }
    return points == map_row_.point_count;
  }

  // Those of the range of ids that was read.
  absl::Status CheckPoints(std::uint32_t range, std::uint32_t first) {
    const std::uint64_t end = std::uint64_t{first} + ids_per_range_;
    for (const KnownKeyframe& known : keyframes_) {
      if (known.ranges.test(range)) CAIRN_RETURN_IF_ERROR(TakeObservations(known, first, end));
    }
    for (std::size_t i = 0; i < num_in_range_; ++i) {
      map::MapPoint& point = in_range_[i];
      const auto reference =
          std::ranges::find(point.observations, point.reference.keyframe, &map::Observation::keyframe);
      if (reference != point.observations.end()) {
        point.reference = *reference;
      } else {
        CAIRN_RETURN_IF_ERROR(Report("points", point.id.value(), "the reference keyframe does not observe the point"));
      }
    }
    return num_findings_ > 0 ? absl::OkStatus() : CheckReadyPoints();
  }

  absl::StatusOr<bool> ReadRange(std::uint32_t first, std::uint64_t end) {
    place_.assign(ids_per_range_, 0);
    component_.resize(ids_per_range_);
    num_in_range_ = 0;
    CAIRN_ASSIGN_OR_RETURN(Statement rows,
                           database_->Prepare(kPointsTable.SelectSql("WHERE id >= ? AND id < ? ORDER BY id")));
    rows.Bind(1, std::int64_t{first});
    rows.Bind(2, static_cast<std::int64_t>(end));
    Row row;
    while (true) {
      const absl::StatusOr<bool> found = rows.Step();
      if (IsDamaged(found.status())) return false;
      CAIRN_RETURN_IF_ERROR(found.status());
      if (!*found) return true;
      PointRow value;
      if (!ReadChecked(rows, &row, &value).ok() || !value.position.allFinite()) return false;
      if (num_in_range_ == in_range_.size()) in_range_.emplace_back();
      map::MapPoint& point = in_range_[num_in_range_++];
      SetFromRow(value, &point);
      point.observations.clear();
      component_[num_in_range_ - 1] = ComponentId();
      place_[value.id.value() - first] = static_cast<std::uint32_t>(num_in_range_);
    }
  }

  absl::Status TakeObservations(const KnownKeyframe& known, std::uint32_t first, std::uint64_t end) {
    CAIRN_ASSIGN_OR_RETURN(const std::vector<PointId> points, PointsOf(known));
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      if (!points[i] || points[i].value() < first || points[i].value() >= end) continue;
      const std::uint32_t place = place_[points[i].value() - first];
      map::MapPoint* point = place == 0 ? nullptr : &in_range_[place - 1];
      const bool twice =
          point != nullptr && !point->observations.empty() && point->observations.back().keyframe == known.head.id;
      if (point == nullptr || twice) {
        CAIRN_RETURN_IF_ERROR(
            Report("keyframe_points", known.head.id.value(),
                   absl::StrCat("point ", points[i].value(), twice ? " is there twice" : " is missing")));
        continue;
      }
      if (!point->observations.empty() && component_[place - 1] != known.head.component) {
        CAIRN_RETURN_IF_ERROR(Report("points", point->id.value(), "it is seen from two components"));
      }
      component_[place - 1] = known.head.component;
      point->observations.push_back({known.head.id, i});
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<PointId>> PointsOf(const KnownKeyframe& known) {
    if (!points_of_) {
      CAIRN_ASSIGN_OR_RETURN(points_of_, database_->Prepare(kKeyframePointsTable.SelectSql("WHERE keyframe = ?")));
    }
    points_of_->Bind(1, static_cast<std::int64_t>(known.head.id.value()));
    CAIRN_ASSIGN_OR_RETURN(const bool found, points_of_->Step());
    if (!found) return absl::DataLossError("a row is gone");
    auto points = PointIdsFromRow(*points_of_, known.head.num_features);
    points_of_->Reset();
    return points;
  }

  // --- what is ready to be queried ---

  absl::Status CheckReadyPoints() {
    if (!ready_.compares()) return absl::OkStatus();
    std::vector<const map::MapPoint*> of_page;
    for (std::size_t i = 0; i < num_in_range_;) {
      const std::uint32_t page = in_range_[i].id.value() / kPointsPerPage;
      of_page.clear();
      for (; i < num_in_range_ && in_range_[i].id.value() / kPointsPerPage == page; ++i) {
        of_page.push_back(&in_range_[i]);
      }
      CAIRN_RETURN_IF_ERROR(ready_.CheckPage(ReadyKind::kPoints, page, PackReadyPoints(of_page)));
    }
    return absl::OkStatus();
  }

  absl::Status CheckReady() {
    if (!ready_.compares()) return absl::OkStatus();
    ReadyIndex index;
    index.revision = map_row_.revision;
    index.next_keyframe = map_row_.next_keyframe;
    index.next_point = map_row_.next_point;
    for (const map::MapCamera& camera : cameras_) index.focal_px.emplace_back(camera.id, camera.pinhole.fx_px);
    for (const KnownKeyframe& known : keyframes_) index.AddKeyframe(known.head);
    for (std::uint32_t id = 1; id < observed_.size(); ++id) {
      if (observed_[id]) index.AddPoint(PointId(id));
    }
    CAIRN_RETURN_IF_ERROR(ready_.CheckIndex(std::move(index)));
    return CheckReadyKeyframes();
  }

  absl::Status CheckReadyKeyframes() {
    std::vector<std::pair<KeyframeId, KeyframeId>> children;  // behind their parents
    for (const KnownKeyframe& known : keyframes_) {
      if (known.parent) children.emplace_back(known.parent, known.head.id);
    }
    std::sort(children.begin(), children.end());
    CAIRN_ASSIGN_OR_RETURN(
        Statement edges, database_->Prepare(kCovisibilityTable.SelectSql("WHERE keyframe_a = ?1 OR keyframe_b = ?1")));
    std::vector<std::shared_ptr<map::Keyframe>> of_page;
    std::uint32_t page = 0;
    const absl::Status read = ForEach<map::Keyframe>(kKeyframesTable, [&](map::Keyframe&& keyframe) -> absl::Status {
      const KnownKeyframe* known = FindKeyframe(keyframe.id.value());
      if (known == nullptr) return absl::OkStatus();
      if (keyframe.id.value() / kKeyframesPerPage != page) {
        CAIRN_RETURN_IF_ERROR(CheckKeyframePage(page, &of_page));
        page = keyframe.id.value() / kKeyframesPerPage;
      }
      CAIRN_ASSIGN_OR_RETURN(keyframe.points, PointsOf(*known));
      CAIRN_RETURN_IF_ERROR(AddNeighbours(&edges, &keyframe));
      const auto [begin, end] = std::equal_range(children.begin(), children.end(), std::pair(keyframe.id, KeyframeId()),
                                                 [](const auto& a, const auto& b) { return a.first < b.first; });
      for (auto child = begin; child != end; ++child) keyframe.children.push_back(child->second);
      of_page.push_back(std::make_shared<map::Keyframe>(std::move(keyframe)));
      return absl::OkStatus();
    });
    CAIRN_RETURN_IF_ERROR(read);
    return CheckKeyframePage(page, &of_page);
  }

  absl::Status CheckKeyframePage(std::uint32_t page, std::vector<std::shared_ptr<map::Keyframe>>* of_page) {
    std::vector<const map::Keyframe*> keyframes;
    for (const auto& keyframe : *of_page) keyframes.push_back(keyframe.get());
    const absl::Status checked = keyframes.empty()
                                     ? absl::OkStatus()
                                     : ready_.CheckPage(ReadyKind::kKeyframes, page, PackReadyKeyframes(keyframes));
    of_page->clear();
    return checked;
  }

  static absl::Status AddNeighbours(Statement* edges, map::Keyframe* keyframe) {
    edges->Bind(1, static_cast<std::int64_t>(keyframe->id.value()));
    Row row;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, edges->Step());
      if (!found) break;
      EdgeRow edge;
      CAIRN_RETURN_IF_ERROR(ReadChecked(*edges, &row, &edge));
      keyframe->covisible.push_back({edge.a == keyframe->id ? edge.b : edge.a, edge.shared_points});
    }
    SortCovisible(keyframe);
    return absl::OkStatus();
  }

  Database* database_;
  std::size_t num_findings_ = 0;
  const FindingSink sink_;
  MapReader reader_;
  ReadyCheck ready_;
  MapRow map_row_;
  std::vector<map::MapCamera> cameras_;
  std::vector<KnownKeyframe> keyframes_;  // ascending
  std::vector<bool> observed_;            // by id: points that keyframes observe
  std::int64_t num_edges_ = 0;
  std::uint32_t ids_per_range_ = 0;
  std::vector<map::MapPoint> in_range_;  // kept, for their room
  std::size_t num_in_range_ = 0;         // of these
  std::vector<ComponentId> component_;   // of these: from where they are seen
  std::vector<std::uint32_t> place_;     // by id from the first of the range on: there, + 1; 0: none
  std::optional<Statement> points_of_;
};

}  // namespace

absl::Status CheckContentByRows(Database* database, const FindingSink& sink) {
  return ContentCheck(database, sink).Run();
}

}  // namespace cairn::store
