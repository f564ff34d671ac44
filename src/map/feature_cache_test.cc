#include "map/feature_cache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <thread>

namespace cairn::map {
namespace {

using ::testing::HasSubstr;

constexpr std::size_t kFeatures = 100;
constexpr std::size_t kBytes = kFeatures * (sizeof(image::Keypoint) + sizeof(image::Descriptor) + 4);

// Features that tell whose they are; some keyframes have left, some are damaged.
class FakeReader : public FeatureReader {
 public:
  absl::StatusOr<std::shared_ptr<const KeyframeFeatures>> Read(KeyframeId keyframe) override {
    EXPECT_FALSE(busy_.exchange(true)) << "two calls at once";
    ++*num_reads;
    auto features = std::make_shared<KeyframeFeatures>();
    features->features.keypoints.resize(kFeatures);
    features->features.descriptors.assign(kFeatures, image::Descriptor{keyframe.value()});
    features->words.assign(kFeatures, keyframe.value());
    busy_ = false;
    if (gone.contains(keyframe)) return nullptr;
    if (damaged.contains(keyframe)) return absl::DataLossError("row 7: wrong checksum");
    return features;
  }

  std::set<KeyframeId> gone, damaged;
  std::shared_ptr<std::atomic<int>> num_reads = std::make_shared<std::atomic<int>>(0);

 private:
  std::atomic<bool> busy_ = false;
};

struct Fixture {
  explicit Fixture(std::size_t budget, int keyframes = 10) {
    auto owned = std::make_unique<FakeReader>();
    reader = owned.get();
    num_reads = owned->num_reads;
    cache = FeatureCache::Create(std::move(owned), budget);
    for (int i = 1; i <= keyframes; ++i) {
      handles.push_back(cache->OnDemand(KeyframeId(static_cast<std::uint32_t>(i)), kFeatures));
    }
  }
  FakeReader* reader;
  std::shared_ptr<std::atomic<int>> num_reads;
  std::shared_ptr<FeatureCache> cache;
  std::vector<FeatureHandle> handles;  // of keyframe i + 1
};

TEST(FeatureCache, ReadsWhenLookedAtAndKeepsTheLastOnes) {
  Fixture map(3 * kBytes + 3 * sizeof(KeyframeFeatures));
  EXPECT_EQ(map.handles[0].size(), kFeatures);
  EXPECT_FALSE(map.handles[0].in_memory());
  EXPECT_EQ(*map.num_reads, 0);
  for (const int i : {0, 1, 2, 0, 1, 2}) {
    EXPECT_EQ(map.handles[i].Get()->words[0], static_cast<std::uint32_t>(i + 1));
  }
  EXPECT_EQ(*map.num_reads, 3);
  map.handles[3].Get();  // instead of 0, at which nobody has looked for longest
  map.handles[1].Get();
  map.handles[2].Get();
  EXPECT_EQ(*map.num_reads, 4);
  map.handles[0].Get();
  EXPECT_EQ(*map.num_reads, 5);
  EXPECT_LE(map.cache->bytes(), 3 * kBytes + 3 * sizeof(KeyframeFeatures));
  EXPECT_TRUE(map.cache->status().ok());
}

TEST(FeatureCache, WhatIsHeldStays) {
  Fixture map(kBytes);
  const auto held = map.handles[0].Get();
  FeatureLook look;
  const KeyframeFeatures& looked_at = look.Of(map.handles[1]);
  for (const FeatureHandle& handle : map.handles) handle.Get();
  EXPECT_EQ(held->words[0], 1u);
  EXPECT_EQ(looked_at.words[0], 2u);
  EXPECT_EQ(&look.Of(map.handles[1]), &looked_at);
  EXPECT_EQ(*map.num_reads, 12) << "1 and 2, then 1 to 10 as each gave way to the next; nothing for the look";
  // The plain operators have nobody who holds: these stay for good.
  const KeyframeFeatures& pinned = *map.handles[4];
  for (const FeatureHandle& handle : map.handles) handle.Get();
  EXPECT_EQ(pinned.words[0], 5u);
  EXPECT_EQ(map.cache->pinned(), 1u);
}

TEST(FeatureCache, AKeyframeThatIsGoneTakesItsFeaturesAlong) {
  Fixture map(100 * kBytes);
  for (const FeatureHandle& handle : map.handles) handle.Get();
  const std::size_t bytes = map.cache->bytes();
  *map.handles[3];
  map.handles.pop_back();
  map.handles.erase(map.handles.begin() + 3);
  EXPECT_EQ(map.cache->bytes(), bytes / 10 * 8);
  EXPECT_EQ(map.cache->pinned(), 0u);
}

TEST(FeatureCache, SaysOnceAndForAllThatALookFailed) {
  Fixture map(100 * kBytes);
  map.reader->gone.insert(KeyframeId(2));
  map.reader->damaged = {KeyframeId(4), KeyframeId(5)};
  EXPECT_EQ(map.handles[1].Get()->features.size(), kFeatures);
  EXPECT_EQ(map.handles[1].Get()->features.descriptors[0], image::Descriptor{});
  EXPECT_TRUE(map.cache->status().ok()) << "a keyframe that has left the map";
  EXPECT_EQ(map.handles[3].Get()->features.size(), kFeatures);
  map.handles[0].Get();
  EXPECT_THAT(map.cache->status().message(), HasSubstr("wrong checksum"));
}

TEST(FeatureCache, OtherFeaturesThanExpectedAreAnError) {
  Fixture map(100 * kBytes);
  const FeatureHandle more = map.cache->OnDemand(KeyframeId(1), kFeatures + 1);
  EXPECT_EQ(more.Get()->features.size(), kFeatures + 1);
  EXPECT_THAT(map.cache->status().message(), HasSubstr("keyframe 1 has 100 features instead of 101"));
}

TEST(FeatureCache, ManyThreadsLook) {
  Fixture map(3 * kBytes, 20);
  std::vector<std::thread> threads;
  std::atomic<int> wrong = 0;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 2000; ++i) {
        const int at = (i * (t + 3)) % 20;
        const auto features = map.handles[static_cast<std::size_t>(at)].Get();
        wrong += features->words[kFeatures - 1] == static_cast<std::uint32_t>(at + 1) ? 0 : 1;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST(FeatureHandle, InMemoryAsEver) {
  auto features = std::make_shared<KeyframeFeatures>();
  features->features.keypoints.resize(3);
  features->features.descriptors.resize(3);
  const FeatureHandle handle(features);
  EXPECT_TRUE(handle.in_memory());
  EXPECT_EQ(handle.size(), 3u);
  EXPECT_EQ(&*handle, features.get());
  EXPECT_EQ(handle.Get(), features);
  EXPECT_EQ(handle, FeatureHandle(features));
  EXPECT_FALSE(FeatureHandle());
}

}  // namespace
}  // namespace cairn::map
