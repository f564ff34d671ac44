#include "inspect/listing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "inspect/measures.h"
#include "map/testing_map.h"

namespace cairn::inspect {
namespace {

using map::testing::MakeMap;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::size_t ColumnNamed(const Listing& listing, const std::string& name) {
  const auto at = std::ranges::find(listing.columns, name, &Column::name);
  return static_cast<std::size_t>(at - listing.columns.begin());
}

std::vector<double> Values(const Listing& listing, const std::string& name) {
  std::vector<double> values;
  for (const auto& row : listing.rows) {
    values.push_back(row[ColumnNamed(listing, name)].Number());
  }
  return values;
}

TEST(Measure, ErrorsAreThoseThatWereMade) {
  const auto world = MakeMap(3, 6, 400, /*noise_px=*/0.7);
  double sum = 0.0, count = 0.0;
  world.snapshot->keyframes().ForEach([&](const auto& keyframe) {
    for (const MeasuredObservation& observation : Measure(*world.snapshot, *keyframe)) {
      sum += observation.error_px.squaredNorm();
      count += 1.0;
      EXPECT_GT(observation.depth, 0.1);
    }
  });
  ASSERT_GT(count, 500);
  EXPECT_NEAR(std::sqrt(sum / count), 0.7 * std::sqrt(2.0), 0.05);
}

TEST(Measure, ParallaxIsTheAngleBetweenTheOutermostRays) {
  const auto world = MakeMap(3, 6, 200);
  world.snapshot->points().ForEach([&](const auto& point) {
    const auto ray = [&](const map::Observation& observation) -> Vector3d {
      return (point->position - world.snapshot->keyframe(observation.keyframe).CenterInMap()).normalized();
    };
    // The cameras stand in a row: the first and the last are the outermost.
    const double expected =
        std::acos(std::min(1.0, ray(point->observations.front()).dot(ray(point->observations.back())))) * 180.0 / M_PI;
    EXPECT_NEAR(ParallaxDeg(*world.snapshot, *point), expected, 1e-3);
  });
}

TEST(List, KeyframesWithWhatIsMeasuredOfThem) {
  const auto world = MakeMap(4, 8, 300, 0.5);
  const auto listing = List(*world.snapshot, Kind::kKeyframes);
  ASSERT_TRUE(listing.ok()) << listing.status();
  ASSERT_EQ(listing->rows.size(), 8u);
  EXPECT_EQ(listing->total, 8u);
  EXPECT_THAT(Values(*listing, "id"), ElementsAre(1, 2, 3, 4, 5, 6, 7, 8));
  for (std::size_t i = 0; i < 8; ++i) {
    const Vector3d center = world.poses[i].Inverse().translation();
    EXPECT_NEAR(Values(*listing, "x")[i], center.x(), 1e-12);
    EXPECT_NEAR(Values(*listing, "error_px")[i], 0.5 * std::sqrt(2.0), 0.15);
    const map::Keyframe& keyframe = world.snapshot->keyframe(KeyframeId(static_cast<std::uint32_t>(i + 1)));
    EXPECT_EQ(Values(*listing, "points")[i], NumPoints(keyframe));
  }
}

TEST(List, SortsAndLimits) {
  const auto world = MakeMap(4, 8, 300, 0.5);
  ListingQuery query;
  query.sort = "error_px";
  query.descending = true;
  query.limit = 20;
  const auto listing = List(*world.snapshot, Kind::kPoints, query);
  ASSERT_TRUE(listing.ok()) << listing.status();
  ASSERT_EQ(listing->rows.size(), 20u);
  EXPECT_EQ(listing->total, world.snapshot->points().size());
  const std::vector<double> errors = Values(*listing, "error_px");
  EXPECT_TRUE(std::ranges::is_sorted(errors, std::greater()));
  double largest = 0.0;
  world.snapshot->points().ForEach(
      [&](const auto& point) { largest = std::max(largest, *ErrorRmsPx(*world.snapshot, *point)); });
  EXPECT_EQ(errors[0], largest);
}

// A map of which only some keyframes and points can be looked at: the others are there, and say so.
template <class T>
class SomeOf final : public map::TableSource<T> {
 public:
  SomeOf(std::vector<std::shared_ptr<const T>> all, std::uint32_t size, std::set<std::uint32_t>* looked_at)
      : all_(std::move(all)), size_(size), looked_at_(looked_at) {}
  std::size_t size() const override { return size_; }
  std::uint32_t end() const override { return static_cast<std::uint32_t>(all_.size()); }
  const void* content() const override { return this; }
  const std::shared_ptr<const T>& Find(std::uint32_t id) const override {
    static const std::shared_ptr<const T> none;
    if (id >= all_.size() || !all_[id]) return none;
    looked_at_->insert(id);
    return all_[id];
  }

 private:
  std::vector<std::shared_ptr<const T>> all_;
  std::uint32_t size_;
  std::set<std::uint32_t>* looked_at_;
};

class Watched final : public map::EntitySource {
 public:
  explicit Watched(const map::Snapshot& map) {
    std::vector<std::shared_ptr<const map::Keyframe>> keyframes(map.next_keyframe().value());
    map.keyframes().ForEach([&](const auto& keyframe) { keyframes[keyframe->id.value()] = keyframe; });
    std::vector<std::shared_ptr<const map::MapPoint>> points(map.next_point().value());
    map.points().ForEach([&](const auto& point) { points[point->id.value()] = point; });
    keyframes_ = std::make_shared<SomeOf<map::Keyframe>>(keyframes, static_cast<std::uint32_t>(map.keyframes().size()),
                                                         &keyframes_looked_at);
    points_ = std::make_shared<SomeOf<map::MapPoint>>(points, static_cast<std::uint32_t>(map.points().size()),
                                                      &points_looked_at);
  }
  std::shared_ptr<const map::TableSource<map::Keyframe>> keyframes() const override { return keyframes_; }
  std::shared_ptr<const map::TableSource<map::MapPoint>> points() const override { return points_; }
  std::size_t bytes() const override { return 0; }
  std::shared_ptr<const map::EntitySource> Anew() const override { return nullptr; }

  std::set<std::uint32_t> keyframes_looked_at, points_looked_at;

 private:
  std::shared_ptr<const map::TableSource<map::Keyframe>> keyframes_;
  std::shared_ptr<const map::TableSource<map::MapPoint>> points_;
};

TEST(List, OfFewNoOthersAreLookedAt) {
  const auto world = MakeMap(4, 8, 300, 0.5);
  const map::Snapshot& whole = *world.snapshot;
  const auto source = std::make_shared<Watched>(whole);
  map::SnapshotParts parts;
  parts.revision = whole.revision();
  parts.info = whole.info();
  for (const auto& [id, camera] : whole.cameras()) parts.cameras.push_back(camera);
  for (const auto& [id, session] : whole.sessions()) parts.sessions.push_back(session);
  for (const auto& [id, component] : whole.components()) parts.components.push_back(component);
  parts.entities = source;
  parts.next_keyframe = whole.next_keyframe();
  parts.next_point = whole.next_point();
  const auto map = map::Snapshot::Of(std::move(parts));
  for (const bool descending : {false, true}) {
    const ListingQuery query{"id", descending, {}, 3};
    source->keyframes_looked_at.clear();
    const auto listing = List(*map, Kind::kKeyframes, query);
    ASSERT_TRUE(listing.ok()) << listing.status();
    EXPECT_EQ(listing->total, 8u);
    EXPECT_THAT(Values(*listing, "id"), descending ? ElementsAre(8, 7, 6) : ElementsAre(1, 2, 3));
    EXPECT_EQ(source->keyframes_looked_at.size(), 3u);
    for (const Kind kind : {Kind::kKeyframes, Kind::kPoints}) {
      const auto few = List(*map, kind, query), same = List(whole, kind, {"i", descending, {}, 3});
      ASSERT_TRUE(few.ok() && same.ok());
      for (const Column& column : few->columns) EXPECT_EQ(Values(*few, column.name), Values(*same, column.name));
    }
  }
  source->points_looked_at.clear();
  source->keyframes_looked_at.clear();
  const auto one = ListOne(*map, Kind::kKeyframes, 5);
  ASSERT_TRUE(one);
  EXPECT_THAT(Values(*one, "id"), ElementsAre(5));
  EXPECT_THAT(source->keyframes_looked_at, ElementsAre(5));
  EXPECT_FALSE(ListOne(*map, Kind::kKeyframes, 9));
  EXPECT_FALSE(ListOne(*map, Kind::kPoints, 0));
  EXPECT_THAT(Values(*ListOne(whole, Kind::kCameras, 1), "id"), ElementsAre(1));
  EXPECT_FALSE(ListOne(whole, Kind::kSessions, 7));
}

TEST(List, FiltersMustAllHold) {
  const auto world = MakeMap(4, 8, 300, 0.5);
  ListingQuery query;
  query.filters = {"observations >= 4", "error_px<0.6"};
  const auto listing = List(*world.snapshot, Kind::kPoints, query);
  ASSERT_TRUE(listing.ok()) << listing.status();
  std::size_t expected = 0;
  world.snapshot->points().ForEach([&](const auto& point) {
    expected += point->observations.size() >= 4 && *ErrorRmsPx(*world.snapshot, *point) < 0.6 ? 1 : 0;
  });
  ASSERT_GT(expected, 5u);
  EXPECT_EQ(listing->total, expected);

  query.filters = {"name~cam", "lens_corrected=no"};
  EXPECT_EQ(List(*world.snapshot, Kind::kCameras, query)->total, 1u);
  query.filters = {"name!=camera"};
  EXPECT_EQ(List(*world.snapshot, Kind::kCameras, query)->total, 0u);
  // Not aligned: the scale is not known.
  query.filters = {"scale>0"};
  EXPECT_EQ(List(*world.snapshot, Kind::kComponents, query)->total, 0u);
  query.filters = {"scale!=1"};
  EXPECT_EQ(List(*world.snapshot, Kind::kComponents, query)->total, 1u);
}

TEST(List, AStartOfANameIsEnough) {
  const auto world = MakeMap(4, 8, 300, 0.5);
  const auto full = List(*world.snapshot, Kind::kKeyframes, {"error_px", false, {"session=1"}, 0});
  const auto brief = List(*world.snapshot, Kind::kKeyframes, {"err", false, {"ses=1"}, 0});
  ASSERT_TRUE(full.ok() && brief.ok());
  EXPECT_EQ(Values(*full, "id"), Values(*brief, "id"));
  // Camera and component, or covisible.
  EXPECT_TRUE(absl::IsInvalidArgument(List(*world.snapshot, Kind::kKeyframes, {"c", false, {}, 0}).status()));
  for (const Kind kind : {Kind::kKeyframes, Kind::kPoints, Kind::kSessions, Kind::kComponents, Kind::kCameras}) {
    for (const Column& column : ColumnsOf(kind)) {
      if (column.brief.empty()) continue;
      EXPECT_EQ(column.name.find(column.brief), 0u) << column.brief;
      EXPECT_TRUE(List(*world.snapshot, kind, {column.brief, false, {}, 0}).ok()) << column.brief;
    }
  }
}

TEST(List, SaysWhatIsWrongWithAQuery) {
  const auto world = MakeMap(4, 3, 50);
  const auto message = [&](const ListingQuery& query) {
    const auto listing = List(*world.snapshot, Kind::kKeyframes, query);
    EXPECT_TRUE(absl::IsInvalidArgument(listing.status()));
    return std::string(listing.status().message());
  };
  EXPECT_THAT(message({"size", false, {}, 0}), HasSubstr("there is no column \"size\"; there are id, session"));
  EXPECT_THAT(message({"id", false, {"points"}, 0}), HasSubstr("is no filter"));
  EXPECT_THAT(message({"id", false, {"<5"}, 0}), HasSubstr("is no filter"));
  EXPECT_THAT(message({"id", false, {"size<5"}, 0}), HasSubstr("there is no column"));
  EXPECT_THAT(message({"id", false, {"points<many"}, 0}), HasSubstr("no number"));
  EXPECT_THAT(message({"id", false, {"points~5"}, 0}), HasSubstr("takes =, !="));
  EXPECT_THAT(message({"id", false, {"points!5"}, 0}), HasSubstr("takes =, !="));
}

TEST(List, PlacesWhatIsAlignedInTheWorld) {
  const auto world = MakeMap(4, 5, 200);
  map::Edit edit(world.snapshot);
  map::Component component = edit.component(ComponentId(1));
  component.world_from_component = Sim3(ExpSO3(Vector3d(0, 0, M_PI / 2)), Vector3d(10, 20, 30), 2.0);
  edit.PutComponent(component);
  const auto aligned = *world.snapshot->Apply(edit.Finish("align"));
  const auto before = *List(*world.snapshot, Kind::kKeyframes), after = *List(*aligned, Kind::kKeyframes);
  for (std::size_t i = 0; i < before.rows.size(); ++i) {
    EXPECT_NEAR(Values(after, "x")[i], 10 - 2 * Values(before, "y")[i], 1e-9);
    EXPECT_NEAR(Values(after, "y")[i], 20 + 2 * Values(before, "x")[i], 1e-9);
    EXPECT_NEAR(Values(after, "depth")[i], 2 * Values(before, "depth")[i], 1e-9);
  }
}

}  // namespace
}  // namespace cairn::inspect
