#include "place/default_vocabulary.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "image/testing_descriptors.h"

namespace cairn::place {
namespace {

using image::testing::FlipBits;
using image::testing::RandomDescriptor;

TEST(DefaultVocabulary, IsThereAndIsWhatTheDocumentsSay) {
  const auto path = FindDefaultVocabulary();
  ASSERT_TRUE(path.ok()) << path.status();
  EXPECT_LE(std::filesystem::file_size(*path), 5u << 20);
  const auto vocabulary = LoadDefaultVocabulary();
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_EQ(vocabulary->branching(), 10);
  EXPECT_EQ(vocabulary->depth(), 5);
  EXPECT_GE(vocabulary->num_words(), 80000u);
  // docs/vocabulary.md names this hash; a newly trained vocabulary changes both.
  EXPECT_EQ(vocabulary->hash(), 0x7bee48e46ce04e78ull);
}

TEST(DefaultVocabulary, TellsDescriptorsApart) {
  const auto vocabulary = LoadDefaultVocabulary();
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  Random random(1);
  std::vector<image::Descriptor> descriptors;
  for (int i = 0; i < 1000; ++i) descriptors.push_back(RandomDescriptor(random));
  const BagOfWords bag = vocabulary->Transform(descriptors);
  EXPECT_GT(bag.words.size(), 500u);
  EXPECT_EQ(bag.direct.size(), 1000u);
  std::vector<image::Descriptor> noisy;
  for (const image::Descriptor& descriptor : descriptors) noisy.push_back(FlipBits(descriptor, 10, random));
  const BagOfWords again = vocabulary->Transform(noisy);
  EXPECT_NEAR(Score(bag.words, bag.words), 1.0, 1e-4);
  // Random descriptors lie between the words of real ones, so noise moves many; still far from unrelated ones.
  std::vector<image::Descriptor> unrelated;
  for (int i = 0; i < 1000; ++i) unrelated.push_back(RandomDescriptor(random));
  EXPECT_GT(Score(bag.words, again.words), 5.0 * Score(bag.words, vocabulary->Transform(unrelated).words));
}

}  // namespace
}  // namespace cairn::place
