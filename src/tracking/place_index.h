// The keyframes of one revision of a map, ready to be found by their words: an inverted index, and for each feature the
// vocabulary node under which it is compared. Never changes; the index of the next revision is made from it and the
// change between, at a cost in proportion to that, and shares the rest with it.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "map/table.h"
#include "place/index.h"
#include "place/vocabulary.h"

namespace cairn::tracking {

class PlaceIndex {
 public:
  // Features are compared when they share the tree node at this level (0: all with all): higher is faster, and loses
  // more of the pairs that the vocabulary's borders separate.
  static constexpr int kDefaultDirectLevel = 2;

  // O(map). InvalidArgument: no vocabulary, a bad level. FailedPrecondition: the map was made with another vocabulary.
  static absl::StatusOr<PlaceIndex> Build(std::shared_ptr<const place::Vocabulary> vocabulary, const map::Snapshot& map,
                                          int direct_level = kDefaultDirectLevel);

  // The index of `map`, which `delta` has made of the map that this is the index of. FailedPrecondition if it starts
  // from another revision; DataLoss if a keyframe has words that the vocabulary does not. From several threads at once,
  // also beside queries.
  absl::StatusOr<PlaceIndex> After(const map::Delta& delta, const map::Snapshot& map) const;

  Revision revision() const { return revision_; }
  const place::Vocabulary& vocabulary() const;
  std::size_t size() const { return entries_.size(); }

  // Ids of candidates are the values of KeyframeIds.
  std::vector<place::Candidate> Query(const place::BowVector& words, const place::QueryOptions& options) const;
  // Per feature of the keyframe, its node; empty for a keyframe that is not here.
  std::span<const place::NodeId> NodesOf(KeyframeId id) const;

  // The same two of a query's descriptors.
  struct Words {
    place::BowVector bow;
    std::vector<place::NodeId> nodes;
  };
  Words Transform(std::span<const image::Descriptor> descriptors) const;

 private:
  class Shared;
  struct Entry {
    std::uint32_t number = 0;  // in the inverted index
    std::vector<place::NodeId> nodes;
  };

  PlaceIndex() = default;

  std::shared_ptr<Shared> shared_;  // by the indices of all revisions
  map::Table<KeyframeId, Entry> entries_;
  Revision revision_ = 0;
};

}  // namespace cairn::tracking
