#include "place/vocabulary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "image/hamming.h"
#include "place/weighing.h"

namespace cairn::place {

double Score(const BowVector& a, const BowVector& b) {
  double score = 0.0;
  auto i = a.begin();
  auto j = b.begin();
  while (i != a.end() && j != b.end()) {
    if (i->word < j->word) {
      ++i;
    } else if (j->word < i->word) {
      ++j;
    } else {
      score += std::min(i->weight, j->weight);
      ++i;
      ++j;
    }
  }
  return score;
}

absl::StatusOr<Vocabulary> Vocabulary::FromNodes(std::span<const Node> nodes, int branching, int depth) {
  if (branching < 2 || branching > kMaxBranching) {
    return absl::InvalidArgumentError(
        absl::StrCat("a vocabulary's branching must be between 2 and ", kMaxBranching, ", not ", branching));
  }
  if (depth < 1 || depth > kMaxDepth) {
    return absl::InvalidArgumentError(
        absl::StrCat("a vocabulary's depth must be between 1 and ", kMaxDepth, ", not ", depth));
  }
  if (nodes.size() < 2 || nodes.size() > kMaxNodes) {
    return absl::InvalidArgumentError(
        absl::StrCat("a vocabulary needs between 2 and ", kMaxNodes, " nodes, not ", nodes.size()));
  }
  // The children of node i are children[begin[i]] .. children[begin[i + 1] - 1].
  std::vector<std::uint32_t> begin(nodes.size() + 1, 0);
  std::vector<int> level(nodes.size(), 0);
  for (std::size_t i = 1; i < nodes.size(); ++i) {
    if (nodes[i].parent >= i) {
      return absl::InvalidArgumentError(
          absl::StrCat("vocabulary node ", i, " names the parent ", nodes[i].parent, ", which is not an earlier node"));
    }
    level[i] = level[nodes[i].parent] + 1;
    if (level[i] > depth) {
      return absl::InvalidArgumentError(
          absl::StrCat("vocabulary node ", i, " is at level ", level[i], ", below the depth ", depth));
    }
    if (++begin[nodes[i].parent + 1] > static_cast<std::uint32_t>(branching)) {
      return absl::InvalidArgumentError(
          absl::StrCat("vocabulary node ", nodes[i].parent, " has more than ", branching, " children"));
    }
  }
  for (std::size_t i = 1; i < begin.size(); ++i) begin[i] += begin[i - 1];
  std::vector<std::uint32_t> next(begin.begin(), begin.end() - 1);
  std::vector<std::uint32_t> children(nodes.size() - 1);
  for (std::uint32_t i = 1; i < nodes.size(); ++i) children[next[nodes[i].parent]++] = i;

  Vocabulary vocabulary;
  vocabulary.branching_ = branching;
  vocabulary.depth_ = depth;
  std::vector<std::uint32_t> order = {0};
  order.reserve(nodes.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::uint32_t node = order[i];
    const std::uint32_t count = begin[node + 1] - begin[node];
    vocabulary.child_count_.push_back(static_cast<std::uint8_t>(count));
    vocabulary.descriptor_.push_back(node == 0 ? image::Descriptor{} : nodes[node].descriptor);
    for (std::uint32_t j = begin[node]; j < begin[node + 1]; ++j) order.push_back(children[j]);
    if (count == 0) vocabulary.weight_.push_back(nodes[node].weight);
  }
  CAIRN_RETURN_IF_ERROR(vocabulary.Index());
  return vocabulary;
}

absl::Status Vocabulary::Index() {
  CAIRN_RETURN_IF_ERROR(Link());
  hash_ = HashOf(SerializeWithoutChecksum());
  return absl::OkStatus();
}

absl::Status Vocabulary::Link() {
  const std::size_t count = child_count_.size();
  first_child_.assign(count, 0);
  word_of_node_.assign(count, 0);
  std::vector<std::uint8_t> level(count, 0);
  std::size_t next = 1;
  WordId words = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (i >= next) return absl::DataLossError(absl::StrCat("node ", i, " of the vocabulary has no parent"));
    if (child_count_[i] > branching_ || level[i] > depth_) {
      return absl::DataLossError(absl::StrCat("node ", i, " of the vocabulary does not fit a tree of branching ",
                                              branching_, " and depth ", depth_));
    }
    first_child_[i] = static_cast<NodeId>(next);
    next += child_count_[i];
    if (next > count) return absl::DataLossError(absl::StrCat("the children of vocabulary node ", i, " are missing"));
    std::fill(level.begin() + first_child_[i], level.begin() + static_cast<std::ptrdiff_t>(next),
              static_cast<std::uint8_t>(level[i] + 1));
    if (child_count_[i] == 0) word_of_node_[i] = words++;
  }
  if (words != weight_.size()) {
    return absl::DataLossError(
        absl::StrCat("the vocabulary has ", words, " leaves but ", weight_.size(), " word weights"));
  }
  for (std::size_t word = 0; word < weight_.size(); ++word) {
    if (!std::isfinite(weight_[word]) || weight_[word] < 0.0f) {
      return absl::InvalidArgumentError(
          absl::StrCat("the weight of vocabulary word ", word, " is ", weight_[word], "; it must be 0 or more"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<Vocabulary> Vocabulary::WithWeights(std::vector<float> weights) const {
  Vocabulary result = *this;
  result.weight_ = std::move(weights);
  CAIRN_RETURN_IF_ERROR(result.Index());
  return result;
}

// The first of equally near ones.
NodeId Vocabulary::NearestChild(NodeId node, const image::Descriptor& descriptor) const {
  std::array<std::uint16_t, kMaxBranching> distances;
  const NodeId first = first_child_[node];
  const std::uint32_t count = child_count_[node];
  image::HammingDistances(descriptor, &descriptor_[first], count, distances.data());
  // Distance and position in one number: no branch, which would be guessed wrongly.
  std::uint32_t best = ~std::uint32_t{0};
  for (std::uint32_t i = 0; i < count; ++i) best = std::min(best, std::uint32_t{distances[i]} << 8 | i);
  return first + (best & 0xff);
}

WordId Vocabulary::Lookup(const image::Descriptor& descriptor, int level, NodeId* node_at_level) const {
  NodeId node = 0;
  if (node_at_level) *node_at_level = 0;
  for (int current = 1; child_count_[node] > 0; ++current) {
    node = NearestChild(node, descriptor);
    if (node_at_level && current <= level) *node_at_level = node;
  }
  return word_of_node_[node];
}

std::vector<NodeId> Vocabulary::NodesOfWords(int level) const {
  std::vector<NodeId> at_level(num_nodes(), 0), nodes(num_words(), 0);
  std::vector<int> depth(num_nodes(), 0);
  for (NodeId node = 0; node < num_nodes(); ++node) {  // breadth first: parents come before their children
    if (child_count_[node] == 0) nodes[word_of_node_[node]] = at_level[node];
    for (NodeId child = first_child_[node]; child < first_child_[node] + child_count_[node]; ++child) {
      depth[child] = depth[node] + 1;
      at_level[child] = depth[child] <= level ? child : at_level[node];
    }
  }
  return nodes;
}

std::vector<WordId> Vocabulary::LookupAll(std::span<const image::Descriptor> descriptors, int level,
                                          std::vector<NodeId>* nodes_at_level) const {
  constexpr std::size_t kBlock = 32, kLine = 64 / sizeof(image::Descriptor);
  std::vector<WordId> words(descriptors.size());
  if (nodes_at_level) nodes_at_level->assign(descriptors.size(), 0);
  for (std::size_t begin = 0; begin < descriptors.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, descriptors.size() - begin);
    std::array<NodeId, kBlock> nodes = {};
    bool deeper = true;
    for (int current = 1; deeper; ++current) {
      deeper = false;
      for (std::size_t i = 0; i < count; ++i) {
        if (child_count_[nodes[i]] == 0) continue;
        nodes[i] = NearestChild(nodes[i], descriptors[begin + i]);
        __builtin_prefetch(&child_count_[nodes[i]]);
        __builtin_prefetch(&first_child_[nodes[i]]);
        if (nodes_at_level && current <= level) (*nodes_at_level)[begin + i] = nodes[i];
      }
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t children = child_count_[nodes[i]];
        deeper |= children > 0;
        for (std::size_t c = 0; c < children; c += kLine) __builtin_prefetch(&descriptor_[first_child_[nodes[i]] + c]);
      }
    }
    for (std::size_t i = 0; i < count; ++i) words[begin + i] = word_of_node_[nodes[i]];
  }
  return words;
}

BagOfWords Vocabulary::Transform(std::span<const image::Descriptor> descriptors, int direct_level) const {
  BagOfWords bag;
  bag.direct.reserve(descriptors.size());
  std::vector<NodeId> nodes;
  std::vector<WordId> words = LookupAll(descriptors, direct_level, &nodes);
  for (std::uint32_t i = 0; i < descriptors.size(); ++i) bag.direct.push_back({nodes[i], i});
  std::sort(bag.direct.begin(), bag.direct.end());
  bag.words = Weigh(std::move(words), weight_);
  return bag;
}

}  // namespace cairn::place
