#include "place/index.h"

#include <algorithm>
#include <new>
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
    for (Block* block = head.load(); block != nullptr;) Block::Delete(std::exchange(block, block->older));
  }
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

absl::Status InvertedIndex::Check(std::uint32_t id, const BowVector& words) const {
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].word >= blocks_.size()) {
      return absl::InvalidArgumentError(absl::StrCat("id ", id, " has the word ", words[i].word,
                                                     ", but the vocabulary of the place index has ", blocks_.size(),
                                                     " words"));
    }
    if (i > 0 && words[i].word <= words[i - 1].word) {
      return absl::InvalidArgumentError(absl::StrCat("the words of id ", id, " are not sorted"));
    }
  }
  return absl::OkStatus();
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
  for (const WeightedWord& word : words) {
    const Posting posting = {entry, word.weight};
    const Block* last = blocks_[word.word].load(std::memory_order_relaxed);
    Append(word.word, std::span(&posting, 1), last == nullptr ? 1 : last->capacity);
  }
  num_entries_.store(entry + 1, std::memory_order_release);
  return entry;
}

absl::StatusOr<std::uint32_t> InvertedIndex::AddAll(std::span<const Entry> entries) {
  const std::uint32_t first = num_entries_.load(std::memory_order_relaxed);
  if (entries.size() > kMaxEntries - first) return absl::ResourceExhaustedError("the place index is full");
  // A counting sort by word; entries come in order under each.
  std::vector<std::uint32_t> end(blocks_.size() + 1, 0);
  for (const Entry& entry : entries) {
    CAIRN_RETURN_IF_ERROR(Check(entry.id, entry.words));
    for (const WeightedWord& word : entry.words) ++end[word.word + 1];
  }
  for (std::size_t word = 1; word < end.size(); ++word) end[word] += end[word - 1];
  std::vector<Posting> sorted(end.back());
  for (std::uint32_t i = 0; i < entries.size(); ++i) {
    SetId(first + i, entries[i].id);
    for (const WeightedWord& word : entries[i].words) sorted[end[word.word]++] = {first + i, word.weight};
  }
  for (std::size_t begin = 0, word = 0; word < blocks_.size(); begin = end[word++]) {
    Append(static_cast<WordId>(word), std::span(sorted).subspan(begin, end[word] - begin), 0);
  }
  num_entries_.store(first + static_cast<std::uint32_t>(entries.size()), std::memory_order_release);
  return first;
}

void InvertedIndex::Append(WordId word, std::span<const Posting> postings, std::uint32_t more) {
  Block* block = blocks_[word].load(std::memory_order_relaxed);
  while (!postings.empty()) {
    std::uint32_t size = block == nullptr ? 0 : block->size.load(std::memory_order_relaxed);
    const bool full = block == nullptr || size == block->capacity;
    if (full) {
      block = Block::New(static_cast<std::uint32_t>(postings.size()) + more, block);
      size = 0;
    }
    const std::size_t count = std::min<std::size_t>(postings.size(), block->capacity - size);
    std::ranges::copy(postings.first(count), block->postings() + size);
    block->size.store(size + static_cast<std::uint32_t>(count), std::memory_order_release);
    if (full) blocks_[word].store(block, std::memory_order_release);
    postings = postings.subspan(count);
  }
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
        const Posting& posting = block->postings()[i];
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
