#include "place/index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <span>
#include <thread>
#include <vector>

#include "image/testing_descriptors.h"
#include "place/training.h"

namespace cairn::place {
namespace {

using image::testing::FlipBits;
using image::testing::RandomDescriptor;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Every tenth of `num_words` words or so, at random, normalised.
BowVector RandomWords(std::size_t num_words, Random* random) {
  BowVector words;
  float sum = 0.0f;
  for (WordId word = 0; word < num_words; ++word) {
    if (random->Below(10) != 0) continue;
    words.push_back({word, static_cast<float>(random->Uniform(0.1, 1.0))});
    sum += words.back().weight;
  }
  for (WeightedWord& word : words) word.weight /= sum;
  return words;
}

// That weigh differently; some nothing.
std::vector<float> RandomWeights(std::size_t num_words, Random* random) {
  std::vector<float> idf;
  while (idf.size() < num_words) {
    idf.push_back(random->Below(10) == 0 ? 0.0f : static_cast<float>(random->Uniform(0.5, 8.0)));
  }
  return idf;
}
std::vector<float> Ones(std::size_t num_words) { return std::vector<float>(num_words, 1.0f); }

QueryOptions Everything() {
  QueryOptions options;
  options.min_common_share = 0.0;
  options.max_results = 0;
  return options;
}

TEST(InvertedIndex, ScoresLikeTheDirectComparison) {
  Random random(1);
  InvertedIndex index(Ones(200));
  std::map<std::uint32_t, BowVector> entries;
  for (std::uint32_t id = 5; id < 45; ++id) {
    entries[id] = RandomWords(200, &random);
    ASSERT_TRUE(index.Add(id, entries[id]).ok());
  }
  EXPECT_EQ(index.num_entries(), 40u);
  const BowVector query = RandomWords(200, &random);
  const std::vector<Candidate> candidates = index.Query(query, Everything());
  std::size_t expected = 0;
  for (const auto& [id, words] : entries) expected += Score(query, words) > 0.0;
  EXPECT_EQ(candidates.size(), expected);
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    EXPECT_DOUBLE_EQ(candidates[i].score, Score(query, entries[candidates[i].id]));
    if (i > 0) {
      EXPECT_GE(candidates[i - 1].score, candidates[i].score);
    }
  }
  QueryOptions three = Everything();
  three.max_results = 3;
  EXPECT_THAT(index.Query(query, three), ElementsAre(candidates[0], candidates[1], candidates[2]));
}

// An earlier state is the entries of then; one where some have gone is those that are left.
TEST(InvertedIndex, AnswersDependOnTheEntriesThatCountAlone) {
  Random random(2);
  InvertedIndex all(Ones(200)), some(Ones(200));
  for (std::uint32_t id = 0; id < 60; ++id) {
    const BowVector words = RandomWords(200, &random);
    ASSERT_TRUE(all.Add(id, words).ok());
    const bool kept = id < 40 && id % 3 != 0;
    ASSERT_TRUE(!kept || some.Add(id, words).ok());
  }
  const auto counts = [](std::uint32_t id, std::uint32_t entry) { return entry < 40 && id % 3 != 0; };
  for (int i = 0; i < 20; ++i) {
    const BowVector query = RandomWords(200, &random);
    EXPECT_EQ(all.Query(query, Everything(), counts), some.Query(query, Everything()));
    EXPECT_EQ(all.Query(query, {}, counts), some.Query(query));
  }
}

// For the thread sanitizer as well.
TEST(InvertedIndex, IsAskedWhileItGrows) {
  Random random(3);
  std::vector<BowVector> entries;
  for (int i = 0; i < 400; ++i) entries.push_back(RandomWords(100, &random));
  InvertedIndex growing(Ones(100)), whole(Ones(100));
  for (std::uint32_t id = 0; id < 100; ++id) {
    ASSERT_TRUE(growing.Add(id, entries[id]).ok());
    ASSERT_TRUE(whole.Add(id, entries[id]).ok());
  }
  const BowVector query = RandomWords(100, &random);
  const auto expected = whole.Query(query, Everything());
  std::atomic<int> wrong = 0;
  std::thread reader([&] {
    while (growing.num_entries() < 400) {
      const auto first = growing.Query(query, Everything(), [](std::uint32_t, std::uint32_t e) { return e < 100; });
      wrong += first == expected ? 0 : 1;
    }
  });
  for (std::uint32_t id = 100; id < 400; ++id) ASSERT_TRUE(growing.Add(id, entries[id]).ok());
  reader.join();
  EXPECT_EQ(wrong, 0);
}

// Entries of some forty words, in no order, some of them again and again.
std::vector<InvertedIndex::Entry> RandomEntries(std::uint32_t count, std::uint32_t num_words, Random* random) {
  std::vector<InvertedIndex::Entry> entries;
  for (std::uint32_t id = 0; id < count; ++id) {
    InvertedIndex::Entry& entry = entries.emplace_back();
    entry.id = 100000 - id;
    for (int i = 0; i < 30; ++i) entry.words.push_back(static_cast<WordId>(random->Below(num_words)));
    for (int i = 0; i < 10; ++i) entry.words.push_back(entry.words[random->Below(30)]);
  }
  return entries;
}

// All at once, one by one, and mixed.
TEST(InvertedIndex, AddsManyAsOneByOne) {
  Random random(5);
  const std::vector<float> idf = RandomWeights(200, &random);
  std::vector<InvertedIndex::Entry> entries = RandomEntries(70, 200, &random);
  entries[7].words.clear();
  // More often than a posting can say, just as often, and once less.
  entries[8].words.insert(entries[8].words.end(), 200, entries[8].words[0]);
  entries[9].words = std::vector<WordId>(63, entries[8].words[0]);
  entries[10].words = std::vector<WordId>(62, entries[8].words[0]);
  InvertedIndex single(idf), many(idf);
  for (const InvertedIndex::Entry& entry : entries) ASSERT_TRUE(single.Add(entry.id, Weigh(entry.words, idf)).ok());
  const auto add = [&](const InvertedIndex::Entry& entry) { return many.Add(entry.id, Weigh(entry.words, idf)); };
  const std::span<const InvertedIndex::Entry> all = entries;
  EXPECT_EQ(many.AddAll(all.first(40)).value(), 0u);
  EXPECT_EQ(add(all[40]).value(), 40u);
  EXPECT_EQ(many.AddAll(all.subspan(41, 9)).value(), 41u);
  for (const InvertedIndex::Entry& entry : all.subspan(50, 5)) ASSERT_TRUE(add(entry).ok());
  EXPECT_EQ(many.AddAll(all.subspan(55, 2)).value(), 55u);  // fewer words than the vocabulary has
  EXPECT_EQ(many.AddAll(all.subspan(57)).value(), 57u);
  EXPECT_EQ(many.AddAll({}).value(), 70u);
  ASSERT_EQ(many.num_entries(), 70u);
  for (int i = 0; i < 20; ++i) {
    const BowVector query = RandomWords(200, &random);
    EXPECT_EQ(many.Query(query, Everything()), single.Query(query, Everything()));
    EXPECT_EQ(many.Query(query), single.Query(query));
  }
  // One bad entry, and none of them comes in.
  const std::vector<InvertedIndex::Entry> bad = {{1, {3}}, {2, {200}}};
  EXPECT_EQ(many.AddAll(bad).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(many.num_entries(), 70u);
}

// More than one segment takes, of a vocabulary that does not end where one of its buckets does.
TEST(InvertedIndex, AddsMoreThanASegmentTakes) {
  Random random(6);
  const std::vector<float> idf = RandomWeights(1337, &random);
  const std::vector<InvertedIndex::Entry> entries = RandomEntries(2 * PostingSegment::kMaxEntries + 100, 1337, &random);
  InvertedIndex single(idf), many(idf);
  for (const InvertedIndex::Entry& entry : entries) ASSERT_TRUE(single.Add(entry.id, Weigh(entry.words, idf)).ok());
  ASSERT_TRUE(many.AddAll(entries).ok());
  for (int i = 0; i < 5; ++i) {
    const BowVector query = Weigh(RandomEntries(1, 1337, &random)[0].words, idf);
    EXPECT_EQ(many.Query(query, Everything()), single.Query(query, Everything()));
  }
}

// Segments that were packed give the answers that they gave, to the bit; half of the entries came in another way.
TEST(InvertedIndex, AnswersTheSameFromPackedSegments) {
  Random random(8);
  const std::vector<float> idf = RandomWeights(700, &random);
  std::vector<InvertedIndex::Entry> entries = RandomEntries(300, 700, &random);
  entries[4].words = std::vector<WordId>(2000, entries[4].words[0]);  // more often than a posting can say
  entries[5].words.clear();
  std::vector<std::span<const WordId>> words;
  std::vector<std::uint32_t> ids;
  for (const InvertedIndex::Entry& entry : entries) {
    words.emplace_back(entry.words);
    ids.push_back(entry.id);
  }
  const std::span<const std::span<const WordId>> all = words;
  const std::string first = PostingSegment(0, all.first(150), idf).Pack();
  const std::string second = PostingSegment(0, all.subspan(150), idf).Pack();

  InvertedIndex whole(idf), packed(idf);
  ASSERT_TRUE(whole.AddAll(entries).ok());
  const std::span<const std::uint32_t> all_ids = ids;
  auto unpacked = PostingSegment::Unpack(0, idf.size(), SharedBytes(first));
  ASSERT_TRUE(unpacked.ok()) << unpacked.status();
  ASSERT_TRUE(packed.AddSegment(all_ids.first(150), *std::move(unpacked)).ok());
  EXPECT_EQ(
      packed.AddSegment(all_ids.first(150), PostingSegment::Unpack(0, idf.size(), SharedBytes(first)).value()).code(),
      absl::StatusCode::kInvalidArgument);
  ASSERT_TRUE(
      packed.AddSegment(all_ids.subspan(150), PostingSegment::Unpack(150, idf.size(), SharedBytes(second)).value())
          .ok());
  for (int i = 0; i < 10; ++i) {
    const BowVector query = Weigh(RandomEntries(1, 700, &random)[0].words, idf);
    EXPECT_EQ(packed.Query(query, Everything()), whole.Query(query, Everything()));
  }
}

// Every entry has the first fifty words, and 90 of the others at random. Asked for an entry's words, which the image
// has at its coarsest octave, and four thousand others.
TEST(InvertedIndex, ABoundedQueryLeavesOutWordsThatManyHave) {
  constexpr WordId kNumWords = 9000, kCommon = 50;
  Random random(10);
  const std::vector<float> idf(kNumWords, 2.0f);
  const auto other = [&] { return kCommon + static_cast<WordId>(random.Below(kNumWords - kCommon)); };
  std::vector<InvertedIndex::Entry> entries(6000);
  for (InvertedIndex::Entry& entry : entries) {
    entry.id = static_cast<std::uint32_t>(&entry - entries.data());
    for (WordId word = 0; word < kCommon; ++word) entry.words.push_back(word);
    for (int i = 0; i < 90; ++i) entry.words.push_back(other());
  }
  InvertedIndex together(idf), alone(idf);
  ASSERT_TRUE(together.AddAll(entries).ok());
  for (const InvertedIndex::Entry& entry : entries) ASSERT_TRUE(alone.Add(entry.id, Weigh(entry.words, idf)).ok());

  for (const std::uint32_t id : {3u, 1100u, 5999u}) {
    const BowVector own = Weigh(entries[id].words, idf);
    const std::vector<std::uint8_t> fine(own.size(), 0);
    EXPECT_EQ(together.ScoreBounded(own, fine).common(id), own.size()) << "few words are all compared";
    std::vector<WordId> asked = entries[id].words;
    for (int i = 0; i < 4000; ++i) asked.push_back(other());
    const BowVector query = Weigh(asked, idf);
    std::vector<std::uint8_t> octaves;
    std::uint32_t num_coarse = 0;
    for (const WeightedWord& word : query) {
      octaves.push_back(std::ranges::count(entries[id].words, word.word) > 0 ? 7 : 0);
      num_coarse += octaves.back() > 0 && word.word >= kCommon ? 1 : 0;
    }
    const Scores bounded = together.ScoreBounded(query, octaves), all = together.Score(query);
    EXPECT_EQ(bounded.common(id), all.common(id)) << "where the best are, all words are compared";
    EXPECT_GE(bounded.common(id), num_coarse + kCommon);
    EXPECT_EQ(together.Best(bounded, Everything())[0].id, id);
    EXPECT_EQ(alone.Best(alone.ScoreBounded(query, octaves), Everything()), together.Best(all, Everything()))
        << "entries that came one by one are compared by all words";
    std::uint32_t compared = 0, in_common = 0;
    std::uint32_t by_all_words = 0;
    for (std::uint32_t entry = 0; entry < entries.size(); ++entry) {
      if (bounded.common(entry) == all.common(entry)) {
        ++by_all_words;
        continue;
      }
      EXPECT_LE(bounded.common(entry) + kCommon, all.common(entry)) << "what all have is left out";
      compared += bounded.common(entry);
      in_common += all.common(entry) - kCommon;
    }
    EXPECT_LE(by_all_words, 4 * PostingSegment::kMaxEntries);
    // Of the others as many as there is time for.
    EXPECT_GT(compared, in_common / 3);
    EXPECT_LT(compared, in_common);
  }
}

TEST(PostingSegment, DamagedBytesAreNoSegment) {
  Random random(9);
  const std::vector<float> idf = RandomWeights(300, &random);
  const std::vector<InvertedIndex::Entry> entries = RandomEntries(40, 300, &random);
  std::vector<std::span<const WordId>> words;
  for (const InvertedIndex::Entry& entry : entries) words.emplace_back(entry.words);
  const std::string good = PostingSegment(0, words, idf).Pack();
  ASSERT_TRUE(PostingSegment::Unpack(0, 300, SharedBytes(good)).ok());
  EXPECT_EQ(PostingSegment::Unpack(0, 301, SharedBytes(good)).status().code(), absl::StatusCode::kDataLoss);
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_EQ(PostingSegment::Unpack(0, 300, SharedBytes(good.substr(0, size))).status().code(),
              absl::StatusCode::kDataLoss);
  }
  // Whatever a byte becomes, entries stay in range (which a sanitizer sees).
  const InvertedIndex index(idf);
  for (std::size_t i = 0; i < good.size(); ++i) {
    std::string changed = good;
    changed[i] = static_cast<char>(random.Below(256));
    const auto segment = PostingSegment::Unpack(0, 300, SharedBytes(changed));
    if (!segment.ok()) continue;
    for (WordId word = 0; word < 300; ++word) {
      segment->ForEach(word, 1.0f, [&](std::uint32_t entry, float) { EXPECT_LT(entry, segment->num_entries()); });
    }
  }
}

TEST(InvertedIndex, TiesGoToTheSmallerId) {
  InvertedIndex index(Ones(4));
  for (const std::uint32_t id : {9u, 3u, 6u}) ASSERT_TRUE(index.Add(id, {{1, 0.5f}, {2, 0.5f}}).ok());
  EXPECT_THAT(index.Query({{1, 1.0f}}), ElementsAre(Candidate{3, 0.5, 1}, Candidate{6, 0.5, 1}, Candidate{9, 0.5, 1}));
}

TEST(InvertedIndex, DropsThoseWithFewCommonWordsAndExcluded) {
  InvertedIndex index(Ones(10));
  const float w = 0.2f;
  ASSERT_TRUE(index.Add(1, {{0, w}, {1, w}, {2, w}, {3, w}, {4, w}}).ok());  // shares 5
  ASSERT_TRUE(index.Add(2, {{0, w}, {1, w}, {2, w}, {3, w}, {9, w}}).ok());  // shares 4
  ASSERT_TRUE(index.Add(3, {{0, w}, {6, w}, {7, w}, {8, w}, {9, w}}).ok());  // shares 1
  const BowVector query = {{0, w}, {1, w}, {2, w}, {3, w}, {4, w}};
  const auto ids = [&](const QueryOptions& options) {
    std::vector<std::uint32_t> result;
    for (const Candidate& candidate : index.Query(query, options)) result.push_back(candidate.id);
    return result;
  };
  EXPECT_THAT(ids({}), ElementsAre(1, 2));
  QueryOptions options;
  options.min_common_share = 1.0;
  EXPECT_THAT(ids(options), ElementsAre(1));
  // The excluded entry does not set the standard for the others.
  options.exclude = [](std::uint32_t id) { return id == 1; };
  EXPECT_THAT(ids(options), ElementsAre(2));
  options = Everything();
  EXPECT_THAT(ids(options), ElementsAre(1, 2, 3));
  options.min_score = 0.5;
  EXPECT_THAT(ids(options), ElementsAre(1, 2));
  EXPECT_THAT(index.Query({}), IsEmpty());
  EXPECT_THAT(index.Query({{5, 1.0f}}), IsEmpty());
}

TEST(InvertedIndex, ReportsMisuse) {
  InvertedIndex index(Ones(10));
  EXPECT_TRUE(index.Add(1, {{2, 1.0f}}).ok());
  EXPECT_EQ(index.Add(2, {{10, 1.0f}}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(index.Add(2, {{3, 0.5f}, {2, 0.5f}}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(index.num_entries(), 1u);
  EXPECT_TRUE(index.Add(2, {}).ok());  // an image without words can be held, but is never found
  EXPECT_THAT(index.Query({{2, 1.0f}}), ElementsAre(Candidate{1, 1.0, 1}));
  QueryOptions options;
  options.min_common_share = 2.0;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.min_score = -1.0;
  EXPECT_FALSE(options.Validate().ok());
  EXPECT_TRUE(QueryOptions{}.Validate().ok());
}

class MatchByWordsTest : public testing::Test {
 protected:
  // b holds noisy copies of a in reverse order.
  void SetUp() override {
    Random random(4);
    for (int i = 0; i < 400; ++i) {
      a_.descriptors.push_back(RandomDescriptor(random));
      a_.keypoints.push_back({0.0f, 0.0f, static_cast<float>(random.Uniform(-3, 3)), 0});
    }
    for (int i = 399; i >= 0; --i) {
      b_.descriptors.push_back(FlipBits(a_.descriptors[i], 8, random));
      b_.keypoints.push_back(a_.keypoints[i]);
    }
    TrainingOptions options;
    options.branching = 4;
    options.depth = 2;
    vocabulary_ = Train(std::vector<ImageDescriptors>{a_.descriptors, b_.descriptors}, options);
    ASSERT_TRUE(vocabulary_.ok());
  }
  image::Features a_, b_;
  absl::StatusOr<Vocabulary> vocabulary_;
};

TEST_F(MatchByWordsTest, FindsPairsUnderTheSameNode) {
  const DirectIndex direct_a = vocabulary_->Transform(a_, 1).direct, direct_b = vocabulary_->Transform(b_, 1).direct;
  const std::vector<image::FeatureMatch> matches = MatchByWords(a_, direct_a, b_, direct_b);
  EXPECT_GE(matches.size(), 240u);  // random descriptors have no clusters: some copies fall beside
  for (std::size_t i = 0; i < matches.size(); ++i) {
    EXPECT_EQ(matches[i].b, 399 - matches[i].a);
    if (i > 0) {
      EXPECT_LT(matches[i - 1].a, matches[i].a);
    }
  }
  // Under the root, it is the same as comparing all with all.
  const DirectIndex all_a = vocabulary_->Transform(a_, 0).direct, all_b = vocabulary_->Transform(b_, 0).direct;
  EXPECT_EQ(MatchByWords(a_, all_a, b_, all_b), image::MatchBruteForce(a_, b_));
}

TEST_F(MatchByWordsTest, LeavesMaskedFeaturesOut) {
  const DirectIndex direct_a = vocabulary_->Transform(a_, 0).direct, direct_b = vocabulary_->Transform(b_, 0).direct;
  std::vector<std::uint8_t> mask_a(400, 1), mask_b(400, 1);
  for (std::size_t i = 0; i < 400; i += 2) mask_a[i] = 0;
  for (std::size_t i = 0; i < 100; ++i) mask_b[i] = 0;
  const auto matches = MatchByWords(a_, direct_a, b_, direct_b, {}, mask_a, mask_b);
  EXPECT_EQ(matches.size(), 150u);
  for (const image::FeatureMatch& match : matches) {
    EXPECT_EQ(match.a % 2, 1u);
    EXPECT_GE(match.b, 100u);
  }
}

TEST_F(MatchByWordsTest, EmptyInputGivesNothing) {
  const DirectIndex direct = vocabulary_->Transform(a_).direct;
  EXPECT_THAT(MatchByWords(a_, direct, {}, {}), IsEmpty());
  EXPECT_THAT(MatchByWords({}, {}, a_, direct), IsEmpty());
}

}  // namespace
}  // namespace cairn::place
