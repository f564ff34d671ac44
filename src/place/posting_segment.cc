#include "place/posting_segment.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace cairn::place {

static_assert(std::endian::native == std::endian::little, "numbers of several bytes are taken as they are");

namespace {

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

}  // namespace

// What is packed, part by part, word after word.
class PostingSegment::Packing {
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

PostingSegment::PostingSegment(std::uint32_t first, std::span<const std::span<const WordId>> words_of_entry,
                               std::span<const float> idf)
    : first_(first) {
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
  std::vector<double> sums(words_of_entry.size(), 0.0);
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
        sums[entry] += TermWeight(count, idf[word]);
        if (TermWeight(count, idf[word]) > 0.0) packing.Add(entry, count);
      }
      packing.EndWord();
    }
  }
  bytes_ = SharedBytes(std::move(packing).Finish(idf.size(), sums));
  Index(idf.size()).IgnoreError();  // they are as they should be
}

absl::StatusOr<PostingSegment> PostingSegment::Unpack(std::uint32_t first, std::size_t num_words, SharedBytes bytes) {
  PostingSegment segment;
  segment.first_ = first;
  segment.bytes_ = std::move(bytes);
  CAIRN_RETURN_IF_ERROR(segment.Index(num_words));
  return segment;
}

std::uint32_t PostingSegment::VarintAt(std::uint32_t* at) const {
  std::size_t from = *at;
  std::uint32_t value = 0;
  if (!TakeVarint(bytes_.view(), &from, &value)) return std::numeric_limits<std::uint32_t>::max();
  *at = static_cast<std::uint32_t>(from);
  return value;
}

absl::Status PostingSegment::Index(std::size_t num_words) {
  const std::string_view bytes = bytes_.view();
  std::size_t at = 0;
  std::uint32_t entries = 0, words = 0, postings = 0;
  if (bytes.size() > ~std::uint32_t{0}) return Bad("it is too large");
  if (!TakeVarint(bytes, &at, &entries) || !TakeVarint(bytes, &at, &words) || !TakeVarint(bytes, &at, &postings)) {
    return Bad("it is cut off");
  }
  if (entries > kMaxEntries || words != num_words) return Bad("it is of another vocabulary, or too large");
  if (bytes.size() - at < entries * sizeof(double) + num_words + postings) return Bad("it is cut off");
  inverse_sum_.resize(entries);
  for (float& inverse : inverse_sum_) {
    double sum = 0.0;
    std::memcpy(&sum, bytes.data() + at, sizeof(sum));
    at += sizeof(sum);
    if (!(sum >= 0.0 && std::isfinite(sum))) return Bad("a sum of weights is none");
    inverse = static_cast<float>(1.0 / sum);  // without words none is asked for
  }
  frequencies_.resize(num_words);
  std::uint64_t total = 0;
  for (std::uint16_t& kept : frequencies_) {
    std::uint32_t count = 0;
    if (!TakeVarint(bytes, &at, &count) || count > entries) return Bad("a word is in too many images");
    total += count;
    kept = static_cast<std::uint16_t>(count);
  }
  if (total != postings) return Bad("words are in too many or too few images");
  CAIRN_RETURN_IF_ERROR(IndexGaps(&at));
  return IndexMore(postings, at);
}

// That no posting is of an entry beyond the last is seen where they are read: here it would be most of the work.
absl::Status PostingSegment::IndexGaps(std::size_t* at) {
  const std::string_view bytes = bytes_.view();
  const auto next_far = [&](std::size_t from) { return bytes.find(static_cast<char>(kFar), from); };
  places_.resize(frequencies_.size());
  blocks_.resize((frequencies_.size() + kWordsPerBlock - 1) / kWordsPerBlock + 1);
  std::size_t far = next_far(*at);
  for (std::size_t word = 0; word < frequencies_.size(); ++word) {
    std::uint32_t& block = blocks_[word / kWordsPerBlock];
    if (word % kWordsPerBlock == 0) block = static_cast<std::uint32_t>(*at);
    places_[word].gaps = static_cast<std::uint16_t>(*at - block);
    const std::size_t count = frequencies_[word];
    if (bytes.size() - *at < count) return Bad("it is cut off");
    if (*at + count <= far) {  // hardly a gap takes more than a byte
      *at += count;
      continue;
    }
    for (std::size_t i = 0; i < count; ++i) {
      if (*at >= bytes.size()) return Bad("it is cut off");
      if (static_cast<std::uint8_t>(bytes[(*at)++]) != kFar) continue;
      // The same in more bytes than it needs would not fit into what is kept of where a word begins.
      const std::size_t begin = *at;
      std::uint32_t gap = 0;
      if (!TakeVarint(bytes, at, &gap) || *at - begin > 2) return Bad("it is cut off");
    }
    far = next_far(*at);
  }
  blocks_.back() = static_cast<std::uint32_t>(*at);
  return absl::OkStatus();
}

absl::Status PostingSegment::IndexMore(std::uint32_t num_postings, std::size_t at) {
  const std::string_view bytes = bytes_.view();
  std::uint32_t num_more = 0;
  if (!TakeVarint(bytes, &at, &num_more) || num_more > num_postings) return Bad("it is cut off");
  std::size_t word = 0;
  std::uint64_t begin = 0;  // number of the first posting of the word
  std::uint64_t next = 0;
  for (std::uint32_t i = 0; i < num_more; ++i) {
    std::uint32_t gap = 0, count = 0;
    if (!TakeVarint(bytes, &at, &gap)) return Bad("it is cut off");
    const auto at_count = static_cast<std::uint32_t>(at);
    if (!TakeVarint(bytes, &at, &count)) return Bad("it is cut off");
    const std::uint64_t posting = next + gap;
    if (posting >= num_postings || count < 2) return Bad("a count is out of range");
    for (; posting >= begin + frequencies_[word]; ++word) begin += frequencies_[word];
    if (places_[word].first_more == kNone) {
      places_[word].more = at_count;
      places_[word].first_more = static_cast<std::uint16_t>(posting - begin);
    }
    next = posting + 1;
  }
  return at == bytes.size() ? absl::OkStatus() : Bad("there is more than it says");
}

}  // namespace cairn::place
