// The keyframes of a map, ready to be found by their words: an inverted index, and for each feature the vocabulary node
// under which it is compared. Built from a Snapshot and kept up to date by the Deltas that follow it.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "place/index.h"
#include "place/vocabulary.h"

namespace cairn::tracking {

// Build and Update need exclusive access; const calls may run concurrently.
class PlaceDatabase {
 public:
  // Features are compared when they share the tree node at this level (0: all with all): higher is faster, and loses
  // more of the pairs that the vocabulary's borders separate.
  static constexpr int kDefaultDirectLevel = 2;

  // InvalidArgument: no vocabulary, a bad level. FailedPrecondition: the map was made with another vocabulary.
  static absl::StatusOr<PlaceDatabase> Build(std::shared_ptr<const place::Vocabulary> vocabulary,
                                             const map::Snapshot& map, int direct_level = kDefaultDirectLevel);

  // FailedPrecondition if the delta does not start from revision(); nothing changes then.
  absl::Status Update(const map::Delta& delta);

  Revision revision() const { return revision_; }
  const place::Vocabulary& vocabulary() const { return *vocabulary_; }
  std::size_t size() const { return index_.size(); }

  // Ids of candidates are the values of KeyframeIds.
  std::vector<place::Candidate> Query(const place::BowVector& words, const place::QueryOptions& options) const {
    return index_.Query(words, options);
  }
  // Per feature of the keyframe, its node; empty for a keyframe that is not here.
  std::span<const place::NodeId> NodesOf(KeyframeId id) const;

  // The same two of a query's descriptors.
  struct Words {
    place::BowVector bow;
    std::vector<place::NodeId> nodes;
  };
  Words Transform(std::span<const image::Descriptor> descriptors) const;

 private:
  PlaceDatabase(std::shared_ptr<const place::Vocabulary> vocabulary, int direct_level)
      : vocabulary_(std::move(vocabulary)), direct_level_(direct_level), index_(vocabulary_->num_words()) {}

  absl::Status Add(const map::Keyframe& keyframe);

  std::shared_ptr<const place::Vocabulary> vocabulary_;
  int direct_level_ = 0;
  Revision revision_ = 0;
  place::InvertedIndex index_;
  std::unordered_map<KeyframeId, std::vector<place::NodeId>> nodes_;
  std::vector<place::NodeId> node_of_word_;  // as far as met; kUnknownNode otherwise
};

}  // namespace cairn::tracking
