#include "place/training.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "image/testing_descriptors.h"

namespace cairn::place {
namespace {

using image::testing::FlipBits;
using image::testing::RandomDescriptor;

// `clusters` random centres, `per_image` noisy members of each in every image.
std::vector<ImageDescriptors> ClusteredImages(int images, int clusters, int per_image, int flips,
                                              std::vector<image::Descriptor>* centers) {
  Random random(17);
  for (int c = 0; c < clusters; ++c) centers->push_back(RandomDescriptor(random));
  std::vector<ImageDescriptors> result(images);
  for (ImageDescriptors& image : result) {
    for (const image::Descriptor& center : *centers) {
      for (int i = 0; i < per_image; ++i) image.push_back(FlipBits(center, flips, random));
    }
  }
  return result;
}

TEST(Training, RecoversClustersExactly) {
  std::vector<image::Descriptor> centers;
  const std::vector<ImageDescriptors> images = ClusteredImages(10, 8, 20, 20, &centers);
  TrainingOptions options;
  options.branching = 8;
  options.depth = 1;
  const auto vocabulary = Train(images, options);
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  ASSERT_EQ(vocabulary->num_words(), 8u);
  // 200 members with 8 % of noise each: the majority of every bit is the centre's. Each centre has its own word, and
  // all its members have it too.
  std::set<WordId> words;
  Random random(5);
  for (const image::Descriptor& center : centers) {
    const WordId word = vocabulary->Lookup(center);
    words.insert(word);
    for (int i = 0; i < 20; ++i) EXPECT_EQ(vocabulary->Lookup(FlipBits(center, 25, random)), word);
  }
  EXPECT_EQ(words.size(), 8u);
  // The medians are the centres themselves: read back from the serialised descriptors (header 28, child counts 9).
  const std::string bytes = vocabulary->Serialize();
  for (const image::Descriptor& center : centers) {
    std::string expected;
    for (const std::uint64_t word : center) {
      for (int i = 0; i < 8; ++i) expected.push_back(static_cast<char>((word >> (8 * i)) & 0xFF));
    }
    EXPECT_NE(bytes.find(expected, 28 + 9), std::string::npos);
  }
}

TEST(Training, WeightsAreIdf) {
  Random random(2);
  const image::Descriptor everywhere = RandomDescriptor(random), often = RandomDescriptor(random),
                          once = RandomDescriptor(random);
  std::vector<ImageDescriptors> images(10, {everywhere, everywhere});
  for (int i = 0; i < 5; ++i) images[i].push_back(often);
  images[7].push_back(once);
  TrainingOptions options;
  options.branching = 3;
  options.depth = 2;
  const auto vocabulary = Train(images, options);
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  ASSERT_EQ(vocabulary->num_words(), 3u);
  EXPECT_FLOAT_EQ(vocabulary->weight(vocabulary->Lookup(everywhere)), 0.0f);
  EXPECT_FLOAT_EQ(vocabulary->weight(vocabulary->Lookup(often)), std::log(2.0f));
  EXPECT_FLOAT_EQ(vocabulary->weight(vocabulary->Lookup(once)), std::log(10.0f));
}

TEST(Training, DeepTreeSeparatesManyClusters) {
  std::vector<image::Descriptor> centers;
  const std::vector<ImageDescriptors> images = ClusteredImages(6, 300, 3, 12, &centers);
  TrainingOptions options;
  options.branching = 5;
  options.depth = 5;
  double last = 0.0;
  const auto vocabulary = Train(images, options, [&](double done) {
    EXPECT_GE(done, last);
    EXPECT_LE(done, 1.0);
    last = done;
  });
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_GT(last, 0.999);
  EXPECT_GE(vocabulary->num_words(), 300u);
  std::set<WordId> words;
  for (const image::Descriptor& center : centers) words.insert(vocabulary->Lookup(center));
  EXPECT_GE(words.size(), 290u);
}

TEST(Training, SameInputSameBytes) {
  std::vector<image::Descriptor> centers;
  const std::vector<ImageDescriptors> images = ClusteredImages(4, 40, 3, 30, &centers);
  TrainingOptions options;
  options.branching = 4;
  options.depth = 3;
  const std::string first = Train(images, options)->Serialize();
  EXPECT_EQ(Train(images, options)->Serialize(), first);
  options.seed = 2;
  EXPECT_NE(Train(images, options)->Serialize(), first);
}

TEST(Training, RejectsWhatItCannotTrainOn) {
  Random random(3);
  const image::Descriptor one = RandomDescriptor(random), two = RandomDescriptor(random);
  const auto code = [](std::vector<ImageDescriptors> images, TrainingOptions options = {}) {
    return Train(images, options).status().code();
  };
  EXPECT_EQ(code({}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code({{one, two}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code({{}, {}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code({{one}, {one, one}}), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(code({{one}, {two}}), absl::StatusCode::kOk);
  TrainingOptions options;
  options.branching = 1;
  EXPECT_EQ(code({{one}, {two}}, options), absl::StatusCode::kInvalidArgument);
  options = {};
  options.depth = 0;
  EXPECT_EQ(code({{one}, {two}}, options), absl::StatusCode::kInvalidArgument);
  options = {};
  options.max_iterations = 0;
  EXPECT_EQ(code({{one}, {two}}, options), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::place
