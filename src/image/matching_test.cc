#include "image/matching.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/random.h"
#include "image/hamming.h"
#include "image/testing_descriptors.h"

namespace cairn::image {
namespace {

using ::testing::ElementsAre;
using testing::FlipBits;
using ::testing::IsEmpty;
using testing::RandomDescriptor;

// b holds the descriptors of a in reverse order, each with a few bits flipped and turned by `turn_rad`.
void MakePair(int count, int flips, float turn_rad, Features* a, Features* b) {
  Random random(11);
  for (int i = 0; i < count; ++i) {
    a->descriptors.push_back(RandomDescriptor(random));
    a->keypoints.push_back({static_cast<float>(random.Uniform(0, 640)), static_cast<float>(random.Uniform(0, 480)),
                            static_cast<float>(random.Uniform(-3, 3)), static_cast<std::uint8_t>(random.Below(8))});
  }
  for (int i = count - 1; i >= 0; --i) {
    b->descriptors.push_back(FlipBits(a->descriptors[i], flips, random));
    b->keypoints.push_back(a->keypoints[i]);
    b->keypoints.back().angle_rad -= turn_rad;
  }
}

TEST(Hamming, AllKernelsCountTheSame) {
  Random random(1);
  std::vector<Descriptor> descriptors(257);
  for (Descriptor& descriptor : descriptors) descriptor = RandomDescriptor(random);
  descriptors[3] = {};
  descriptors[4] = {~0ull, ~0ull, ~0ull, ~0ull};
  for (const Descriptor& query : {descriptors[0], descriptors[3], descriptors[4]}) {
    std::vector<std::uint16_t> fast(descriptors.size()), portable(descriptors.size());
    HammingDistances(query, descriptors.data(), descriptors.size(), fast.data());
    internal::HammingDistancesPortable(query.data(), descriptors[0].data(), descriptors.size(), portable.data());
    std::vector<std::uint32_t> backwards;
    for (std::uint32_t i = 0; i < descriptors.size(); ++i) {
      backwards.push_back(static_cast<std::uint32_t>(descriptors.size()) - 1 - i);
    }
    std::vector<std::uint16_t> at(descriptors.size()), portable_at(descriptors.size());
    HammingDistancesAt(query, descriptors.data(), backwards.data(), backwards.size(), at.data());
    internal::HammingDistancesAtPortable(query.data(), descriptors[0].data(), backwards.data(), backwards.size(),
                                         portable_at.data());
    for (std::size_t i = 0; i < descriptors.size(); ++i) {
      EXPECT_EQ(at[i], fast[backwards[i]]);
      EXPECT_EQ(portable_at[i], fast[backwards[i]]);
      int expected = 0;
      for (int w = 0; w < 4; ++w) expected += std::popcount(query[w] ^ descriptors[i][w]);
      EXPECT_EQ(HammingDistance(query, descriptors[i]), expected);
      EXPECT_EQ(fast[i], expected);
      EXPECT_EQ(portable[i], expected);
    }
  }
  EXPECT_EQ(HammingDistance(descriptors[3], descriptors[4]), 256);
}

TEST(BestTwo, KeepsTheFirstOfEqualsAndTestsTheRatio) {
  BestTwo best;
  EXPECT_FALSE(best.Accept(256, 1.0));
  best.Add(7, 40);
  EXPECT_TRUE(best.Accept(50, 0.5));  // alone, it stands out
  best.Add(8, 40);
  EXPECT_EQ(best.index, 7u);
  EXPECT_EQ(best.second_distance, 40);
  EXPECT_FALSE(best.Accept(50, 0.9));
  EXPECT_TRUE(best.Accept(50, 1.0));
  EXPECT_FALSE(best.Accept(39, 1.0));
  best.Add(9, 20);
  EXPECT_EQ(best.index, 9u);
  EXPECT_TRUE(best.Accept(50, 0.5));
  EXPECT_FALSE(best.Accept(50, 0.49));
}

TEST(MatchBruteForce, FindsEveryPair) {
  Features a, b;
  MakePair(300, 30, 0.5f, &a, &b);
  const std::vector<FeatureMatch> matches = MatchBruteForce(a, b);
  ASSERT_EQ(matches.size(), 300u);
  for (const FeatureMatch& match : matches) {
    EXPECT_EQ(match.b, 299 - match.a);
    EXPECT_EQ(match.distance, 30);
  }
  EXPECT_TRUE(std::is_sorted(matches.begin(), matches.end(), [](auto& p, auto& q) { return p.a < q.a; }));
  MatchOptions strict;
  strict.max_distance = 29;
  EXPECT_THAT(MatchBruteForce(a, b, strict), IsEmpty());
  EXPECT_THAT(MatchBruteForce(a, Features{}), IsEmpty());
  EXPECT_THAT(MatchBruteForce(Features{}, b), IsEmpty());
}

TEST(MatchBruteForce, MutualKeepsOnlyTheNearest) {
  Random random(2);
  Features a, b;
  const Descriptor base = RandomDescriptor(random);
  a.descriptors = {FlipBits(base, 20, random), FlipBits(base, 5, random)};
  a.keypoints.resize(2);
  b.descriptors = {base};
  b.keypoints.resize(1);
  EXPECT_THAT(MatchBruteForce(a, b), ElementsAre(FeatureMatch{1, 0, 5}));
  MatchOptions options;
  options.mutual = false;
  EXPECT_THAT(MatchBruteForce(a, b, options), ElementsAre(FeatureMatch{0, 0, 20}, FeatureMatch{1, 0, 5}));
}

TEST(KeepConsistentRotations, DropsWhatIsTurnedOtherwise) {
  Features a, b;
  MakePair(200, 0, 1.0f, &a, &b);
  Random random(3);
  // Each third pair is turned at random.
  for (std::size_t i = 0; i < 200; i += 3) b.keypoints[i].angle_rad = static_cast<float>(random.Uniform(-3.1, 3.1));
  MatchOptions options;
  options.check_rotation = false;
  ASSERT_EQ(MatchBruteForce(a, b, options).size(), 200u);
  const std::vector<FeatureMatch> matches = MatchBruteForce(a, b);
  const auto wrong = std::count_if(matches.begin(), matches.end(), [](const auto& m) { return m.b % 3 == 0; });
  EXPECT_EQ(static_cast<int>(matches.size()) - wrong, 133);
  EXPECT_LT(wrong, 30);
}

TEST(KeepConsistentRotations, HoldsAcrossTheSeamOfPi) {
  std::vector<Keypoint> a(40), b(40);
  std::vector<FeatureMatch> matches;
  for (std::uint32_t i = 0; i < 40; ++i) {
    a[i].angle_rad = i % 2 ? 3.13f : -3.13f;
    matches.push_back({i, i, 0});
  }
  EXPECT_EQ(KeepConsistentRotations(a, b, matches).size(), 40u);
}

// 800 over an image of 640x480 and a margin around it.
std::vector<Keypoint> ScatteredKeypoints(double margin_px, Random* random) {
  std::vector<Keypoint> keypoints;
  for (int i = 0; i < 800; ++i) {
    const double x = random->Uniform(-margin_px, 640 + margin_px), y = random->Uniform(-margin_px, 480 + margin_px);
    keypoints.push_back(
        {static_cast<float>(x), static_cast<float>(y), 0.0f, static_cast<std::uint8_t>(random->Below(8))});
  }
  return keypoints;
}

TEST(FeatureGrid, AnswersLikeAScan) {
  Random random(4);
  const std::vector<Keypoint> keypoints = ScatteredKeypoints(10, &random);
  const FeatureGrid grid(keypoints, 640, 480);
  EXPECT_EQ(grid.size(), 800u);
  for (int i = 0; i < 200; ++i) {
    const double x = random.Uniform(-30, 670), y = random.Uniform(-30, 510), radius = random.Uniform(0, 60);
    const int low = static_cast<int>(random.Below(8)), high = low + static_cast<int>(random.Below(4));
    std::vector<std::uint32_t> expected;
    for (std::uint32_t k = 0; k < keypoints.size(); ++k) {
      const double dx = keypoints[k].x_px - x, dy = keypoints[k].y_px - y;
      if (dx * dx + dy * dy <= radius * radius && keypoints[k].octave >= low && keypoints[k].octave <= high) {
        expected.push_back(k);
      }
    }
    std::vector<std::uint32_t> found = grid.Query(x, y, radius, low, high);
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
  }
  EXPECT_THAT(grid.Query(std::nan(""), 0, 10), IsEmpty());
  EXPECT_THAT(grid.Query(0, 0, -1), IsEmpty());
  EXPECT_THAT(FeatureGrid().Query(0, 0, 10), IsEmpty());
}

TEST(FeatureGrid, FindsWhatIsNearASegment) {
  Random random(5);
  const std::vector<Keypoint> keypoints = ScatteredKeypoints(40, &random);
  const FeatureGrid grid(keypoints, 640, 480);
  std::size_t total = 0;
  for (int i = 0; i < 300; ++i) {
    const double x0 = random.Uniform(-60, 700), y0 = random.Uniform(-60, 540), width = random.Uniform(0, 40);
    // Some level, some upright, some of no length.
    const double x1 = i % 5 == 0 ? x0 : random.Uniform(-60, 700), y1 = i % 7 == 0 ? y0 : random.Uniform(-60, 540);
    const int low = static_cast<int>(random.Below(8)), high = low + static_cast<int>(random.Below(4));
    std::vector<std::uint32_t> expected;
    for (std::uint32_t k = 0; k < keypoints.size(); ++k) {
      const double dx = x1 - x0, dy = y1 - y0, px = keypoints[k].x_px - x0, py = keypoints[k].y_px - y0;
      const double squared = dx * dx + dy * dy;
      const double along = squared > 0.0 ? std::clamp((px * dx + py * dy) / squared, 0.0, 1.0) : 0.0;
      if (std::hypot(px - along * dx, py - along * dy) <= width && keypoints[k].octave >= low &&
          keypoints[k].octave <= high) {
        expected.push_back(k);
      }
    }
    std::vector<std::uint32_t> found;
    grid.QuerySegment(x0, y0, x1, y1, width, low, high, &found);
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
    total += found.size();
  }
  EXPECT_GT(total, 1000u);
  std::vector<std::uint32_t> found = {1};
  grid.QuerySegment(0, 0, std::nan(""), 0, 10, 0, 8, &found);
  EXPECT_THAT(found, IsEmpty());
}

TEST(MatchInWindows, LooksOnlyInside) {
  Features a, b;
  MakePair(200, 10, 0.0f, &a, &b);
  const FeatureGrid grid(b.keypoints, 640, 480);
  std::vector<FeatureWindow> windows;
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    const Keypoint& k = a.keypoints[i];
    // Even features are predicted well, odd ones far off; every fourth looks in the wrong octave.
    const double offset = i % 2 ? 100.0 : 3.0;
    windows.push_back({i, k.x_px + offset, k.y_px, 5.0, i % 4 == 0 ? k.octave + 1 : 0, 255});
  }
  const std::vector<FeatureMatch> matches = MatchInWindows(a, windows, b, grid);
  EXPECT_EQ(matches.size(), 50u);
  for (const FeatureMatch& match : matches) {
    EXPECT_EQ(match.a % 4, 2u);
    EXPECT_EQ(match.b, 199 - match.a);
  }
}

TEST(MatchInWindows, OneFeatureOfBServesOne) {
  Random random(5);
  const Descriptor base = RandomDescriptor(random);
  Features a, b;
  a.descriptors = {FlipBits(base, 9, random), FlipBits(base, 4, random)};
  a.keypoints.resize(2);
  b.descriptors = {base};
  b.keypoints.resize(1);
  const std::vector<FeatureWindow> windows = {{0, 0, 0, 5, 0, 255}, {1, 0, 0, 5, 0, 255}};
  EXPECT_THAT(MatchInWindows(a, windows, b, FeatureGrid(b.keypoints, 10, 10)), ElementsAre(FeatureMatch{1, 0, 4}));
}

TEST(MatchOptions, ValidatesItself) {
  EXPECT_TRUE(MatchOptions{}.Validate().ok());
  MatchOptions options;
  options.max_distance = 257;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.max_ratio = 0.0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace cairn::image
