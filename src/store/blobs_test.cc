#include "store/blobs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "store/row.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

absl::StatusOr<map::KeyframeFeatures> Unpack(const PackedFeatures& packed) {
  return UnpackFeatures(packed.count, static_cast<int>(packed.layout), packed.word_bytes, AsBytes(packed.keypoints),
                        AsBytes(packed.descriptors), AsBytes(packed.words));
}

TEST(Blobs, FeaturesRoundTrip) {
  for (const bool fixed_point : {true, false}) {
    testing::MapGrower grower(1, {.features = 777, .fixed_point_keypoints = fixed_point});
    const auto features = grower.RandomFeatures();
    const PackedFeatures packed = PackFeatures(*features);
    EXPECT_EQ(packed.layout, fixed_point ? KeypointLayout::kFixedPoint : KeypointLayout::kFloat32);
    EXPECT_EQ(packed.word_bytes, 3);
    const auto unpacked = Unpack(packed);
    ASSERT_TRUE(unpacked.ok()) << unpacked.status();
    EXPECT_EQ(*unpacked, *features);
  }
}

TEST(Blobs, NoFeaturesAndNoWords) {
  map::KeyframeFeatures features;
  auto unpacked = Unpack(PackFeatures(features));
  ASSERT_TRUE(unpacked.ok()) << unpacked.status();
  EXPECT_EQ(*unpacked, features);
  features.features.keypoints.resize(3);
  features.features.descriptors.resize(3);
  unpacked = Unpack(PackFeatures(features));
  ASSERT_TRUE(unpacked.ok()) << unpacked.status();
  EXPECT_EQ(*unpacked, features);
}

TEST(Blobs, FixedPointOnlyWhereExact) {
  for (const float px : {-0.0f, -1.0f, 0.01f, 2048.0f, std::numeric_limits<float>::infinity(),
                         std::numeric_limits<float>::quiet_NaN()}) {
    map::KeyframeFeatures features;
    features.features.keypoints.resize(2);
    features.features.descriptors.resize(2);
    features.features.keypoints[1].x_px = px;
    const PackedFeatures packed = PackFeatures(features);
    EXPECT_EQ(packed.layout, KeypointLayout::kFloat32) << px;
    const auto unpacked = Unpack(packed);
    ASSERT_TRUE(unpacked.ok());
    EXPECT_EQ(std::memcmp(&unpacked->features.keypoints[1].x_px, &px, sizeof(px)), 0);
  }
}

TEST(Blobs, WordsTakeTheBytesTheyNeed) {
  for (const auto& [largest, bytes] : std::vector<std::pair<std::uint32_t, int>>{
           {0, 1}, {255, 1}, {256, 2}, {65536, 3}, {0xffffff, 3}, {0x1000000, 4}, {0xffffffff, 4}}) {
    map::KeyframeFeatures features;
    features.words = {0, largest, largest, 0, 1, largest, 0, 0, largest};
    features.features.keypoints.resize(features.words.size());
    features.features.descriptors.resize(features.words.size());
    const PackedFeatures packed = PackFeatures(features);
    EXPECT_EQ(packed.word_bytes, bytes);
    EXPECT_EQ(*Unpack(packed), features);
  }
}

TEST(Blobs, WrongLengthsAreErrors) {
  testing::MapGrower grower(2);
  const PackedFeatures good = PackFeatures(*grower.RandomFeatures());
  PackedFeatures bad = good;
  bad.count += 1;
  EXPECT_FALSE(Unpack(bad).ok());
  bad = good;
  bad.keypoints.pop_back();
  EXPECT_FALSE(Unpack(bad).ok());
  bad = good;
  bad.descriptors += "x";
  EXPECT_FALSE(Unpack(bad).ok());
  bad = good;
  bad.word_bytes = 2;
  EXPECT_FALSE(Unpack(bad).ok());
  bad = good;
  bad.layout = static_cast<KeypointLayout>(7);
  EXPECT_FALSE(Unpack(bad).ok());
  EXPECT_FALSE(UnpackFeatures(-1, 0, 0, {}, {}, {}).ok());
}

TEST(Blobs, PointIdsRoundTrip) {
  Random random(3);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<PointId> ids(random.Below(80));
    const double observing = trial % 2 == 0 ? 1.0 : 0.15;  // all of them, or few as it mostly is
    for (PointId& id : ids) {
      if (random.Uniform() > observing) continue;
      const double kind = random.Uniform();
      if (kind < 0.2) id = PointId(0xffffffff);
      if (kind > 0.4) id = PointId(static_cast<std::uint32_t>(random.Next() >> (32 + random.Below(32))));
    }
    const std::string packed = PackPointIds(ids);
    const auto unpacked = UnpackPointIds(ids.size(), AsBytes(packed));
    ASSERT_TRUE(unpacked.ok()) << unpacked.status();
    EXPECT_EQ(*unpacked, ids);
    EXPECT_FALSE(UnpackPointIds(ids.size() + 1, AsBytes(packed)).ok());
    if (!ids.empty()) {
      EXPECT_FALSE(UnpackPointIds(ids.size() - 1, AsBytes(packed)).ok());
      EXPECT_FALSE(UnpackPointIds(ids.size(), AsBytes(packed).first(packed.size() - 1)).ok());
    }
  }
}

TEST(Blobs, PointIdsFromNoise) {
  Random random(4);
  for (int trial = 0; trial < 5000; ++trial) {
    std::string noise(random.Below(30), '\0');
    for (char& c : noise) c = static_cast<char>(random.Next());
    const auto ids = UnpackPointIds(random.Below(12), AsBytes(noise));
    if (ids.ok()) {
      EXPECT_EQ(*UnpackPointIds(ids->size(), AsBytes(PackPointIds(*ids))), *ids);
    }
  }
}

TEST(Row, ChecksumSeesEveryBit) {
  const auto make = [](double real, std::int64_t integer, absl::string_view text) {
    Row row;
    row.Int(integer).Real(real).Text(text).Null();
    return row;
  };
  const std::int64_t checksum = make(0.0, 1, "a").Checksum();
  EXPECT_EQ(checksum, make(0.0, 1, "a").Checksum());
  EXPECT_NE(checksum, make(-0.0, 1, "a").Checksum());
  EXPECT_NE(checksum, make(0.0, 2, "a").Checksum());
  EXPECT_NE(checksum, make(0.0, 1, "b").Checksum());
  EXPECT_FALSE(make(0.0, 1, "a").SameAs(make(-0.0, 1, "a")));
  EXPECT_GE(checksum, std::numeric_limits<std::int32_t>::min());
  EXPECT_LE(checksum, std::numeric_limits<std::int32_t>::max());
}

}  // namespace
}  // namespace cairn::store
