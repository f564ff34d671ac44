// Inverted index over bags of words, keyed by opaque ids, and matching guided by the direct index (Galvez-Lopez &
// Tardos, T-RO 2012, sec. IV-V).
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/status.h"
#include "image/feature.h"
#include "image/matching.h"
#include "place/posting_segment.h"
#include "place/vocabulary.h"

namespace cairn::place {

struct QueryOptions {
  // Candidates must share at least this part of the largest number of words shared with any entry (Mur-Artal, Tardos:
  // "Fast relocalisation and loop closing in keyframe-based SLAM", ICRA 2014). 0: one shared word is enough.
  double min_common_share = 0.8;
  double min_score = 0.0;
  std::size_t max_results = 10;                // 0: all
  std::function<bool(std::uint32_t)> exclude;  // true: ignore this id, also for the largest number above

  absl::Status Validate() const;
};

struct Candidate {
  std::uint32_t id = 0;
  double score = 0.0;              // L1 score in [0, 1]
  std::uint32_t common_words = 0;  // words in both

  bool operator==(const Candidate&) const = default;
};

// What entries have in common with an image, by their number: nothing with those that came later. Both in one number,
// as adding to it is most of the work of a query; and in whole numbers, so that the order of words does not matter.
class Scores {
 public:
  explicit Scores(std::size_t num_entries = 0) : shared_(num_entries, 0) {}

  std::size_t size() const { return shared_.size(); }
  // L1, in [0, 1], to 4e-12 per word.
  double score(std::uint32_t entry) const {
    return static_cast<double>(shared_[entry] & (kCommonWord - 1)) / static_cast<double>(kOne);
  }
  // Words in both.
  std::uint32_t common(std::uint32_t entry) const { return static_cast<std::uint32_t>(shared_[entry] >> kScoreBits); }

  // A word that weighs so much, at most 1, in the one and in the other.
  void Meet(std::uint32_t entry, float weight, float other_weight) {
    shared_[entry] += kCommonWord + static_cast<std::int64_t>(std::min(weight, other_weight) * kOne);
  }

 private:
  static constexpr int kScoreBits = 40;  // with room for sums of rounded weights that exceed 1
  static constexpr std::uint64_t kCommonWord = std::uint64_t{1} << kScoreBits;
  static constexpr float kOne = std::uint64_t{1} << (kScoreBits - 2);

  std::vector<std::uint64_t> shared_;
};

// Grows at its end only, so that an index of an earlier state of a map is the same object with fewer entries counted:
// whoever asks says which entries count (tracking::PlaceIndex). Nothing is ever removed or moved.
class InvertedIndex {
 public:
  // Whether an entry counts; empty: all do. Entries are numbered in the order in which they came.
  using Counts = std::function<bool(std::uint32_t id, std::uint32_t entry)>;

  // For words 0 .. idf.size()-1, which weigh so.
  explicit InvertedIndex(std::vector<float> idf);
  ~InvertedIndex();
  InvertedIndex(const InvertedIndex&) = delete;
  InvertedIndex& operator=(const InvertedIndex&) = delete;

  // Gives the number of the entry. InvalidArgument for a word out of range or words not sorted, ResourceExhausted
  // beyond kMaxEntries. One call at a time; queries may run beside it, and do not see what came after they began.
  absl::StatusOr<std::uint32_t> Add(std::uint32_t id, const BowVector& words);

  // The same for many, faster and in a quarter of the memory, as if each were added as Weigh() gives it. Gives the
  // number of the first; the others follow it.
  struct Entry {
    std::uint32_t id = 0;
    std::vector<WordId> words;  // in any order, each as often as it is there
  };
  absl::StatusOr<std::uint32_t> AddAll(std::span<const Entry> entries);

  // Entries that were packed before, with these ids. InvalidArgument if the segment is not of so many entries that
  // begin with the next number; else as AddAll.
  absl::Status AddSegment(std::span<const std::uint32_t> ids, PostingSegment segment);

  std::span<const float> idf() const { return idf_; }
  std::uint32_t num_entries() const { return num_entries_.load(std::memory_order_acquire); }

  // Most of the work of a query, which may then be asked for several bests.
  Scores Score(const BowVector& words) const;
  // The same in less time per entry the larger the index is. If all words would take longer, entries that came
  // together are compared by as many as do not, those first that other images of the place are likely to have and few
  // other entries do; by all where the best of these are. `octaves` has the coarsest octave at which the image has each
  // word; coarse features are found again more often. Scores elsewhere are then smaller, and which words are compared
  // depends on all entries, also on those that do not count.
  Scores ScoreBounded(const BowVector& words, std::span<const std::uint8_t> octaves) const;
  // Best score first; of equal scores the smaller id. The answer depends on the entries that count alone.
  std::vector<Candidate> Best(const Scores& scores, const QueryOptions& options = {}, const Counts& counts = {}) const;
  std::vector<Candidate> Query(const BowVector& words, const QueryOptions& options = {},
                               const Counts& counts = {}) const {
    return Best(Score(words), options, counts);
  }

  static constexpr std::uint32_t kMaxEntries = 1u << 26;

 private:
  struct Posting {
    std::uint32_t entry;
    float weight;
  };
  // The postings of a word: a list of blocks, the newest first. The postings of a block lie behind it in memory.
  struct Block {
    static Block* New(std::uint32_t capacity, Block* older);
    static void Delete(Block* block);
    Posting* postings() { return reinterpret_cast<Posting*>(this + 1); }
    const Posting* postings() const { return reinterpret_cast<const Posting*>(this + 1); }

    Block* const older;
    const std::uint32_t capacity;
    std::atomic<std::uint32_t> size = 0;

   private:
    Block(std::uint32_t most, Block* before) : older(before), capacity(most) {}
  };
  // Those that came together, the newest first.
  struct Segments {
    PostingSegment newest;
    Segments* older;
  };
  static constexpr std::uint32_t kIdsPerChunk = 1u << 13;

  absl::Status Check(std::uint32_t id, const BowVector& words) const;
  absl::Status Check(const Entry& entry) const;
  // At most as many as a segment takes.
  absl::Status AddTogether(std::span<const Entry> entries);
  void Push(PostingSegment segment);
  void SetId(std::uint32_t entry, std::uint32_t id);
  void Append(WordId word, Posting posting);
  // Those that are compared everywhere with bounded effort, and the others that entries of segments have; ascending.
  std::pair<BowVector, BowVector> MostTelling(const BowVector& words, std::span<const std::uint8_t> octaves) const;
  std::vector<const PostingSegment*> SegmentsOfBest(const Scores& scores) const;
  void MeetSegments(const BowVector& words, Scores* scores) const;
  void MeetBlocks(const BowVector& words, Scores* scores) const;
  std::uint32_t IdOf(std::uint32_t entry) const;

  const std::vector<float> idf_;                        // by word
  std::vector<std::atomic<std::uint32_t>> frequency_;   // by word: how many entries of segments have it
  std::vector<std::atomic<Block*>> blocks_;             // by word: of entries that came alone
  std::atomic<Segments*> segments_ = nullptr;           // of those that came together
  std::vector<std::atomic<std::uint32_t*>> id_chunks_;  // ids of entries
  std::atomic<std::uint32_t> num_entries_ = 0;
};

// Compares only features under the same node of the vocabulary. Both direct indices must come from the same vocabulary
// and level. A mask, if not empty, has an entry per feature; features with 0 are left out. Sorted by feature of a.
std::vector<image::FeatureMatch> MatchByWords(const image::Features& a, const DirectIndex& direct_a,
                                              const image::Features& b, const DirectIndex& direct_b,
                                              const image::MatchOptions& options = {},
                                              std::span<const std::uint8_t> mask_a = {},
                                              std::span<const std::uint8_t> mask_b = {});

}  // namespace cairn::place
