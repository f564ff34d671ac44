// The keyframes of one revision of a map, ready to be found by their words: an inverted index, and for each word the
// vocabulary node under which its features are compared. Never changes; the index of the next revision is made from it
// and the change between, at a cost in proportion to that, and shares the rest with it.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/shared_bytes.h"
#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "map/table.h"
#include "place/index.h"
#include "place/vocabulary.h"

namespace cairn::tracking {

class PlaceIndex {
  class Shared;

 public:
  // Features are compared when they share the tree node at this level (0: all with all): higher is faster, and loses
  // more of the pairs that the vocabulary's borders separate.
  static constexpr int kDefaultDirectLevel = 2;

  // O(map). InvalidArgument: no vocabulary, a bad level. FailedPrecondition: the map was made with another vocabulary.
  static absl::StatusOr<PlaceIndex> Build(std::shared_ptr<const place::Vocabulary> vocabulary, const map::Snapshot& map,
                                          int direct_level = kDefaultDirectLevel);

  // The same from the words of the keyframes alone, one after another, for who reads a map whose features it does not
  // keep.
  class Builder {
   public:
    static absl::StatusOr<Builder> Create(std::shared_ptr<const place::Vocabulary> vocabulary,
                                          int direct_level = kDefaultDirectLevel);
    // One word per feature.
    absl::Status Add(KeyframeId keyframe, const std::vector<place::WordId>& words);
    // Those that were packed before (place::PostingSegment), in the order of the entries; none where a keyframe has
    // left the map since. DataLoss if the bytes are of others, or a keyframe came before.
    absl::Status AddSegment(std::span<const KeyframeId> keyframes, SharedBytes packed);
    // Errors as of After(); FailedPrecondition if these are not the keyframes of the map, or its words are of another
    // vocabulary.
    absl::StatusOr<PlaceIndex> Finish(const map::Snapshot& map) &&;

   private:
    friend class PlaceIndex;
    explicit Builder(std::shared_ptr<Shared> shared);
    absl::Status Flush();

    std::shared_ptr<Shared> shared_;
    std::vector<place::InvertedIndex::Entry> waiting_;
    map::Table<KeyframeId, std::uint32_t> entries_;
    map::TableEdit edit_;
  };

  // The index of `map`, which `delta` has made of the map that this is the index of. FailedPrecondition if it starts
  // from another revision; DataLoss if a keyframe has words that the vocabulary does not. From several threads at once,
  // also beside queries.
  absl::StatusOr<PlaceIndex> After(const map::Delta& delta, const map::Snapshot& map) const;

  Revision revision() const { return revision_; }
  const place::Vocabulary& vocabulary() const;
  std::size_t size() const { return entries_.size(); }

  // As of place::InvertedIndex; ids of candidates are the values of KeyframeIds.
  place::Scores Score(const place::BowVector& words) const;
  std::vector<place::Candidate> Best(const place::Scores& scores, const place::QueryOptions& options) const;
  std::vector<place::Candidate> Query(const place::BowVector& words, const place::QueryOptions& options) const {
    return Best(Score(words), options);
  }
  // Per feature of the keyframe, its node; empty for a keyframe that is not here.
  std::vector<place::NodeId> NodesOf(const map::Keyframe& keyframe) const;

  // The same two of a query's features.
  struct Words {
    place::BowVector bow;
    std::vector<std::uint8_t> octaves;  // by word of the bag: the coarsest at which the image has it
    std::vector<place::NodeId> nodes;
  };
  Words Transform(const image::Features& features) const;
  // Of a large map by part of the words: faster, not exact (place::InvertedIndex::ScoreBounded).
  place::Scores ScoreBounded(const Words& words) const;

 private:
  PlaceIndex() = default;

  std::shared_ptr<Shared> shared_;                 // by the indices of all revisions
  map::Table<KeyframeId, std::uint32_t> entries_;  // numbers in the inverted index
  Revision revision_ = 0;
};

}  // namespace cairn::tracking
