#include "place/index.h"

#include <algorithm>
#include <utility>

namespace cairn::place {

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

InvertedIndex::InvertedIndex(std::size_t num_words) : blocks_(num_words), id_chunks_(kMaxEntries / kIdsPerChunk) {}

InvertedIndex::~InvertedIndex() {
  for (std::atomic<Block*>& head : blocks_) {
    for (Block* block = head.load(); block != nullptr;) delete std::exchange(block, block->older);
  }
  for (std::atomic<std::uint32_t*>& chunk : id_chunks_) delete[] chunk.load();
}

absl::StatusOr<std::uint32_t> InvertedIndex::Add(std::uint32_t id, const BowVector& words) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].word >= blocks_.size()) {
      return absl::InvalidArgumentError(absl::StrCat("id ", id, " has the word ", words[i].word,
                                                     ", but the vocabulary ", "of the place index has ", blocks_.size(),
                                                     " words"));
    }
    if (i > 0 && words[i].word <= words[i - 1].word) {
      return absl::InvalidArgumentError(absl::StrCat("the words of id ", id, " are not sorted"));
    }
  }
  const std::uint32_t entry = num_entries_.load(std::memory_order_relaxed);
  if (entry >= kMaxEntries) return absl::ResourceExhaustedError("the place index is full");
  std::atomic<std::uint32_t*>& chunk = id_chunks_[entry / kIdsPerChunk];
  if (chunk.load(std::memory_order_relaxed) == nullptr) {
    chunk.store(new std::uint32_t[kIdsPerChunk], std::memory_order_release);
  }
  chunk.load(std::memory_order_relaxed)[entry % kIdsPerChunk] = id;
  for (const WeightedWord& word : words) Append(word.word, {entry, word.weight});
  num_entries_.store(entry + 1, std::memory_order_release);
  return entry;
}

void InvertedIndex::Append(WordId word, Posting posting) {
  Block* block = blocks_[word].load(std::memory_order_relaxed);
  std::uint32_t size = block == nullptr ? 0 : block->size.load(std::memory_order_relaxed);
  if (block == nullptr || size == block->capacity) {
    auto larger = std::make_unique<Block>();
    larger->older = block;
    larger->capacity = block == nullptr ? 2 : 2 * block->capacity;
    larger->postings = std::make_unique<Posting[]>(larger->capacity);
    block = larger.release();
    size = 0;
    block->postings[0] = posting;
    block->size.store(1, std::memory_order_relaxed);
    blocks_[word].store(block, std::memory_order_release);
    return;
  }
  block->postings[size] = posting;
  block->size.store(size + 1, std::memory_order_release);
}

std::uint32_t InvertedIndex::IdOf(std::uint32_t entry) const {
  return id_chunks_[entry / kIdsPerChunk].load(std::memory_order_acquire)[entry % kIdsPerChunk];
}

std::vector<Candidate> InvertedIndex::Query(const BowVector& words, const QueryOptions& options,
                                            const Counts& counts) const {
  // Words come in ascending order, so the sums do not depend on the order of postings.
  const std::uint32_t size = num_entries();
  std::vector<double> score(size, 0.0);
  std::vector<std::uint32_t> common(size, 0);
  std::vector<std::uint32_t> touched;
  for (const WeightedWord& word : words) {
    if (word.word >= blocks_.size()) continue;
    for (const Block* block = blocks_[word.word].load(std::memory_order_acquire); block != nullptr;
         block = block->older) {
      const std::uint32_t filled = block->size.load(std::memory_order_acquire);
      for (std::uint32_t i = 0; i < filled; ++i) {
        const Posting& posting = block->postings[i];
        if (posting.entry >= size) continue;  // came meanwhile
        if (common[posting.entry]++ == 0) touched.push_back(posting.entry);
        score[posting.entry] += std::min(word.weight, posting.weight);
      }
    }
  }
  if (counts) {
    std::erase_if(touched, [&](std::uint32_t entry) { return !counts(IdOf(entry), entry); });
  }
  if (options.exclude) {
    std::erase_if(touched, [&](std::uint32_t entry) { return options.exclude(IdOf(entry)); });
  }
  std::uint32_t most = 0;
  for (const std::uint32_t entry : touched) most = std::max(most, common[entry]);
  std::vector<Candidate> candidates;
  for (const std::uint32_t entry : touched) {
    if (common[entry] < options.min_common_share * most || score[entry] < options.min_score) continue;
    candidates.push_back({IdOf(entry), score[entry], common[entry]});
  }
  const auto better = [](const Candidate& a, const Candidate& b) {
    return a.score != b.score ? a.score > b.score : a.id < b.id;
  };
  const std::size_t count =
      options.max_results == 0 ? candidates.size() : std::min(options.max_results, candidates.size());
  std::partial_sort(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count), candidates.end(),
                    better);
  candidates.resize(count);
  return candidates;
}

}  // namespace cairn::place
