#include "tracking/relocalizer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tracking/map_view.h"
#include "tracking/testing_world.h"

namespace cairn::tracking {
namespace {

using namespace testing_world;  // NOLINT

// Two rooms with a map of 24 keyframes, made once for all tests.
struct Scene {
  World world;
  std::shared_ptr<const place::Vocabulary> vocabulary;
  std::shared_ptr<const map::Snapshot> map;
  std::unique_ptr<PlaceIndex> places;

  static const Scene& Get() {
    static const Scene* scene = [] {
      auto* made = new Scene;
      Random random(11);
      AddRoom(Vector3d::Zero(), 2000, random, &made->world);
      AddRoom(Vector3d(20, 0, 0), 2000, random, &made->world);
      AddPoster(Vector3d::Zero(), 1.2, 150, random, &made->world);
      made->vocabulary = TrainVocabulary(made->world);
      std::vector<SE3> poses = PathInRoom(Vector3d::Zero(), 12);
      for (const SE3& pose : PathInRoom(Vector3d(20, 0, 0), 12)) poses.push_back(pose);
      made->map = BuildMap(made->world, poses, *made->vocabulary, {}, random);
      made->places = std::make_unique<PlaceIndex>(*PlaceIndex::Build(made->vocabulary, *made->map));
      return made;
    }();
    return *scene;
  }
  View See(const SE3& pose, std::uint64_t seed, const ViewOptions& options = {}) const {
    Random random(seed);
    return Observe(world, pose, map->info().orb, options, random);
  }
};

Relocalization Locate(const Scene& scene, const image::Features& features, const RelocalizerOptions& options = {}) {
  auto answer = Relocalizer(options).Relocalize(*scene.map, *scene.places, kPinhole, features);
  EXPECT_TRUE(answer.ok()) << answer.status();
  return *std::move(answer);
}

TEST(Relocalizer, FindsCamerasInBothRooms) {
  const Scene& scene = Scene::Get();
  for (int i = 0; i < 12; ++i) {
    const bool second = i % 2 == 1;
    const SE3 truth = Look(Vector3d((second ? 20.0 : 0.0) - 1.5 + 0.25 * i, 0.3, -1.7), 0.2 * std::sin(i));
    const Relocalization answer = Locate(scene, scene.See(truth, 100 + i).features);
    ASSERT_TRUE(answer.localized) << i << ": " << answer.reason;
    EXPECT_EQ(answer.stage, RelocalizationStage::kDone);
    EXPECT_LT(CenterError(answer.place.camera_from_map, truth), 0.02);
    EXPECT_LT(RotationErrorDeg(answer.place.camera_from_map, truth), 0.3);
    EXPECT_EQ(answer.place.reference_keyframe.value() > 12, second);
    EXPECT_EQ(answer.counts.inliers, static_cast<int>(answer.place.inliers.size()));
    EXPECT_GE(answer.counts.inliers, 50);
    EXPECT_GT(answer.counts.visible, answer.counts.inliers);
    EXPECT_GT(answer.counts.candidates, 0);
    // The error is what the covariance says, within reason.
    const Vector6d error = (answer.place.camera_from_map.Inverse() * truth).Log();
    EXPECT_LT(error.dot(answer.place.covariance.ldlt().solve(error)), 60.0);
  }
}

TEST(Relocalizer, SameInputSameAnswer) {
  const Scene& scene = Scene::Get();
  const View view = scene.See(Look({0.4, 0.1, -1.5}, 0.1), 5);
  const Relocalization a = Locate(scene, view.features), b = Locate(scene, view.features);
  ASSERT_TRUE(a.localized);
  EXPECT_EQ(a.place.camera_from_map.translation(), b.place.camera_from_map.translation());
  EXPECT_EQ(a.place.camera_from_map.rotation().coeffs(), b.place.camera_from_map.rotation().coeffs());
  EXPECT_EQ(a.place.covariance, b.place.covariance);
}

TEST(Relocalizer, ACameraWithAnotherLensIsFine) {
  const Scene& scene = Scene::Get();
  const Pinhole other{800, 600, 750.0, 750.0, 400.0, 310.0};
  const SE3 truth = Look({0.0, 0.0, -2.4}, 0.1);
  Random random(8);
  World seen = scene.world;
  for (auto& point : seen.points) point.finest_distance *= 1.5;  // a longer lens sees detail from farther away
  const View view = Observe(seen, truth, scene.map->info().orb, {}, random, other);
  const auto answer = Relocalizer().Relocalize(*scene.map, *scene.places, other, view.features);
  ASSERT_TRUE(answer.ok());
  ASSERT_TRUE(answer->localized) << answer->reason;
  EXPECT_LT(CenterError(answer->place.camera_from_map, truth), 0.02);
}

// Every answer is right within five standard deviations, or says that the calibration does not fit.
TEST(Relocalizer, AWrongCalibrationIsToldOrCovered) {
  const Scene& scene = Scene::Get();
  int told = 0, images = 0;
  for (const double factor : {0.65, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 1.6}) {
    for (int i = 0; i < 6; ++i) {
      const SE3 truth = Look(Vector3d(-1.2 + 0.4 * i, 0.2, -1.6), 0.25 * std::sin(i));
      Pinhole wrong = kPinhole;
      wrong.fx_px *= factor;
      wrong.fy_px *= factor;
      const View view = scene.See(truth, 300 + i);
      const auto answer = Relocalizer().Relocalize(*scene.map, *scene.places, wrong, view.features);
      ASSERT_TRUE(answer.ok()) << answer.status();
      const bool says = answer->place.focal_factor != 1.0;
      ++images;
      told += says ? 1 : 0;
      if (says && answer->localized) {
        EXPECT_NEAR(std::log(answer->place.focal_factor * factor), 0.0, 0.08) << factor;
      }
      if (!answer->localized) {
        EXPECT_EQ(says, answer->reason.find("the calibration does not fit") != std::string::npos) << answer->reason;
        continue;
      }
      const Vector6d error = (answer->place.camera_from_map.Inverse() * truth).Log();
      const bool covered = error.dot(answer->place.covariance.ldlt().solve(error)) < 25.0 * 6.0;
      EXPECT_TRUE(says || covered) << factor << ", image " << i;
    }
  }
  EXPECT_GT(told, 0.6 * images);  // what is 5 % off is covered
}

// Before a wall no image tells the focal length from the distance, so that sigma has to cover it: down to half of it
// (with less it is further off than what is taken for the worst).
TEST(Relocalizer, BeforeAWallAWrongCalibrationIsCovered) {
  const Scene& scene = Scene::Get();
  int silent = 0;
  for (const double factor : {0.5, 0.6, 0.8, 1.25}) {
    for (int i = 0; i < 10; ++i) {
      const SE3 truth = Look(Vector3d(-1.6 + 0.32 * i, 0.2, 1.0), 0.1 * std::sin(i));
      Pinhole wrong = kPinhole;
      wrong.fx_px *= factor;
      wrong.fy_px *= factor;
      const auto answer =
          Relocalizer().Relocalize(*scene.map, *scene.places, wrong, scene.See(truth, 900 + i).features);
      ASSERT_TRUE(answer.ok()) << answer.status();
      if (!answer->localized || answer->place.focal_factor != 1.0) continue;
      ++silent;
      const SE3 map_from_camera = answer->place.camera_from_map.Inverse();
      Eigen::Matrix<double, 3, 6> by_increment;
      by_increment << Matrix3d::Identity(), -Hat(map_from_camera.translation());
      const Matrix3d covariance = by_increment * answer->place.covariance * by_increment.transpose();
      EXPECT_LT(CenterError(answer->place.camera_from_map, truth), 5.0 * std::sqrt(covariance.trace()))
          << factor << ", image " << i;
    }
  }
  EXPECT_GT(silent, 20);
}

TEST(Relocalizer, ARightCalibrationIsNotDoubted) {
  const Scene& scene = Scene::Get();
  for (int i = 0; i < 40; ++i) {
    const SE3 truth = Look(Vector3d(-1.6 + 0.08 * i, 0.2, -1.6), 0.3 * std::sin(i));
    const Relocalization answer = Locate(scene, scene.See(truth, 500 + i).features);
    EXPECT_EQ(answer.place.focal_factor, 1.0) << i;
  }
}

TEST(Relocalizer, SaysWhichStageFailed) {
  const Scene& scene = Scene::Get();
  const SE3 truth = Look({0, 0, -2}, 0.0);

  const Relocalization blank = Locate(scene, {});
  EXPECT_FALSE(blank.localized);
  EXPECT_EQ(blank.stage, RelocalizationStage::kFeatures);
  EXPECT_THAT(blank.reason, testing::HasSubstr("0 features"));

  // Nothing but clutter: words, but no matches.
  ViewOptions clutter;
  clutter.detected_share = 0.0;
  clutter.clutter = 300;
  const Relocalization strange = Locate(scene, scene.See(truth, 1, clutter).features);
  EXPECT_FALSE(strange.localized);
  EXPECT_EQ(strange.stage, RelocalizationStage::kMatches) << strange.reason;
  EXPECT_EQ(strange.counts.features, 300);
  EXPECT_GT(strange.counts.candidates, 0);
  EXPECT_LT(strange.counts.word_matches, 15);

  // The right descriptors in the wrong places.
  View shuffled = scene.See(truth, 2);
  Random random(3);
  for (auto& keypoint : shuffled.features.keypoints) {
    keypoint.x_px = static_cast<float>(random.Uniform(0, 639));
    keypoint.y_px = static_cast<float>(random.Uniform(0, 479));
  }
  const Relocalization scrambled = Locate(scene, shuffled.features);
  EXPECT_FALSE(scrambled.localized);
  EXPECT_EQ(scrambled.stage, RelocalizationStage::kPnp) << scrambled.reason;
  EXPECT_GT(scrambled.counts.word_matches, 30);
  EXPECT_LT(scrambled.counts.pnp_inliers, 10);

  // Too little of the right place.
  ViewOptions sparse;
  sparse.detected_share = 0.03;
  RelocalizerOptions options;
  options.min_word_matches = 5;
  options.pnp.min_inliers = 5;
  const Relocalization weak = Locate(scene, scene.See(truth, 4, sparse).features, options);
  EXPECT_FALSE(weak.localized);
  EXPECT_EQ(weak.stage, RelocalizationStage::kRefinement) << weak.reason;
  EXPECT_GE(weak.counts.pnp_inliers, 5);
  EXPECT_GT(weak.counts.visible, 50);
  EXPECT_THAT(weak.reason, testing::HasSubstr("points that should be in view"));
}

TEST(Relocalizer, AnEmptyMapHasNoCandidates) {
  const Scene& scene = Scene::Get();
  const auto empty = map::Snapshot::Empty(scene.map->info());
  const auto places = PlaceIndex::Build(scene.vocabulary, *empty);
  ASSERT_TRUE(places.ok());
  const auto answer = Relocalizer().Relocalize(*empty, *places, kPinhole, scene.See(Look({0, 0, -2}, 0), 1).features);
  ASSERT_TRUE(answer.ok());
  EXPECT_EQ(answer->stage, RelocalizationStage::kCandidates);
  EXPECT_EQ(answer->counts.candidates, 0);
}

// A third, unmapped room holds a twin of an object of the first one: many consistent matches in one part of the image.
TEST(Relocalizer, ATwinOfAnObjectIsNotThePlace) {
  const Scene& scene = Scene::Get();
  World third;
  Random random(12);
  AddRoom(Vector3d(0, 0, 40), 1500, random, &third);
  for (std::size_t i = scene.world.points.size() - 150; i < scene.world.points.size(); ++i) {
    WorldPoint twin = scene.world.points[i];
    twin.position += Vector3d(1.0, 0.4, 40.0);
    third.points.push_back(twin);
  }
  for (int i = 0; i < 5; ++i) {
    Random noise(50 + i);
    const View view = Observe(third, Look(Vector3d(0.3 * i, 0.2, 38.2), 0.1), scene.map->info().orb, {}, noise);
    EXPECT_FALSE(Locate(scene, view.features).localized);
    RelocalizerOptions options;  // the spread alone must be enough to see it
    options.max_position_sigma = 1.0;
    options.max_rotation_sigma_deg = 90.0;
    const Relocalization answer = Locate(scene, view.features, options);
    EXPECT_FALSE(answer.localized);
    EXPECT_EQ(answer.stage, RelocalizationStage::kRefinement) << answer.reason;
    EXPECT_GE(answer.counts.inliers, 50) << "the trap is no trap";
    EXPECT_THAT(answer.reason, testing::HasSubstr("cells of the image"));
  }
}

TEST(Relocalizer, ChecksItsArguments) {
  const Scene& scene = Scene::Get();
  const View view = scene.See(Look({0, 0, -2}, 0), 1);
  RelocalizerOptions options;
  EXPECT_TRUE(options.Validate().ok()) << options.Validate();
  options.guided_radius_factors.clear();
  EXPECT_EQ(Relocalizer(options).Relocalize(*scene.map, *scene.places, kPinhole, view.features).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Relocalizer().Relocalize(*scene.map, *scene.places, Pinhole(), view.features).status().code(),
            absl::StatusCode::kInvalidArgument);
  const auto empty = map::Snapshot::Empty(scene.map->info());
  EXPECT_EQ(Relocalizer().Relocalize(*empty, *scene.places, kPinhole, view.features).status().code(),
            absl::StatusCode::kFailedPrecondition);
}

TEST(PlaceIndex, GivesTheCoarsestOctaveOfEachWord) {
  const Scene& scene = Scene::Get();
  const image::Features features = scene.See(Look({0, 0, -2}, 0), 1).features;
  const PlaceIndex::Words words = scene.places->Transform(features);
  const std::vector<place::WordId> word_of = scene.places->vocabulary().LookupAll(features.descriptors);
  ASSERT_EQ(words.octaves.size(), words.bow.size());
  ASSERT_FALSE(words.bow.empty());
  for (std::size_t i = 0; i < words.bow.size(); ++i) {
    int coarsest = -1;
    for (std::size_t k = 0; k < word_of.size(); ++k) {
      if (word_of[k] == words.bow[i].word) coarsest = std::max<int>(coarsest, features.keypoints[k].octave);
    }
    EXPECT_EQ(words.octaves[i], coarsest);
  }
}

TEST(MapView, FollowsTheMapByDeltas) {
  const Scene& scene = Scene::Get();
  const auto before = MapView::Create(scene.map, scene.vocabulary);
  ASSERT_TRUE(before.ok()) << before.status();
  const PlaceIndex& places = *(*before)->places();
  const place::BowVector words = places.Transform(scene.map->keyframe(KeyframeId(3)).features.Get()->features).bow;
  const auto found_before = places.Query(words, {});

  map::Edit edit(scene.map);
  ASSERT_TRUE(edit.EraseKeyframe(KeyframeId(2)));
  map::Keyframe twin = scene.map->keyframe(KeyframeId(3));
  const KeyframeId added = edit.AddKeyframe(twin);
  const map::Delta delta = edit.Finish("test");
  const auto after = (*before)->After(delta);
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_EQ((*after)->revision(), scene.map->revision() + 1);
  EXPECT_EQ((*after)->places()->size(), places.size());
  EXPECT_TRUE((*after)->places()->NodesOf(scene.map->keyframe(KeyframeId(2))).empty());
  EXPECT_EQ((*after)->places()->NodesOf((*after)->map().keyframe(added)),
            places.Transform((*after)->map().keyframe(added).features.Get()->features).nodes);
  EXPECT_EQ((*after)->After(delta).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(places.Query(words, {}), found_before) << "an older view answers as before";

  const auto anew = MapView::Create((*after)->snapshot(), scene.vocabulary);
  ASSERT_TRUE(anew.ok());
  EXPECT_EQ((*after)->places()->Query(words, {}), (*anew)->places()->Query(words, {}));
  const View view = scene.See(Look({0.4, 0.1, -1.5}, 0.1), 5);
  const auto a = Relocalizer().Relocalize((*after)->map(), *(*after)->places(), kPinhole, view.features);
  const auto b = Relocalizer().Relocalize((*anew)->map(), *(*anew)->places(), kPinhole, view.features);
  ASSERT_TRUE(a.ok() && b.ok() && a->localized);
  EXPECT_EQ(a->place.camera_from_map.translation(), b->place.camera_from_map.translation());
}

// A change that was not to be (its store failed) leaves traces in what the indices share; they count for nobody.
TEST(MapView, OneViewCanHaveTwoSuccessors) {
  const Scene& scene = Scene::Get();
  const auto before = MapView::Create(scene.map, scene.vocabulary);
  ASSERT_TRUE(before.ok());
  const auto with = [&](KeyframeId like) {
    map::Edit edit(scene.map);
    edit.AddKeyframe(scene.map->keyframe(like));
    return (*before)->After(edit.Finish("test"));
  };
  const auto lost = with(KeyframeId(2)), kept = with(KeyframeId(5));
  ASSERT_TRUE(lost.ok() && kept.ok());
  const auto anew = MapView::Create((*kept)->snapshot(), scene.vocabulary);
  ASSERT_TRUE(anew.ok());
  for (const KeyframeId id : {KeyframeId(2), KeyframeId(5)}) {
    const place::BowVector words = (*anew)->places()->Transform(scene.map->keyframe(id).features.Get()->features).bow;
    EXPECT_EQ((*kept)->places()->Query(words, {}), (*anew)->places()->Query(words, {}));
  }
}

TEST(Relocalizer, LooksOnlyWhereItIsTold) {
  const Scene& scene = Scene::Get();
  const View view = scene.See(Look({0.4, 0.1, -1.5}, 0.1), 5);
  const ComponentId here = scene.map->LiveComponents().front();
  const auto located = [&](SearchArea area) {
    return Relocalizer().Relocalize(*scene.map, *scene.places, kPinhole, view.features, area)->localized;
  };
  EXPECT_TRUE(located(SearchArea::Only(here)));
  EXPECT_FALSE(located(SearchArea::Except(here)));
}

TEST(Relocalizer, APriorFarFromTheTruthIsSaid) {
  const Scene& scene = Scene::Get();
  const SE3 truth = Look({0.4, 0.1, -1.5}, 0.1);
  const View view = scene.See(truth, 5);
  SearchArea area;
  const auto locate = [&](const SE3& prior, double sigma) {
    area.priors = {{scene.map->LiveComponents().front(), prior.Inverse(), sigma, 0.1}};
    return Relocalizer().Relocalize(*scene.map, *scene.places, kPinhole, view.features, area);
  };
  EXPECT_TRUE(locate(Look({0.5, 0.1, -1.4}, 0.15), 0.1)->localized);
  const auto off = locate(Look({1.4, 0.1, -1.5}, 0.1), 0.05);
  EXPECT_FALSE(off->localized);
  EXPECT_EQ(off->stage, RelocalizationStage::kRefinement);
  EXPECT_THAT(off->reason, testing::HasSubstr("20 standard deviations from the prior"));
  // From the other room nothing of this one is looked at.
  const auto far = locate(Look({20.4, 0.1, -1.5}, 0.1), 0.05);
  EXPECT_FALSE(far->localized);
  EXPECT_NE(far->place.reference_keyframe, off->place.reference_keyframe);
  EXPECT_EQ(locate(truth, 0.0).status().code(), absl::StatusCode::kInvalidArgument);
}

// Two rooms that differ in nothing, far apart in one map.
TEST(Relocalizer, TwinsAreAmbiguous) {
  Random random(21);
  World world;
  AddRoom(Vector3d::Zero(), 2000, random, &world);
  const World one = world;
  for (WorldPoint point : one.points) {
    point.position.x() += 20.0;
    world.points.push_back(point);
  }
  const auto vocabulary = TrainVocabulary(one);
  std::vector<SE3> poses = PathInRoom(Vector3d::Zero(), 12);
  for (const SE3& pose : PathInRoom(Vector3d(20, 0, 0), 12)) poses.push_back(pose);
  const auto map = BuildMap(world, poses, *vocabulary, {}, random);
  const auto places = PlaceIndex::Build(vocabulary, *map);
  ASSERT_TRUE(places.ok());
  for (int i = 0; i < 6; ++i) {
    const double x = i % 2 == 0 ? 0.0 : 20.0;
    const SE3 truth = Look({x - 1.0 + 0.3 * i, 0.1, -1.6}, 0.1);
    const View view = Observe(world, truth, map->info().orb, {}, random);
    const auto answer = Relocalizer().Relocalize(*map, *places, kPinhole, view.features);
    ASSERT_TRUE(answer.ok());
    EXPECT_FALSE(answer->localized);
    EXPECT_FALSE(answer->beyond_doubt);
    EXPECT_EQ(answer->stage, RelocalizationStage::kRivals) << answer->reason;
    ASSERT_EQ(answer->rivals.size(), 2u);
    const double a = CenterError(answer->rivals[0].camera_from_map, truth);
    const double b = CenterError(answer->rivals[1].camera_from_map, truth);
    EXPECT_LT(std::min(a, b), 0.02);
    EXPECT_NEAR(std::max(a, b), 20.0, 0.05);

    SearchArea area;
    area.priors = {{map->LiveComponents().front(), truth.Inverse(), 1.0, 1.0}};
    const auto told = Relocalizer().Relocalize(*map, *places, kPinhole, view.features, area);
    ASSERT_TRUE(told->localized) << told->reason;
    EXPECT_LT(CenterError(told->place.camera_from_map, truth), 0.02);
    // Who proves it in other ways gets the best.
    EXPECT_TRUE(
        Relocalizer(RelocalizerOptions::WithoutRivals()).Relocalize(*map, *places, kPinhole, view.features)->localized);
  }
}

TEST(PlacePrior, CountsStandardDeviations) {
  PlacePrior prior;
  prior.component = ComponentId(1);
  prior.map_from_camera = Look({1, 2, 3}, 0.2).Inverse();
  prior.translation_sigma = 0.5;
  prior.rotation_sigma_rad = 0.1;
  ASSERT_TRUE(prior.Validate().ok());
  EXPECT_NEAR(prior.SigmasFrom(Look({1, 2, 4}, 0.2).Inverse()), 2.0, 1e-9);
  EXPECT_NEAR(prior.SigmasFrom(Look({1, 2, 3.1}, 0.5).Inverse()), 3.0, 1e-9);
  SearchArea area;
  EXPECT_EQ(area.SigmasFrom(ComponentId(1), SE3()), 0.0);
  area.priors = {prior};
  EXPECT_NEAR(area.SigmasFrom(ComponentId(1), Look({1, 2, 4}, 0.2).Inverse()), 2.0, 1e-9);
  EXPECT_TRUE(std::isinf(area.SigmasFrom(ComponentId(2), Look({1, 2, 4}, 0.2).Inverse())));
  prior.component = ComponentId();
  EXPECT_FALSE(prior.Validate().ok());
}

// The covariance of a left increment, from errors of the camera in its own axes: against drawn errors.
TEST(MapError, TurnsWithTheCamera) {
  const SE3 pose(Quaterniond(Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized())), Vector3d(3, -1, 2));
  Random random(5);
  Matrix6d drawn = Matrix6d::Zero();
  constexpr int kDraws = 20000;
  for (int i = 0; i < kDraws; ++i) {
    Vector6d error;
    for (int k = 0; k < 6; ++k) error[k] = (k < 3 ? 0.02 : 0.01) * random.Normal();
    const Vector6d increment = (pose * SE3::Exp(error) * pose.Inverse()).Log();
    drawn += increment * increment.transpose() / kDraws;
  }
  const Matrix6d covariance = CovarianceAtCamera(pose, 0.02, 0.01);
  EXPECT_LT((drawn - covariance).norm(), 0.03 * covariance.norm());
}

TEST(MapError, GrowsWithDepthAndMisfit) {
  const MapError usual = MapErrorOf({300, 1.0, 2.0});
  EXPECT_NEAR(usual.translation, 0.0192, 1e-9);
  EXPECT_NEAR(MapErrorOf({300, 1.0, 4.0}).translation, 2.0 * usual.translation, 1e-9);
  EXPECT_NEAR(MapErrorOf({300, 0.5, 2.0}).rotation_rad, usual.rotation_rad / 8.0, 1e-9);
  EXPECT_NEAR(MapErrorOf({75, 1.0, 2.0}).translation, std::sqrt(2.0) * usual.translation, 1e-9);
}

TEST(PlaceIndex, RejectsAnotherVocabulary) {
  const Scene& scene = Scene::Get();
  World other;
  Random random(99);
  AddRoom(Vector3d::Zero(), 300, random, &other);
  EXPECT_EQ(PlaceIndex::Build(TrainVocabulary(other), *scene.map).status().code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(PlaceIndex::Build(nullptr, *scene.map).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(PlaceIndex::Build(scene.vocabulary, *scene.map, 50).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(GroupMatcher, MatchesAreRightAndUnique) {
  const Scene& scene = Scene::Get();
  const View view = scene.See(Look({0.4, 0.1, -1.5}, 0.1), 5);
  const auto words = scene.places->Transform(view.features);
  const std::vector<KeyframeId> group = {KeyframeId(6), KeyframeId(7), KeyframeId(8), KeyframeId(12345)};
  const auto matches = MatchGroup(*scene.map, *scene.places, group, view.features, words.nodes);
  ASSERT_GT(matches.size(), 40u);
  std::set<std::uint32_t> features;
  std::set<PointId> points;
  int right = 0;
  for (const GroupMatch& match : matches) {
    EXPECT_TRUE(features.insert(match.feature).second);
    EXPECT_TRUE(points.insert(match.point).second);
    const std::int32_t i = view.point_of_feature[match.feature];
    right +=
        i >= 0 && scene.world.points[static_cast<std::size_t>(i)].position == scene.map->point(match.point).position;
  }
  EXPECT_GT(right, static_cast<int>(matches.size()) * 95 / 100);
  EXPECT_TRUE(std::is_sorted(matches.begin(), matches.end(), [](auto& a, auto& b) { return a.ratio < b.ratio; }));
  GroupMatchOptions bad;
  bad.max_ratio = 2;
  EXPECT_FALSE(bad.Validate().ok());
}

}  // namespace
}  // namespace cairn::tracking
