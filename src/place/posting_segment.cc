#include "place/posting_segment.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

namespace cairn::place {

static_assert(std::endian::native == std::endian::little, "numbers of several bytes are taken as they are");

namespace {

// Instead of how many entries were passed over, if they are so many or more: then the number follows.
constexpr std::uint8_t kFar = 255;
constexpr std::uint32_t kEntryBits = 10;
constexpr std::uint32_t kEntryMask = PostingSegment::kMaxEntries - 1;
static_assert(PostingSegment::kMaxEntries == 1u << kEntryBits);

void AppendVarint(std::string* out, std::uint32_t value) {
  for (; value >= 0x80; value >>= 7) out->push_back(static_cast<char>(value | 0x80));
  out->push_back(static_cast<char>(value));
}

// Reads a number and goes on behind it; false beyond the end.
bool TakeVarint(std::string_view bytes, std::size_t* at, std::uint32_t* value) {
  if (*at >= bytes.size()) return false;
  *value = static_cast<std::uint8_t>(bytes[(*at)++]);
  if (*value < 0x80) return true;
  *value &= 0x7f;
  for (int shift = 7; shift < 35 && *at < bytes.size(); shift += 7) {
    const auto byte = static_cast<std::uint8_t>(bytes[(*at)++]);
    *value |= static_cast<std::uint32_t>(byte & 0x7f) << shift;
    if (byte < 0x80) return true;
  }
  return false;
}

absl::Status Bad(const char* what) { return absl::DataLossError(absl::StrCat("place index: ", what)); }

// What is packed, part by part, word after word.
class Packing {
 public:
  // The entries of a word, ascending, each with how often it has it.
  void Add(std::uint32_t entry, std::uint32_t count) {
    if (entry - next_ < kFar) {
      gaps_.push_back(static_cast<char>(entry - next_));
    } else {
      gaps_.push_back(static_cast<char>(kFar));
      AppendVarint(&gaps_, entry - next_);
    }
    next_ = entry + 1;
    ++num_entries_of_word_;
    const std::uint32_t posting = num_postings_++;
    if (count == 1) return;
    AppendVarint(&more_, posting - next_more_);
    AppendVarint(&more_, count);
    next_more_ = posting + 1;
    ++num_more_;
  }
  void EndWord() {
    AppendVarint(&counts_, num_entries_of_word_);
    next_ = num_entries_of_word_ = 0;
  }

  // A byte a word, nearly always: what is read at every opening must not be decided number by number. What is there
  // more than once is little, and follows by itself.
  std::string Finish(std::size_t num_words, std::span<const double> sums) && {
    std::string out;
    out.reserve(counts_.size() + gaps_.size() + more_.size() + sums.size_bytes() + 20);
    AppendVarint(&out, static_cast<std::uint32_t>(sums.size()));
    AppendVarint(&out, static_cast<std::uint32_t>(num_words));
    AppendVarint(&out, num_postings_);
    out.append(reinterpret_cast<const char*>(sums.data()), sums.size_bytes());
    out += counts_;
    out += gaps_;
    AppendVarint(&out, num_more_);
    out += more_;
    return out;
  }

 private:
  std::string counts_, gaps_, more_;
  std::uint32_t next_ = 0, num_entries_of_word_ = 0, num_postings_ = 0;
  std::uint32_t next_more_ = 0, num_more_ = 0;
};

}  // namespace

PostingSegment::PostingSegment(std::uint32_t first, std::span<const std::span<const WordId>> words_of_entry,
                               std::span<const float> idf)
    : first_(first), sum_(words_of_entry.size(), 0.0) {
  // Sorted by word in two passes that each write to few places at once, by the upper bits and then by the lower ones.
  // Entries stay in their order, so that a word that an entry has several times is in one run.
  constexpr int kLowBits = 9;
  constexpr std::uint32_t kLows = 1u << kLowBits;
  std::vector<std::uint32_t> bucket(idf.size() / kLows + 2, 0);  // begins, once they are summed
  for (const std::span<const WordId> words : words_of_entry) {
    for (const WordId word : words) ++bucket[word / kLows + 1];
  }
  for (std::size_t i = 1; i < bucket.size(); ++i) bucket[i] += bucket[i - 1];
  std::vector<std::uint32_t> by_bucket(bucket.back());  // the lower bits of the word above those of the entry
  {
    std::vector<std::uint32_t> next = bucket;
    for (std::uint32_t entry = 0; entry < words_of_entry.size(); ++entry) {
      for (const WordId word : words_of_entry[entry]) {
        by_bucket[next[word / kLows]++] = (word % kLows) << kEntryBits | entry;
      }
    }
  }

  Packing packing;
  std::vector<std::uint16_t> sorted;
  for (std::size_t b = 0; b + 1 < bucket.size(); ++b) {
    const std::span<const std::uint32_t> items(by_bucket.data() + bucket[b], bucket[b + 1] - bucket[b]);
    std::array<std::uint32_t, kLows> end{};  // begins, until all items are sorted
    for (const std::uint32_t item : items) ++end[item >> kEntryBits];
    std::uint32_t total = 0;
    for (std::uint32_t& count : end) total += std::exchange(count, total);
    sorted.resize(items.size());
    for (const std::uint32_t item : items) {
      sorted[end[item >> kEntryBits]++] = static_cast<std::uint16_t>(item & kEntryMask);
    }
    std::uint32_t i = 0;
    for (std::uint32_t low = 0; low < kLows && b * kLows + low < idf.size(); ++low) {
      const std::size_t word = b * kLows + low;
      while (i < end[low]) {
        const std::uint16_t entry = sorted[i];
        std::uint32_t count = 0;
        for (; i < end[low] && sorted[i] == entry; ++i) ++count;
        sum_[entry] += TermWeight(count, idf[word]);
        if (TermWeight(count, idf[word]) > 0.0) packing.Add(entry, count);
      }
      packing.EndWord();
    }
  }
  bytes_ = std::move(packing).Finish(idf.size(), sum_);
  Index(idf.size()).IgnoreError();  // they are as they should be
}

absl::StatusOr<PostingSegment> PostingSegment::Unpack(std::uint32_t first, std::size_t num_words,
                                                      std::string_view bytes) {
  PostingSegment segment;
  segment.first_ = first;
  segment.bytes_ = bytes;
  CAIRN_RETURN_IF_ERROR(segment.Index(num_words));
  return segment;
}

absl::Status PostingSegment::Index(std::size_t num_words) {
  std::size_t at = 0;
  std::uint32_t entries = 0, words = 0, postings = 0;
  if (bytes_.size() > ~std::uint32_t{0}) return Bad("it is too large");
  if (!TakeVarint(bytes_, &at, &entries) || !TakeVarint(bytes_, &at, &words) || !TakeVarint(bytes_, &at, &postings)) {
    return Bad("it is cut off");
  }
  if (entries > kMaxEntries || words != num_words) return Bad("it is of another vocabulary, or too large");
  if (bytes_.size() - at < entries * sizeof(double) + num_words + postings) return Bad("it is cut off");
  sum_.resize(entries);
  if (entries > 0) std::memcpy(sum_.data(), bytes_.data() + at, entries * sizeof(double));
  at += entries * sizeof(double);
  if (!std::ranges::all_of(sum_, [](double sum) { return std::isfinite(sum); })) return Bad("a sum is not finite");
  std::vector<std::uint16_t> counts(num_words);
  std::uint64_t total = 0;
  for (std::uint16_t& kept : counts) {
    std::uint32_t count = 0;
    if (!TakeVarint(bytes_, &at, &count) || count > entries) return Bad("a word is in too many images");
    total += count;
    kept = static_cast<std::uint16_t>(count);
  }
  if (total != postings) return Bad("words are in too many or too few images");
  CAIRN_RETURN_IF_ERROR(IndexGaps(counts, &at));
  return IndexMore(postings, at);
}

absl::Status PostingSegment::IndexGaps(const std::vector<std::uint16_t>& counts, std::size_t* at) {
  within_.resize(counts.size());
  blocks_.resize((counts.size() + kWordsPerBlock - 1) / kWordsPerBlock + 1);
  std::uint32_t posting = 0;
  for (std::size_t word = 0; word < counts.size(); ++word) {
    Block& block = blocks_[word / kWordsPerBlock];
    if (word % kWordsPerBlock == 0) {
      block.gaps = static_cast<std::uint32_t>(*at);
      block.posting = posting;
    }
    within_[word] = {static_cast<std::uint16_t>(*at - block.gaps), static_cast<std::uint16_t>(posting - block.posting)};
    const std::size_t count = counts[word];
    posting += static_cast<std::uint32_t>(count);
    if (bytes_.size() - *at < count) return Bad("it is cut off");
    // All of a word at once, as there is hardly a gap that takes more than a byte.
    const auto* gaps = reinterpret_cast<const std::uint8_t*>(bytes_.data() + *at);
    std::uint32_t sum = 0;
    std::uint8_t most = 0;
    for (std::size_t i = 0; i < count; ++i) sum += gaps[i];
    for (std::size_t i = 0; i < count; ++i) most = std::max(most, gaps[i]);
    if (most < kFar) {
      if (sum + count > sum_.size()) return Bad("an image is out of range");
      *at += count;
      continue;
    }
    std::uint64_t next = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if (*at >= bytes_.size()) return Bad("it is cut off");
      std::uint32_t gap = static_cast<std::uint8_t>(bytes_[(*at)++]);
      // The same in more bytes than it needs would not fit into what is kept of where a word begins.
      const std::size_t begin = *at;
      if (gap == kFar && (!TakeVarint(bytes_, at, &gap) || *at - begin > 2)) return Bad("it is cut off");
      next += gap + std::uint64_t{1};
      if (next > sum_.size()) return Bad("an image is out of range");
    }
  }
  blocks_.back().gaps = static_cast<std::uint32_t>(*at);
  blocks_.back().posting = posting;
  return absl::OkStatus();
}

absl::Status PostingSegment::IndexMore(std::uint32_t num_postings, std::size_t at) {
  std::uint32_t num_more = 0;
  if (!TakeVarint(bytes_, &at, &num_more) || num_more > num_postings) return Bad("it is cut off");
  std::size_t block = 0;
  std::uint32_t from = 0;
  for (std::uint32_t i = 0; i < num_more; ++i) {
    const std::size_t begin = at;
    std::uint32_t gap = 0, count = 0;
    if (!TakeVarint(bytes_, &at, &gap) || !TakeVarint(bytes_, &at, &count)) return Bad("it is cut off");
    const std::uint64_t posting = std::uint64_t{from} + gap;
    if (posting >= num_postings || count < 2) return Bad("a count is out of range");
    // Blocks that end before it have none that is left.
    for (; blocks_[block].posting <= posting && block + 1 < blocks_.size(); ++block) {
      blocks_[block].more = static_cast<std::uint32_t>(begin);
      blocks_[block].more_from = from;
    }
    from = static_cast<std::uint32_t>(posting) + 1;
  }
  for (; block < blocks_.size(); ++block) {
    blocks_[block].more = static_cast<std::uint32_t>(at);
    blocks_[block].more_from = from;
  }
  return at == bytes_.size() ? absl::OkStatus() : Bad("there is more than it says");
}

std::size_t PostingSegment::Read(WordId word, Posting* out) const {
  const Block& block = blocks_[word / kWordsPerBlock];
  const Block& following = blocks_[word / kWordsPerBlock + 1];
  const bool last = word + std::size_t{1} == within_.size() || (word + 1) % kWordsPerBlock == 0;
  std::size_t at = block.gaps + std::size_t{within_[word].gaps};
  const std::size_t end = last ? following.gaps : block.gaps + std::size_t{within_[word + 1].gaps};
  std::size_t count = 0;
  for (std::uint32_t next = 0; at < end; ++next) {
    std::uint32_t gap = static_cast<std::uint8_t>(bytes_[at++]);
    if (gap == kFar) TakeVarint(bytes_, &at, &gap);
    next += gap;
    out[count++] = {next, 1};
  }
  if (count == 0 || block.more == following.more) return count;
  const std::uint32_t posting = block.posting + within_[word].posting;
  std::uint32_t more = block.more_from;
  for (std::size_t from = block.more; from < following.more;) {
    std::uint32_t gap = 0, times = 0;
    TakeVarint(bytes_, &from, &gap);
    TakeVarint(bytes_, &from, &times);
    more += gap;
    if (more >= posting + count) break;
    if (more >= posting) out[more - posting].count = times;
    ++more;
  }
  return count;
}

}  // namespace cairn::place
