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

absl::Status InvertedIndex::Add(std::uint32_t id, BowVector words) {
  if (Contains(id)) return absl::AlreadyExistsError(absl::StrCat("the place index already holds id ", id));
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].word >= postings_.size()) {
      return absl::InvalidArgumentError(absl::StrCat("id ", id, " has the word ", words[i].word,
                                                     ", but the vocabulary ", "of the place index has ",
                                                     postings_.size(), " words"));
    }
    if (i > 0 && words[i].word <= words[i - 1].word) {
      return absl::InvalidArgumentError(absl::StrCat("the words of id ", id, " are not sorted"));
    }
  }
  std::uint32_t slot;
  if (free_slots_.empty()) {
    slot = static_cast<std::uint32_t>(entries_.size());
    entries_.emplace_back();
  } else {
    slot = free_slots_.back();
    free_slots_.pop_back();
  }
  for (const WeightedWord& word : words) postings_[word.word].push_back({slot, word.weight});
  entries_[slot] = {id, true, std::move(words)};
  slot_of_id_.emplace(id, slot);
  return absl::OkStatus();
}

absl::Status InvertedIndex::Remove(std::uint32_t id) {
  const auto found = slot_of_id_.find(id);
  if (found == slot_of_id_.end()) return absl::NotFoundError(absl::StrCat("the place index holds no id ", id));
  const std::uint32_t slot = found->second;
  for (const WeightedWord& word : entries_[slot].words) {
    std::vector<Posting>& postings = postings_[word.word];
    const auto posting =
        std::find_if(postings.begin(), postings.end(), [slot](const Posting& p) { return p.slot == slot; });
    *posting = postings.back();
    postings.pop_back();
  }
  entries_[slot] = {};
  free_slots_.push_back(slot);
  slot_of_id_.erase(found);
  return absl::OkStatus();
}

std::vector<Candidate> InvertedIndex::Query(const BowVector& words, const QueryOptions& options) const {
  // Words come in ascending order, so the sums do not depend on the order of postings.
  std::vector<double> score(entries_.size(), 0.0);
  std::vector<std::uint32_t> common(entries_.size(), 0);
  std::vector<std::uint32_t> touched;
  for (const WeightedWord& word : words) {
    if (word.word >= postings_.size()) continue;
    for (const Posting& posting : postings_[word.word]) {
      if (common[posting.slot]++ == 0) touched.push_back(posting.slot);
      score[posting.slot] += std::min(word.weight, posting.weight);
    }
  }
  if (options.exclude) {
    std::erase_if(touched, [&](std::uint32_t slot) { return options.exclude(entries_[slot].id); });
  }
  std::uint32_t most = 0;
  for (const std::uint32_t slot : touched) most = std::max(most, common[slot]);
  std::vector<Candidate> candidates;
  for (const std::uint32_t slot : touched) {
    if (common[slot] < options.min_common_share * most || score[slot] < options.min_score) continue;
    candidates.push_back({entries_[slot].id, score[slot], common[slot]});
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
