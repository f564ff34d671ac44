#include "place/index.h"

#include <algorithm>
#include <new>
#include <tuple>
#include <utility>

namespace cairn::place {
namespace {

// What bounded effort is, in postings: reaching those of a word takes as long in each segment as reading so many ...
constexpr std::uint64_t kReach = 32;
// ... and a query may take so many, and so many more per entry of the index: what two maps needed (docs/benchmarks.md).
constexpr std::uint64_t kEffort = 300'000, kEffortPerEntry = 15;
// Words that more than this part of the entries have come last.
constexpr std::uint32_t kManyHave = 30;

// Those with the best entries by then are looked at by all words: so many of them.
constexpr std::size_t kSegmentsAgain = 4;

struct Meeting {
  Scores* scores;
  void operator()(const WeightedWord& word, std::uint32_t entry, float weight) const {
    scores->Meet(entry, word.weight, weight);
  }
};

// One writer at a time.
void Increase(std::atomic<std::uint32_t>* number, std::uint32_t by) {
  number->store(number->load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
}

}  // namespace

absl::Status QueryOptions::Validate() const {
  if (!(min_common_share >= 0.0 && min_common_share <= 1.0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("place query: min_common_share is ", min_common_share, "; it must be between 0 and 1"));
  }
  if (!(min_score >= 0.0 && min_score <= 1.0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("place query: min_score is ", min_score, "; it must be between 0 and 1"));
  }
  return absl::OkStatus();
}

InvertedIndex::InvertedIndex(std::vector<float> idf)
    : idf_(std::move(idf)), frequency_(idf_.size()), blocks_(idf_.size()), id_chunks_(kMaxEntries / kIdsPerChunk) {}

InvertedIndex::~InvertedIndex() {
  for (std::atomic<Block*>& head : blocks_) {
    for (Block* block = head.load(); block != nullptr;) Block::Delete(std::exchange(block, block->older));
  }
  for (Segments* segments = segments_.load(); segments != nullptr;) delete std::exchange(segments, segments->older);
  for (std::atomic<std::uint32_t*>& chunk : id_chunks_) delete[] chunk.load();
}

InvertedIndex::Block* InvertedIndex::Block::New(std::uint32_t capacity, Block* older) {
  static_assert(alignof(Posting) <= alignof(Block) && sizeof(Block) % alignof(Posting) == 0);
  return new (::operator new(sizeof(Block) + capacity * sizeof(Posting))) Block(capacity, older);
}

void InvertedIndex::Block::Delete(Block* block) {
  block->~Block();
  ::operator delete(block);
}

namespace {

absl::Status NoSuchWord(std::uint32_t id, WordId word, std::size_t num_words) {
  return absl::InvalidArgumentError(absl::StrCat("id ", id, " has the word ", word,
                                                 ", but the vocabulary of the place index has ", num_words, " words"));
}

}  // namespace

absl::Status InvertedIndex::Check(std::uint32_t id, const BowVector& words) const {
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].word >= idf_.size()) return NoSuchWord(id, words[i].word, idf_.size());
    if (i > 0 && words[i].word <= words[i - 1].word) {
      return absl::InvalidArgumentError(absl::StrCat("the words of id ", id, " are not sorted"));
    }
  }
  return absl::OkStatus();
}

absl::Status InvertedIndex::Check(const Entry& entry) const {
  const auto wrong = std::ranges::find_if(entry.words, [this](WordId word) { return word >= idf_.size(); });
  return wrong == entry.words.end() ? absl::OkStatus() : NoSuchWord(entry.id, *wrong, idf_.size());
}

void InvertedIndex::SetId(std::uint32_t entry, std::uint32_t id) {
  std::atomic<std::uint32_t*>& chunk = id_chunks_[entry / kIdsPerChunk];
  if (chunk.load(std::memory_order_relaxed) == nullptr) {
    chunk.store(new std::uint32_t[kIdsPerChunk], std::memory_order_release);
  }
  chunk.load(std::memory_order_relaxed)[entry % kIdsPerChunk] = id;
}

absl::StatusOr<std::uint32_t> InvertedIndex::Add(std::uint32_t id, const BowVector& words) {
  CAIRN_RETURN_IF_ERROR(Check(id, words));
  const std::uint32_t entry = num_entries_.load(std::memory_order_relaxed);
  if (entry >= kMaxEntries) return absl::ResourceExhaustedError("the place index is full");
  SetId(entry, id);
  for (const WeightedWord& word : words) Append(word.word, {entry, word.weight});
  num_entries_.store(entry + 1, std::memory_order_release);
  return entry;
}

absl::StatusOr<std::uint32_t> InvertedIndex::AddAll(std::span<const Entry> entries) {
  const std::uint32_t first = num_entries_.load(std::memory_order_relaxed);
  if (entries.size() > kMaxEntries - first) return absl::ResourceExhaustedError("the place index is full");
  for (const Entry& entry : entries) CAIRN_RETURN_IF_ERROR(Check(entry));
  while (!entries.empty()) {
    const auto together = entries.first(std::min<std::size_t>(entries.size(), PostingSegment::kMaxEntries));
    CAIRN_RETURN_IF_ERROR(AddTogether(together));
    entries = entries.subspan(together.size());
  }
  return first;
}

absl::Status InvertedIndex::AddTogether(std::span<const Entry> entries) {
  std::size_t num_words = 0;
  for (const Entry& entry : entries) num_words += entry.words.size();
  // A segment has a number per word of the vocabulary; few entries are not worth that.
  if (num_words < idf_.size()) {
    for (const Entry& entry : entries) CAIRN_RETURN_IF_ERROR(Add(entry.id, Weigh(entry.words, idf_)).status());
    return absl::OkStatus();
  }
  const std::uint32_t first = num_entries_.load(std::memory_order_relaxed);
  std::vector<std::span<const WordId>> words_of_entry;
  for (const Entry& entry : entries) {
    SetId(first + static_cast<std::uint32_t>(words_of_entry.size()), entry.id);
    words_of_entry.emplace_back(entry.words);
  }
  Push(PostingSegment(first, words_of_entry, idf_));
  return absl::OkStatus();
}

void InvertedIndex::Push(PostingSegment segment) {
  const std::vector<std::uint16_t> frequencies = segment.TakeFrequencies();
  for (std::size_t word = 0; word < frequencies.size(); ++word) Increase(&frequency_[word], frequencies[word]);
  const std::uint32_t end = segment.first() + segment.num_entries();
  segments_.store(new Segments{std::move(segment), segments_.load(std::memory_order_relaxed)},
                  std::memory_order_release);
  num_entries_.store(end, std::memory_order_release);
}

absl::Status InvertedIndex::AddSegment(std::span<const std::uint32_t> ids, PostingSegment segment) {
  const std::uint32_t first = num_entries_.load(std::memory_order_relaxed);
  if (segment.first() != first || segment.num_entries() != ids.size()) {
    return absl::InvalidArgumentError("place index: a segment does not follow the one before");
  }
  if (ids.size() > kMaxEntries - first) return absl::ResourceExhaustedError("the place index is full");
  for (std::uint32_t i = 0; i < ids.size(); ++i) SetId(first + i, ids[i]);
  Push(std::move(segment));
  return absl::OkStatus();
}

void InvertedIndex::Append(WordId word, Posting posting) {
  Block* block = blocks_[word].load(std::memory_order_relaxed);
  std::uint32_t size = block == nullptr ? 0 : block->size.load(std::memory_order_relaxed);
  const bool full = block == nullptr || size == block->capacity;
  if (full) {
    // As many again may be expected to come.
    block = Block::New(block == nullptr ? 2 : 2 * block->capacity, block);
    size = 0;
  }
  block->postings()[size] = posting;
  block->size.store(size + 1, std::memory_order_release);
  if (full) blocks_[word].store(block, std::memory_order_release);
}

std::uint32_t InvertedIndex::IdOf(std::uint32_t entry) const {
  return id_chunks_[entry / kIdsPerChunk].load(std::memory_order_acquire)[entry % kIdsPerChunk];
}

std::pair<BowVector, BowVector> InvertedIndex::MostTelling(const BowVector& words,
                                                           std::span<const std::uint8_t> octaves) const {
  const std::uint32_t size = num_entries();
  const std::uint64_t reach = kReach * (size / PostingSegment::kMaxEntries + 1);
  struct Telling {
    bool many_have;
    int octave;
    std::uint32_t frequency;
    std::uint32_t number;  // in `words`
  };
  std::vector<Telling> telling;
  for (std::uint32_t i = 0; i < words.size(); ++i) {
    if (words[i].word >= idf_.size()) continue;
    const std::uint32_t frequency = frequency_[words[i].word].load(std::memory_order_relaxed);
    if (frequency > 0) telling.push_back({frequency > size / kManyHave, octaves[i], frequency, i});
  }
  std::ranges::sort(telling, [](const Telling& a, const Telling& b) {
    return std::tie(a.many_have, b.octave, a.number) < std::tie(b.many_have, a.octave, b.number);
  });
  std::pair<BowVector, BowVector> first_and_others;
  std::uint64_t effort = 0;
  for (const Telling& word : telling) {
    effort += reach + word.frequency;
    const bool first = effort <= kEffort + kEffortPerEntry * size;
    (first ? first_and_others.first : first_and_others.second).push_back(words[word.number]);
  }
  std::ranges::sort(first_and_others.first, {}, &WeightedWord::word);
  std::ranges::sort(first_and_others.second, {}, &WeightedWord::word);
  return first_and_others;
}

std::vector<const PostingSegment*> InvertedIndex::SegmentsOfBest(const Scores& scores) const {
  std::vector<std::pair<double, const PostingSegment*>> segments;  // and the best score there
  for (const Segments* at = segments_.load(std::memory_order_acquire); at != nullptr; at = at->older) {
    const PostingSegment& segment = at->newest;
    if (segment.first() >= scores.size()) continue;  // it came meanwhile
    double best = 0.0;
    for (std::uint32_t i = 0; i < segment.num_entries(); ++i) best = std::max(best, scores.score(segment.first() + i));
    segments.emplace_back(best, &segment);
  }
  std::ranges::sort(segments, [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second->first() < b.second->first();
  });
  std::vector<const PostingSegment*> best;
  for (std::size_t i = 0; i < std::min(segments.size(), kSegmentsAgain); ++i) best.push_back(segments[i].second);
  return best;
}

void InvertedIndex::MeetSegments(const BowVector& words, Scores* scores) const {
  // Segment by segment, so that what is looked at lies together.
  for (const Segments* at = segments_.load(std::memory_order_acquire); at != nullptr; at = at->older) {
    if (at->newest.first() < scores->size()) at->newest.ForAll(words, idf_, Meeting{scores});  // else it came meanwhile
  }
}

void InvertedIndex::MeetBlocks(const BowVector& words, Scores* scores) const {
  for (const WeightedWord& word : words) {
    if (word.word >= idf_.size()) continue;
    for (const Block* block = blocks_[word.word].load(std::memory_order_acquire); block != nullptr;
         block = block->older) {
      const std::uint32_t filled = block->size.load(std::memory_order_acquire);
      for (std::uint32_t i = 0; i < filled; ++i) {
        const Posting& posting = block->postings()[i];
        // Else it came meanwhile.
        if (posting.entry < scores->size()) scores->Meet(posting.entry, word.weight, posting.weight);
      }
    }
  }
}

Scores InvertedIndex::Score(const BowVector& words) const {
  Scores scores(num_entries());
  MeetSegments(words, &scores);
  MeetBlocks(words, &scores);
  return scores;
}

Scores InvertedIndex::ScoreBounded(const BowVector& words, std::span<const std::uint8_t> octaves) const {
  const auto [first, others] = MostTelling(words, octaves);
  Scores scores(num_entries());
  MeetSegments(first, &scores);
  if (!others.empty()) {
    for (const PostingSegment* segment : SegmentsOfBest(scores)) segment->ForAll(others, idf_, Meeting{&scores});
  }
  MeetBlocks(words, &scores);
  return scores;
}

std::vector<Candidate> InvertedIndex::Best(const Scores& scores, const QueryOptions& options,
                                           const Counts& counts) const {
  const auto size = static_cast<std::uint32_t>(scores.size());
  // Asked of few, as most of a large map share too few words to matter.
  const auto taken = [&](std::uint32_t entry) {
    const std::uint32_t id = IdOf(entry);
    return (!counts || counts(id, entry)) && !(options.exclude && options.exclude(id));
  };
  double min_common = 1.0;
  if (options.min_common_share > 0.0) {
    std::uint32_t most = 0;
    for (std::uint32_t entry = 0; entry < size; ++entry) {
      if (scores.common(entry) > most && taken(entry)) most = scores.common(entry);
    }
    min_common = std::max(min_common, options.min_common_share * most);
  }
  const auto better = [](const Candidate& a, const Candidate& b) {
    return a.score != b.score ? a.score > b.score : a.id < b.id;
  };
  std::vector<Candidate> best;  // a heap, the worst of them first
  const std::size_t wanted = options.max_results == 0 ? size : options.max_results;
  for (std::uint32_t entry = 0; entry < size; ++entry) {
    if (scores.common(entry) < min_common || scores.score(entry) < options.min_score) continue;
    const bool full = best.size() == wanted;
    if (full && scores.score(entry) < best.front().score) continue;
    const Candidate candidate{IdOf(entry), scores.score(entry), scores.common(entry)};
    if ((full && !better(candidate, best.front())) || !taken(entry)) continue;
    if (full) {
      std::ranges::pop_heap(best, better);
      best.pop_back();
    }
    best.push_back(candidate);
    std::ranges::push_heap(best, better);
  }
  std::ranges::sort_heap(best, better);
  return best;
}

}  // namespace cairn::place
