// Hierarchical binary vocabulary: a tree of binary medians whose leaves are the words (Galvez-Lopez, Tardos: "Bags of
// binary words for fast place recognition in image sequences", T-RO 2012; the tree: Nister, Stewenius: "Scalable
// recognition with a vocabulary tree", CVPR 2006). An image becomes a sparse vector of tf-idf weights.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/status.h"
#include "image/feature.h"

namespace cairn::place {

using WordId = std::uint32_t;  // 0 .. num_words-1
using NodeId = std::uint32_t;  // 0 is the root

struct WeightedWord {
  WordId word = 0;
  float weight = 0.0f;

  bool operator==(const WeightedWord&) const = default;
};
// Sorted by word, weights positive, their sum 1 (or the vector empty).
using BowVector = std::vector<WeightedWord>;

struct NodeFeature {
  NodeId node = 0;
  std::uint32_t feature = 0;  // index in the Features that were transformed

  auto operator<=>(const NodeFeature&) const = default;
};
// The features under each tree node of one level, sorted by node, then feature. Features of words without weight (seen
// in every training image) are included: they still match.
using DirectIndex = std::vector<NodeFeature>;

// L1 score 1 - |a - b| / 2 of two normalised vectors, in [0, 1] (Nister & Stewenius, eq. 5): the sum of the smaller
// weights.
double Score(const BowVector& a, const BowVector& b);

struct BagOfWords {
  BowVector words;
  DirectIndex direct;
};

// Immutable once made; const calls may run concurrently.
class Vocabulary {
 public:
  // Of a stereo pair's 497 mutual matches, comparing under the nodes of level 1 finds 435 in a sixth of the time, of
  // level 2 361 in a twentieth, of level 3 281 in a fortieth (default vocabulary, 1500 features).
  static constexpr int kDefaultDirectLevel = 2;
  static constexpr int kMaxBranching = 255;
  static constexpr int kMaxDepth = 16;
  static constexpr std::size_t kMaxNodes = std::size_t{1} << 26;

  // One node of the tree while it is put together: children follow their parent, siblings in their final order.
  struct Node {
    NodeId parent = 0;               // an earlier node
    image::Descriptor descriptor{};  // ignored for the root
    float weight = 0.0f;             // idf; used if the node turns out a leaf
  };
  // `nodes[0]` is the root. Renumbers breadth first. InvalidArgument: fewer than 2 nodes, a parent that is not an
  // earlier node, a node with more than `branching` (2 to 255) children, a depth above `depth` (1 to 16), a weight that
  // is negative or not finite.
  static absl::StatusOr<Vocabulary> FromNodes(std::span<const Node> nodes, int branching, int depth);

  // The compact binary form; layout in docs/vocabulary.md. Parse and Load give InvalidArgument if this is no Cairn
  // vocabulary, FailedPrecondition for a newer version, DataLoss if it is truncated or damaged.
  std::string Serialize() const;
  static absl::StatusOr<Vocabulary> Parse(std::string_view bytes);
  // Save replaces the file in one step (temporary file, fsync, rename).
  absl::Status Save(const std::string& path) const;
  static absl::StatusOr<Vocabulary> Load(const std::string& path);

  int branching() const { return branching_; }
  int depth() const { return depth_; }
  std::size_t num_words() const { return weight_.size(); }
  std::size_t num_nodes() const { return first_child_.size(); }
  // xxHash64 of the serialised content: names the content, equal on every machine.
  std::uint64_t hash() const { return hash_; }
  float weight(WordId word) const { return weight_[word]; }

  // The word of one descriptor; `node_at_level`, if given, receives its ancestor at `level` (or the word's own node if
  // that is higher up).
  WordId Lookup(const image::Descriptor& descriptor, int level = 0, NodeId* node_at_level = nullptr) const;

  // The same for many: faster, as memory is waited for once per level and not once per descriptor. `nodes_at_level`, if
  // given, is resized to one per descriptor.
  std::vector<WordId> LookupAll(std::span<const image::Descriptor> descriptors, int level = 0,
                                std::vector<NodeId>* nodes_at_level = nullptr) const;

  // For each word its ancestor at `level`, as of Lookup().
  std::vector<NodeId> NodesOfWords(int level) const;

  // tf-idf weights, L1-normalised, and the direct index at `direct_level` (0: the root, one node for all).
  BagOfWords Transform(std::span<const image::Descriptor> descriptors, int direct_level = kDefaultDirectLevel) const;
  BagOfWords Transform(const image::Features& features, int direct_level = kDefaultDirectLevel) const {
    return Transform(std::span<const image::Descriptor>(features.descriptors), direct_level);
  }

  // The same words and tree with other weights, one per word: idf from another set of images.
  absl::StatusOr<Vocabulary> WithWeights(std::vector<float> weights) const;

 private:
  Vocabulary() = default;
  NodeId NearestChild(NodeId node, const image::Descriptor& descriptor) const;
  // Fills what follows from child_count_ and weight_. DataLoss if the counts do not make a tree of these many nodes and
  // words, InvalidArgument for a bad weight.
  absl::Status Link();
  // The same, and the hash.
  absl::Status Index();
  std::string SerializeWithoutChecksum() const;
  static std::uint64_t HashOf(std::string_view bytes);

  int branching_ = 0;
  int depth_ = 0;
  // By node, breadth first, so that the children of a node are neighbours.
  std::vector<std::uint8_t> child_count_;      // 0: leaf
  std::vector<image::Descriptor> descriptor_;  // [0] is zero
  std::vector<NodeId> first_child_;
  std::vector<WordId> word_of_node_;  // leaves only; in node order
  std::vector<float> weight_;         // by word
  std::uint64_t hash_ = 0;
};

}  // namespace cairn::place
