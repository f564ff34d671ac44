#include "tracking/place_index.h"

#include <algorithm>
#include <limits>
#include <mutex>
#include <utility>

namespace cairn::tracking {
namespace {

constexpr place::NodeId kUnknownNode = std::numeric_limits<place::NodeId>::max();
// Entries of the shared index over keyframes in the map, and beside that, from which on it is built anew.
constexpr std::size_t kMaxGoneShare = 3;
constexpr std::size_t kMaxGone = 200;

// tf-idf of the words of one image, L1-normalised: each word's count times its weight. `words` is in any order.
place::BowVector Weigh(const place::Vocabulary& vocabulary, std::vector<place::WordId> words) {
  std::sort(words.begin(), words.end());
  place::BowVector bow;
  double sum = 0.0;
  for (std::size_t i = 0; i < words.size();) {
    std::size_t end = i;
    while (end < words.size() && words[end] == words[i]) ++end;
    const double weight = static_cast<double>(end - i) * vocabulary.weight(words[i]);
    if (weight > 0.0) bow.push_back({words[i], static_cast<float>(weight)});
    sum += weight;
    i = end;
  }
  for (place::WeightedWord& word : bow) word.weight = static_cast<float>(word.weight / sum);
  return bow;
}

}  // namespace

// What the indices of all revisions have in common: it only grows.
class PlaceIndex::Shared {
 public:
  Shared(std::shared_ptr<const place::Vocabulary> words, int level)
      : vocabulary(std::move(words)),
        direct_level(level),
        index(vocabulary->num_words()),
        node_of_word_(vocabulary->num_words(), kUnknownNode) {}

  absl::StatusOr<std::shared_ptr<const Entry>> Add(const map::Keyframe& keyframe) {
    const std::lock_guard lock(mutex_);
    const auto& descriptors = keyframe.descriptors();
    std::vector<place::WordId> words = keyframe.features->words;
    const bool known = words.size() == descriptors.size();
    if (!known) words.assign(descriptors.size(), 0);
    auto entry = std::make_shared<Entry>();
    entry->nodes.resize(descriptors.size());
    for (std::size_t i = 0; i < descriptors.size(); ++i) {
      if (known && words[i] >= node_of_word_.size()) {
        return absl::DataLossError(absl::StrCat("place index: keyframe ", keyframe.id.value(), " has word ", words[i],
                                                ", but the vocabulary has ", node_of_word_.size()));
      }
      if (!known || node_of_word_[words[i]] == kUnknownNode) {
        place::NodeId node = 0;
        const place::WordId word = vocabulary->Lookup(descriptors[i], direct_level, &node);
        if (!known) words[i] = word;
        node_of_word_[words[i]] = node;
      }
      entry->nodes[i] = node_of_word_[words[i]];
    }
    CAIRN_ASSIGN_OR_RETURN(entry->number, index.Add(keyframe.id.value(), Weigh(*vocabulary, std::move(words))));
    return entry;
  }

  const std::shared_ptr<const place::Vocabulary> vocabulary;
  const int direct_level;
  place::InvertedIndex index;

 private:
  std::mutex mutex_;                         // of those who add
  std::vector<place::NodeId> node_of_word_;  // as far as met; kUnknownNode otherwise
};

absl::StatusOr<PlaceIndex> PlaceIndex::Build(std::shared_ptr<const place::Vocabulary> vocabulary,
                                             const map::Snapshot& map, int direct_level) {
  if (vocabulary == nullptr) return absl::InvalidArgumentError("place index: no vocabulary given");
  if (direct_level < 0 || direct_level > vocabulary->depth()) {
    return absl::InvalidArgumentError(absl::StrCat("place index: direct level ", direct_level,
                                                   " is not a level of the vocabulary (0 to ", vocabulary->depth(),
                                                   ")"));
  }
  if (map.info().vocabulary_hash != 0 && map.info().vocabulary_hash != vocabulary->hash()) {
    return absl::FailedPreconditionError(
        "place index: the map's words come from another vocabulary than the one given; use the one in the map");
  }
  PlaceIndex built;
  built.shared_ = std::make_shared<Shared>(std::move(vocabulary), direct_level);
  const map::TableEdit edit;
  absl::Status status;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!status.ok()) return;
    auto entry = built.shared_->Add(*keyframe);
    status = entry.status();
    if (status.ok()) built.entries_.Set(keyframe->id, *std::move(entry), edit);
  });
  CAIRN_RETURN_IF_ERROR(status);
  built.revision_ = map.revision();
  return built;
}

absl::StatusOr<PlaceIndex> PlaceIndex::After(const map::Delta& delta, const map::Snapshot& map) const {
  if (delta.base != revision_ || map.revision() != delta.revision()) {
    return absl::FailedPreconditionError(absl::StrCat("place index: the change leads from revision ", delta.base,
                                                      " to ", delta.revision(), ", the index is of revision ",
                                                      revision_, ", the map of ", map.revision()));
  }
  // What has left the map stays in the shared index until it is most of it.
  if (shared_->index.num_entries() > kMaxGoneShare * map.keyframes().size() + kMaxGone) {
    return Build(shared_->vocabulary, map, shared_->direct_level);
  }
  PlaceIndex next = *this;
  const map::TableEdit edit;
  for (const KeyframeId id : delta.removed_keyframes) next.entries_.Set(id, nullptr, edit);
  // The descriptors of a keyframe never change; only new ones matter.
  for (const auto& keyframe : delta.keyframes) {
    if (next.entries_.Contains(keyframe->id)) continue;
    CAIRN_ASSIGN_OR_RETURN(auto entry, shared_->Add(*keyframe));
    next.entries_.Set(keyframe->id, std::move(entry), edit);
  }
  next.revision_ = delta.revision();
  return next;
}

const place::Vocabulary& PlaceIndex::vocabulary() const { return *shared_->vocabulary; }

std::vector<place::Candidate> PlaceIndex::Query(const place::BowVector& words,
                                                const place::QueryOptions& options) const {
  return shared_->index.Query(words, options, [this](std::uint32_t id, std::uint32_t number) {
    const Entry* entry = entries_.Find(KeyframeId(id));
    return entry != nullptr && entry->number == number;
  });
}

std::span<const place::NodeId> PlaceIndex::NodesOf(KeyframeId id) const {
  const Entry* found = entries_.Find(id);
  return found == nullptr ? std::span<const place::NodeId>() : std::span(found->nodes);
}

PlaceIndex::Words PlaceIndex::Transform(std::span<const image::Descriptor> descriptors) const {
  Words result;
  std::vector<place::WordId> words(descriptors.size());
  result.nodes.resize(descriptors.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    words[i] = shared_->vocabulary->Lookup(descriptors[i], shared_->direct_level, &result.nodes[i]);
  }
  result.bow = Weigh(*shared_->vocabulary, std::move(words));
  return result;
}

}  // namespace cairn::tracking
