#include "place/vocabulary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "image/testing_descriptors.h"

namespace cairn::place {
namespace {

using image::testing::FlipBits;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr image::Descriptor kZeros = {0, 0, 0, 0};
constexpr image::Descriptor kOnes = {~0ull, ~0ull, ~0ull, ~0ull};
constexpr image::Descriptor kLowHalf = {~0ull, ~0ull, 0, 0};
constexpr image::Descriptor kQuarter = {~0ull, 0, 0, 0};
constexpr image::Descriptor kMostOnes = {~0ull, ~0ull, ~0ull, 0xFFFFFFFFull};

// root -> zeros -> {zeros (idf 1), quarter (idf 2)}
//      -> low half (idf 0.5)
//      -> ones  -> {most ones (idf 0), ones (idf 3)}
// listed depth first; breadth first the words are: low half 0, zeros 1, quarter 2, most ones 3, ones 4.
std::vector<Vocabulary::Node> SmallTree() {
  return {{0, {}, 0.0f},       {0, kZeros, 0.0f}, {1, kZeros, 1.0f},    {1, kQuarter, 2.0f},
          {0, kLowHalf, 0.5f}, {0, kOnes, 0.0f},  {5, kMostOnes, 0.0f}, {5, kOnes, 3.0f}};
}

Vocabulary Small() { return *Vocabulary::FromNodes(SmallTree(), 3, 2); }

TEST(Vocabulary, LooksUpWordsAndNodes) {
  const Vocabulary vocabulary = Small();
  EXPECT_EQ(vocabulary.num_nodes(), 8u);
  EXPECT_EQ(vocabulary.num_words(), 5u);
  NodeId node = 99;
  EXPECT_EQ(vocabulary.Lookup(kLowHalf, 1, &node), 0u);
  EXPECT_EQ(node, 2u);
  EXPECT_EQ(vocabulary.Lookup(kZeros, 1, &node), 1u);
  EXPECT_EQ(node, 1u);
  EXPECT_EQ(vocabulary.Lookup(kQuarter, 1, &node), 2u);  // a tie between zeros and low half goes to the first
  EXPECT_EQ(node, 1u);
  EXPECT_EQ(vocabulary.Lookup(kOnes, 1, &node), 4u);
  EXPECT_EQ(node, 3u);
  EXPECT_EQ(vocabulary.Lookup(kOnes, 0, &node), 4u);
  EXPECT_EQ(node, 0u);
  EXPECT_EQ(vocabulary.Lookup(kOnes, 2, &node), 4u);
  EXPECT_EQ(node, 7u);
  EXPECT_EQ(vocabulary.Lookup(kLowHalf, 2, &node), 0u);  // the leaf is higher up
  EXPECT_EQ(node, 2u);
  Random random(1);
  EXPECT_EQ(vocabulary.Lookup(FlipBits(kOnes, 20, random)), 4u);
}

TEST(Vocabulary, LooksUpManyAsOneByOne) {
  const Vocabulary vocabulary = Small();
  Random random(4);
  std::vector<image::Descriptor> descriptors;
  for (int i = 0; i < 100; ++i) {
    descriptors.push_back(FlipBits(i % 3 == 0 ? kZeros : i % 3 == 1 ? kLowHalf : kOnes, i, random));
  }
  for (const int level : {0, 1, 2, 3}) {
    std::vector<NodeId> nodes;
    const std::vector<WordId> words = vocabulary.LookupAll(descriptors, level, &nodes);
    ASSERT_EQ(words.size(), descriptors.size());
    ASSERT_EQ(nodes.size(), descriptors.size());
    for (std::size_t i = 0; i < descriptors.size(); ++i) {
      NodeId node = 99;
      EXPECT_EQ(words[i], vocabulary.Lookup(descriptors[i], level, &node)) << i;
      EXPECT_EQ(nodes[i], node) << i << " at level " << level;
    }
  }
  EXPECT_THAT(vocabulary.LookupAll({}), IsEmpty());
}

TEST(Vocabulary, TransformsToNormalisedTfIdf) {
  const Vocabulary vocabulary = Small();
  const std::vector<image::Descriptor> descriptors = {kOnes, kZeros, kOnes, kMostOnes, kLowHalf};
  const BagOfWords bag = vocabulary.Transform(descriptors, 1);
  // Weights 0.5, 1 and twice 3; most ones has no weight.
  ASSERT_EQ(bag.words.size(), 3u);
  EXPECT_EQ(bag.words[0].word, 0u);
  EXPECT_FLOAT_EQ(bag.words[0].weight, 0.5f / 7.5f);
  EXPECT_EQ(bag.words[1].word, 1u);
  EXPECT_FLOAT_EQ(bag.words[1].weight, 1.0f / 7.5f);
  EXPECT_EQ(bag.words[2].word, 4u);
  EXPECT_FLOAT_EQ(bag.words[2].weight, 6.0f / 7.5f);
  EXPECT_THAT(bag.direct, ElementsAre(NodeFeature{1, 1}, NodeFeature{2, 4}, NodeFeature{3, 0}, NodeFeature{3, 2},
                                      NodeFeature{3, 3}));
  const BagOfWords nothing = vocabulary.Transform(std::span<const image::Descriptor>());
  EXPECT_THAT(nothing.words, IsEmpty());
  EXPECT_THAT(nothing.direct, IsEmpty());
  const std::vector<image::Descriptor> weightless = {kMostOnes};
  EXPECT_THAT(vocabulary.Transform(weightless).words, IsEmpty());
}

TEST(Vocabulary, ScoreIsL1) {
  const BowVector a = {{1, 0.25f}, {3, 0.5f}, {9, 0.25f}};
  const BowVector b = {{0, 0.5f}, {3, 0.25f}, {9, 0.25f}};
  EXPECT_DOUBLE_EQ(Score(a, a), 1.0);
  EXPECT_DOUBLE_EQ(Score(a, b), 0.5);  // |a - b| = 0.5 + 0.25 + 0.25 + 0
  EXPECT_DOUBLE_EQ(Score(b, a), 0.5);
  EXPECT_DOUBLE_EQ(Score(a, {{2, 1.0f}}), 0.0);
  EXPECT_DOUBLE_EQ(Score(a, {}), 0.0);
}

TEST(Vocabulary, RejectsWhatIsNoTree) {
  const auto message = [](std::vector<Vocabulary::Node> nodes, int branching = 3, int depth = 2) {
    const auto result = Vocabulary::FromNodes(nodes, branching, depth);
    EXPECT_EQ(result.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(result.status().message());
  };
  EXPECT_THAT(message({}), HasSubstr("nodes"));
  EXPECT_THAT(message({{}}), HasSubstr("nodes"));
  EXPECT_THAT(message(SmallTree(), 2), HasSubstr("more than 2 children"));
  EXPECT_THAT(message(SmallTree(), 3, 1), HasSubstr("below the depth 1"));
  EXPECT_THAT(message(SmallTree(), 1), HasSubstr("branching"));
  EXPECT_THAT(message(SmallTree(), 256), HasSubstr("branching"));
  EXPECT_THAT(message(SmallTree(), 3, 17), HasSubstr("depth"));
  auto nodes = SmallTree();
  nodes[2].parent = 2;
  EXPECT_THAT(message(nodes), HasSubstr("not an earlier node"));
  nodes = SmallTree();
  nodes[2].weight = -1.0f;
  EXPECT_THAT(message(nodes), HasSubstr("weight"));
  nodes[2].weight = std::nanf("");
  EXPECT_THAT(message(nodes), HasSubstr("weight"));
}

TEST(Vocabulary, RoundTripsThroughBytesAndFile) {
  const Vocabulary vocabulary = Small();
  const std::string bytes = vocabulary.Serialize();
  const auto parsed = Vocabulary::Parse(bytes);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->Serialize(), bytes);
  EXPECT_EQ(parsed->hash(), vocabulary.hash());
  EXPECT_EQ(parsed->branching(), 3);
  EXPECT_EQ(parsed->depth(), 2);
  EXPECT_EQ(parsed->weight(4), 3.0f);
  EXPECT_EQ(parsed->Lookup(kOnes), 4u);
  // The form must not change under anybody's feet: this is the hash of version 1.
  EXPECT_EQ(bytes.size(), 8u + 5 * 4 + 8 + 7 * 32 + 5 * 4 + 8);
  EXPECT_EQ(bytes.substr(0, 12), std::string("CAIRNVOC\x01\0\0\0", 12));

  const std::string path = testing::TempDir() + "/vocabulary_" + std::to_string(::getpid());
  ASSERT_TRUE(vocabulary.Save(path).ok());
  const auto loaded = Vocabulary::Load(path);
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  EXPECT_EQ(loaded->Serialize(), bytes);
  std::filesystem::remove(path);
  EXPECT_EQ(Vocabulary::Load(path).status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(vocabulary.Save("/nonexistent/folder/file").ok());
  for (const char* no_file : {"/dev/zero", "/"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(Vocabulary::Load(no_file).status())) << no_file;
    EXPECT_FALSE(vocabulary.Save(no_file).ok()) << no_file;
  }
}

TEST(Vocabulary, HashNamesTheContent) {
  const Vocabulary vocabulary = Small();
  const auto other = vocabulary.WithWeights({0.5f, 1, 2, 0, 4});
  ASSERT_TRUE(other.ok());
  EXPECT_NE(other->hash(), vocabulary.hash());
  const auto same = other->WithWeights({0.5f, 1, 2, 0, 3});
  ASSERT_TRUE(same.ok());
  EXPECT_EQ(same->hash(), vocabulary.hash());
  EXPECT_FALSE(vocabulary.WithWeights({1, 2}).ok());
}

TEST(Vocabulary, NoticesEveryFlippedBitAndEveryTruncation) {
  const std::string bytes = Small().Serialize();
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string damaged = bytes;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      EXPECT_FALSE(Vocabulary::Parse(damaged).ok()) << "byte " << i;
    }
    EXPECT_FALSE(Vocabulary::Parse(std::string_view(bytes).substr(0, i)).ok()) << "length " << i;
  }
  EXPECT_EQ(Vocabulary::Parse(bytes + "x").status().code(), absl::StatusCode::kDataLoss);
}

TEST(Vocabulary, SaysWhatIsWrongWithAFile) {
  EXPECT_EQ(Vocabulary::Parse("").status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Vocabulary::Parse("10 6 0 0\n0 0 1 2").status().code(), absl::StatusCode::kInvalidArgument);
  std::string bytes = Small().Serialize();
  EXPECT_EQ(Vocabulary::Parse(bytes.substr(0, 20)).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Vocabulary::Parse(bytes.substr(0, 100)).status().code(), absl::StatusCode::kDataLoss);
  bytes[8] = 2;
  const auto newer = Vocabulary::Parse(bytes);
  EXPECT_EQ(newer.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(newer.status().message()), HasSubstr("newer Cairn"));
}

}  // namespace
}  // namespace cairn::place
