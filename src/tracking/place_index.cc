#include "tracking/place_index.h"

#include <algorithm>
#include <mutex>
#include <utility>

#include "place/posting_segment.h"
#include "place/weighing.h"

namespace cairn::tracking {
namespace {

// Entries of the shared index over keyframes in the map, and beside that, from which on it is built anew.
constexpr std::size_t kMaxGoneShare = 3;
constexpr std::size_t kMaxGone = 200;
// Keyframes whose words go into the index together when it is built.
constexpr std::size_t kAddedAtOnce = place::PostingSegment::kMaxEntries;

std::vector<float> WeightsOf(const place::Vocabulary& vocabulary) {
  std::vector<float> weights;
  weights.reserve(vocabulary.num_words());
  for (place::WordId word = 0; word < vocabulary.num_words(); ++word) weights.push_back(vocabulary.weight(word));
  return weights;
}

absl::Status CheckVocabulary(const place::Vocabulary& vocabulary, const map::Snapshot& map) {
  if (map.info().vocabulary_hash == 0 || map.info().vocabulary_hash == vocabulary.hash()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      "place index: the map's words come from another vocabulary than the one given; use the one in the map");
}

}  // namespace

// What the indices of all revisions have in common: it only grows.
class PlaceIndex::Shared {
 public:
  Shared(std::shared_ptr<const place::Vocabulary> words, int level)
      : vocabulary(std::move(words)),
        direct_level(level),
        node_of_word(vocabulary->NodesOfWords(level)),
        index(WeightsOf(*vocabulary)) {}

  absl::Status Check(KeyframeId keyframe, const std::vector<place::WordId>& words) const {
    for (const place::WordId word : words) {
      if (word < node_of_word.size()) continue;
      return absl::DataLossError(absl::StrCat("place index: keyframe ", keyframe.value(), " has word ", word,
                                              ", but the vocabulary has ", node_of_word.size()));
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::uint32_t> Add(KeyframeId keyframe, const std::vector<place::WordId>& words) {
    CAIRN_RETURN_IF_ERROR(Check(keyframe, words));
    const place::BowVector bow = place::Weigh(words, index.idf());
    const std::lock_guard lock(mutex_);
    return index.Add(keyframe.value(), bow);
  }

  // Those that the keyframe has, or else would have.
  std::vector<place::WordId> WordsOf(const map::Keyframe& keyframe) const {
    const auto features = keyframe.features.Get();
    if (features->words.size() == features->features.size()) return features->words;
    return vocabulary->LookupAll(features->features.descriptors);
  }

  const std::shared_ptr<const place::Vocabulary> vocabulary;
  const int direct_level;
  const std::vector<place::NodeId> node_of_word;
  place::InvertedIndex index;

 private:
  std::mutex mutex_;  // of those who add
};

PlaceIndex::Builder::Builder(std::shared_ptr<Shared> shared) : shared_(std::move(shared)) {}

absl::StatusOr<PlaceIndex::Builder> PlaceIndex::Builder::Create(std::shared_ptr<const place::Vocabulary> vocabulary,
                                                                int direct_level) {
  if (vocabulary == nullptr) return absl::InvalidArgumentError("place index: no vocabulary given");
  if (direct_level < 0 || direct_level > vocabulary->depth()) {
    return absl::InvalidArgumentError(absl::StrCat("place index: direct level ", direct_level,
                                                   " is not a level of the vocabulary (0 to ", vocabulary->depth(),
                                                   ")"));
  }
  return Builder(std::make_shared<Shared>(std::move(vocabulary), direct_level));
}

absl::Status PlaceIndex::Builder::Add(KeyframeId keyframe, const std::vector<place::WordId>& words) {
  CAIRN_RETURN_IF_ERROR(shared_->Check(keyframe, words));
  waiting_.push_back({keyframe.value(), words});
  return waiting_.size() < kAddedAtOnce ? absl::OkStatus() : Flush();
}

absl::Status PlaceIndex::Builder::AddSegment(std::span<const KeyframeId> keyframes, SharedBytes packed) {
  CAIRN_RETURN_IF_ERROR(Flush());
  std::uint32_t number = shared_->index.num_entries();
  CAIRN_ASSIGN_OR_RETURN(place::PostingSegment segment,
                         place::PostingSegment::Unpack(number, shared_->node_of_word.size(), std::move(packed)));
  std::vector<std::uint32_t> ids;
  ids.reserve(keyframes.size());
  for (const KeyframeId keyframe : keyframes) ids.push_back(keyframe.value());
  if (segment.num_entries() != ids.size()) return absl::DataLossError("place index: a segment is of other keyframes");
  CAIRN_RETURN_IF_ERROR(shared_->index.AddSegment(ids, std::move(segment)));
  for (const KeyframeId keyframe : keyframes) {
    if (keyframe) {
      if (entries_.Contains(keyframe)) return absl::DataLossError("place index: a keyframe is there twice");
      entries_.Set(keyframe, std::make_shared<const std::uint32_t>(number), edit_);
    }
    ++number;
  }
  return absl::OkStatus();
}

absl::Status PlaceIndex::Builder::Flush() {
  if (waiting_.empty()) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(std::uint32_t number, shared_->index.AddAll(waiting_));
  for (const place::InvertedIndex::Entry& entry : waiting_) {
    entries_.Set(KeyframeId(entry.id), std::make_shared<const std::uint32_t>(number++), edit_);
  }
  waiting_.clear();
  return absl::OkStatus();
}

absl::StatusOr<PlaceIndex> PlaceIndex::Builder::Finish(const map::Snapshot& map) && {
  CAIRN_RETURN_IF_ERROR(CheckVocabulary(*shared_->vocabulary, map));
  CAIRN_RETURN_IF_ERROR(Flush());
  if (entries_.size() != map.keyframes().size()) {
    return absl::FailedPreconditionError(absl::StrCat("place index: the words of ", entries_.size(),
                                                      " keyframes were given, the map has ", map.keyframes().size()));
  }
  PlaceIndex built;
  built.shared_ = std::move(shared_);
  built.entries_ = std::move(entries_);
  built.revision_ = map.revision();
  return built;
}

absl::StatusOr<PlaceIndex> PlaceIndex::Build(std::shared_ptr<const place::Vocabulary> vocabulary,
                                             const map::Snapshot& map, int direct_level) {
  CAIRN_ASSIGN_OR_RETURN(Builder builder, Builder::Create(std::move(vocabulary), direct_level));
  CAIRN_RETURN_IF_ERROR(CheckVocabulary(*builder.shared_->vocabulary, map));
  absl::Status status;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (status.ok()) status = builder.Add(keyframe->id, builder.shared_->WordsOf(*keyframe));
  });
  CAIRN_RETURN_IF_ERROR(status);
  return std::move(builder).Finish(map);
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
    CAIRN_ASSIGN_OR_RETURN(const std::uint32_t number, shared_->Add(keyframe->id, shared_->WordsOf(*keyframe)));
    next.entries_.Set(keyframe->id, std::make_shared<const std::uint32_t>(number), edit);
  }
  next.revision_ = delta.revision();
  return next;
}

const place::Vocabulary& PlaceIndex::vocabulary() const { return *shared_->vocabulary; }

place::Scores PlaceIndex::Score(const place::BowVector& words) const { return shared_->index.Score(words); }

place::Scores PlaceIndex::ScoreBounded(const Words& words) const {
  return shared_->index.ScoreBounded(words.bow, words.octaves);
}

std::vector<place::Candidate> PlaceIndex::Best(const place::Scores& scores, const place::QueryOptions& options) const {
  return shared_->index.Best(scores, options, [this](std::uint32_t id, std::uint32_t number) {
    const std::uint32_t* entry = entries_.Find(KeyframeId(id));
    return entry != nullptr && *entry == number;
  });
}

std::vector<place::NodeId> PlaceIndex::NodesOf(const map::Keyframe& keyframe) const {
  std::vector<place::NodeId> nodes;
  if (!entries_.Contains(keyframe.id)) return nodes;
  const auto features = keyframe.features.Get();
  if (features->words.size() != features->features.size()) {
    shared_->vocabulary->LookupAll(features->features.descriptors, shared_->direct_level, &nodes);
    return nodes;
  }
  nodes.reserve(features->words.size());
  for (const place::WordId word : features->words) {
    nodes.push_back(word < shared_->node_of_word.size() ? shared_->node_of_word[word] : 0);
  }
  return nodes;
}

PlaceIndex::Words PlaceIndex::Transform(const image::Features& features) const {
  Words result;
  std::vector<place::WordId> words =
      shared_->vocabulary->LookupAll(features.descriptors, shared_->direct_level, &result.nodes);
  std::vector<std::uint8_t> octave_of_word(shared_->node_of_word.size(), 0);
  for (std::size_t i = 0; i < words.size(); ++i) {
    octave_of_word[words[i]] = std::max(octave_of_word[words[i]], features.keypoints[i].octave);
  }
  result.bow = place::Weigh(std::move(words), shared_->index.idf());
  result.octaves.reserve(result.bow.size());
  for (const place::WeightedWord& word : result.bow) result.octaves.push_back(octave_of_word[word.word]);
  return result;
}

}  // namespace cairn::tracking
