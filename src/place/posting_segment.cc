#include "place/posting_segment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

namespace cairn::place {

PostingSegment::PostingSegment(std::uint32_t first, std::span<const std::span<const WordId>> words_of_entry,
                               std::span<const float> idf)
    : first_(first), begin_(idf.size() + 1), sum_(words_of_entry.size(), 0.0) {
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

  postings_.reserve(by_bucket.size());
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
      begin_[word] = static_cast<std::uint32_t>(postings_.size());
      while (i < end[low]) {
        const std::uint16_t entry = sorted[i];
        std::uint32_t count = 0;
        for (; i < end[low] && sorted[i] == entry; ++i) ++count;
        sum_[entry] += TermWeight(count, idf[word]);
        if (!(TermWeight(count, idf[word]) > 0.0)) continue;
        if (count >= kMany) many_.emplace(static_cast<std::uint32_t>(postings_.size()), count);
        postings_.push_back(static_cast<std::uint16_t>(std::min(count, kMany) << kEntryBits | entry));
      }
    }
  }
  begin_.back() = static_cast<std::uint32_t>(postings_.size());
  postings_.shrink_to_fit();
}

namespace {

// Instead of how many entries were passed over, if they are so many or more: then the number follows.
constexpr std::uint32_t kFar = 255;

void AppendVarint(std::string* out, std::uint32_t value) {
  for (; value >= 0x80; value >>= 7) out->push_back(static_cast<char>(value | 0x80));
  out->push_back(static_cast<char>(value));
}

// Reads numbers one after another; once beyond the end it stays there.
class Numbers {
 public:
  explicit Numbers(std::string_view bytes) : at_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  bool Varint(std::uint32_t* value) {
    if (at_ == end_) return false;
    *value = static_cast<std::uint8_t>(*at_++);
    if (*value < 0x80) return true;
    *value &= 0x7f;
    for (int shift = 7; shift < 35 && at_ != end_; shift += 7) {
      const auto byte = static_cast<std::uint8_t>(*at_++);
      *value |= static_cast<std::uint32_t>(byte & 0x7f) << shift;
      if (byte < 0x80) return true;
    }
    return false;
  }
  bool Byte(std::uint32_t* value) {
    if (at_ == end_) return false;
    *value = static_cast<std::uint8_t>(*at_++);
    return true;
  }
  bool Double(double* value) {
    if (end_ - at_ < static_cast<std::ptrdiff_t>(sizeof(*value))) return false;
    std::memcpy(value, at_, sizeof(*value));
    at_ += sizeof(*value);
    return true;
  }
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }

 private:
  const char* at_;
  const char* end_;
};

}  // namespace

std::string PostingSegment::Pack() const {
  const std::size_t num_words = begin_.size() - 1;
  std::string out;
  out.reserve(num_words + postings_.size() * 5 / 4 + sum_.size() * sizeof(double) + 16);
  AppendVarint(&out, num_entries());
  AppendVarint(&out, static_cast<std::uint32_t>(num_words));
  AppendVarint(&out, static_cast<std::uint32_t>(postings_.size()));
  for (const double sum : sum_) out.append(reinterpret_cast<const char*>(&sum), sizeof(sum));
  for (std::size_t word = 0; word < num_words; ++word) AppendVarint(&out, begin_[word + 1] - begin_[word]);
  // A byte each, nearly always: what is read at every opening must not be decided number by number. What is there more
  // than once is little, and follows by itself.
  std::string more;
  std::uint32_t num_more = 0, next_more = 0;
  for (std::size_t word = 0; word < num_words; ++word) {
    std::uint32_t next = 0;
    for (std::uint32_t i = begin_[word]; i < begin_[word + 1]; ++i) {
      const std::uint32_t entry = postings_[i] & kEntryMask;
      std::uint32_t count = postings_[i] >> kEntryBits;
      if (entry - next < kFar) {
        out.push_back(static_cast<char>(entry - next));
      } else {
        out.push_back(static_cast<char>(kFar));
        AppendVarint(&out, entry - next);
      }
      next = entry + 1;
      if (count == 1) continue;
      if (count == kMany) count = many_.at(i);
      AppendVarint(&more, i - next_more);
      AppendVarint(&more, count);
      next_more = i + 1;
      ++num_more;
    }
  }
  AppendVarint(&out, num_more);
  out += more;
  return out;
}

absl::StatusOr<PostingSegment> PostingSegment::Unpack(std::uint32_t first, std::size_t num_words,
                                                      std::string_view bytes) {
  const auto bad = [](const char* what) { return absl::DataLossError(absl::StrCat("place index: ", what)); };
  Numbers numbers(bytes);
  std::uint32_t entries = 0, words = 0, postings = 0;
  if (!numbers.Varint(&entries) || !numbers.Varint(&words) || !numbers.Varint(&postings)) return bad("it is cut off");
  if (entries > kMaxEntries || words != num_words) return bad("it is of another vocabulary, or too large");
  if (numbers.left() < entries * sizeof(double) + num_words + postings) return bad("it is cut off");
  PostingSegment segment;
  segment.first_ = first;
  segment.sum_.resize(entries);
  for (double& sum : segment.sum_) {
    if (!numbers.Double(&sum) || !std::isfinite(sum)) return bad("a sum is not finite");
  }
  segment.begin_.resize(num_words + 1);
  std::uint64_t total = 0;
  for (std::size_t word = 0; word < num_words; ++word) {
    std::uint32_t count = 0;
    if (!numbers.Varint(&count) || count > entries) return bad("a word is in too many images");
    total += count;
    if (total > postings) return bad("words are in too many images");
    segment.begin_[word + 1] = static_cast<std::uint32_t>(total);
  }
  if (total != postings) return bad("words are in too few images");
  segment.postings_.resize(postings);
  for (std::size_t word = 0; word < num_words; ++word) {
    std::uint32_t next = 0;
    for (std::uint32_t i = segment.begin_[word]; i < segment.begin_[word + 1]; ++i) {
      std::uint32_t gap = 0;
      if (!numbers.Byte(&gap) || (gap == kFar && !numbers.Varint(&gap))) return bad("it is cut off");
      const std::uint32_t entry = next + gap;
      if (gap >= entries || entry >= entries) return bad("an image is out of range");
      segment.postings_[i] = static_cast<std::uint16_t>(1u << kEntryBits | entry);
      next = entry + 1;
    }
  }
  std::uint32_t num_more = 0;
  if (!numbers.Varint(&num_more) || num_more > postings) return bad("it is cut off");
  std::uint64_t at = 0;
  for (std::uint32_t i = 0; i < num_more; ++i, ++at) {
    std::uint32_t gap = 0, count = 0;
    if (!numbers.Varint(&gap) || !numbers.Varint(&count)) return bad("it is cut off");
    at += gap;
    if (at >= postings || count < 2) return bad("a count is out of range");
    if (count >= kMany) segment.many_.emplace(static_cast<std::uint32_t>(at), count);
    std::uint16_t& posting = segment.postings_[at];
    posting = static_cast<std::uint16_t>(std::min(count, kMany) << kEntryBits | (posting & kEntryMask));
  }
  if (numbers.left() != 0) return bad("there is more than it says");
  return segment;
}

}  // namespace cairn::place
