#include "tracking/place_database.h"

#include <algorithm>
#include <limits>

namespace cairn::tracking {
namespace {

constexpr place::NodeId kUnknownNode = std::numeric_limits<place::NodeId>::max();

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

absl::StatusOr<PlaceDatabase> PlaceDatabase::Build(std::shared_ptr<const place::Vocabulary> vocabulary,
                                                   const map::Snapshot& map, int direct_level) {
  if (vocabulary == nullptr) return absl::InvalidArgumentError("place database: no vocabulary given");
  if (direct_level < 0 || direct_level > vocabulary->depth()) {
    return absl::InvalidArgumentError(absl::StrCat("place database: direct level ", direct_level,
                                                   " is not a level of the vocabulary (0 to ", vocabulary->depth(),
                                                   ")"));
  }
  if (map.info().vocabulary_hash != 0 && map.info().vocabulary_hash != vocabulary->hash()) {
    return absl::FailedPreconditionError(
        "place database: the map's words come from another vocabulary than the one given; use the one in the map");
  }
  PlaceDatabase database(std::move(vocabulary), direct_level);
  database.node_of_word_.assign(database.vocabulary_->num_words(), kUnknownNode);
  absl::Status status;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (status.ok()) status = database.Add(*keyframe);
  });
  CAIRN_RETURN_IF_ERROR(status);
  database.revision_ = map.revision();
  return database;
}

absl::Status PlaceDatabase::Add(const map::Keyframe& keyframe) {
  const auto& descriptors = keyframe.descriptors();
  std::vector<place::WordId> words = keyframe.features->words;
  const bool known = words.size() == descriptors.size();
  if (!known) words.assign(descriptors.size(), 0);
  std::vector<place::NodeId> nodes(descriptors.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    if (known && words[i] >= node_of_word_.size()) {
      return absl::DataLossError(absl::StrCat("place database: keyframe ", keyframe.id.value(), " has word ", words[i],
                                              ", but the vocabulary has ", node_of_word_.size()));
    }
    if (!known || node_of_word_[words[i]] == kUnknownNode) {
      place::NodeId node = 0;
      const place::WordId word = vocabulary_->Lookup(descriptors[i], direct_level_, &node);
      if (!known) words[i] = word;
      node_of_word_[words[i]] = node;
    }
    nodes[i] = node_of_word_[words[i]];
  }
  CAIRN_RETURN_IF_ERROR(index_.Add(keyframe.id.value(), Weigh(*vocabulary_, std::move(words))));
  nodes_.insert_or_assign(keyframe.id, std::move(nodes));
  return absl::OkStatus();
}

absl::Status PlaceDatabase::Update(const map::Delta& delta) {
  if (delta.base != revision_) {
    return absl::FailedPreconditionError(absl::StrCat("place database: the change starts from revision ", delta.base,
                                                      " but the database is at revision ", revision_));
  }
  for (const KeyframeId id : delta.removed_keyframes) {
    if (nodes_.erase(id) > 0) CAIRN_RETURN_IF_ERROR(index_.Remove(id.value()));
  }
  // The features of a keyframe never change; only new ones matter.
  for (const auto& keyframe : delta.keyframes) {
    if (!nodes_.contains(keyframe->id)) CAIRN_RETURN_IF_ERROR(Add(*keyframe));
  }
  revision_ = delta.revision();
  return absl::OkStatus();
}

std::span<const place::NodeId> PlaceDatabase::NodesOf(KeyframeId id) const {
  const auto found = nodes_.find(id);
  return found == nodes_.end() ? std::span<const place::NodeId>() : std::span(found->second);
}

PlaceDatabase::Words PlaceDatabase::Transform(std::span<const image::Descriptor> descriptors) const {
  Words result;
  std::vector<place::WordId> words(descriptors.size());
  result.nodes.resize(descriptors.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    words[i] = vocabulary_->Lookup(descriptors[i], direct_level_, &result.nodes[i]);
  }
  result.bow = Weigh(*vocabulary_, std::move(words));
  return result;
}

}  // namespace cairn::tracking
