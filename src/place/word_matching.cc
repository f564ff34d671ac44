#include <algorithm>
#include <utility>
#include <vector>

#include "image/hamming.h"
#include "place/index.h"

namespace cairn::place {
namespace {

// The features of one node that are not masked out.
void Collect(const DirectIndex& direct, std::size_t begin, std::size_t end, std::span<const std::uint8_t> mask,
             std::vector<std::uint32_t>* out) {
  out->clear();
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint32_t feature = direct[i].feature;
    if (mask.empty() || mask[feature]) out->push_back(feature);
  }
}

std::size_t EndOfNode(const DirectIndex& direct, std::size_t begin) {
  std::size_t end = begin;
  while (end < direct.size() && direct[end].node == direct[begin].node) ++end;
  return end;
}

// Matches within one node; every b belongs to one node only, so the mutual check needs no other.
class NodeMatcher {
 public:
  NodeMatcher(const image::Features& a, const image::Features& b, const image::MatchOptions& options)
      : a_(a), b_(b), options_(options) {}

  void Match(const std::vector<std::uint32_t>& in_a, const std::vector<std::uint32_t>& in_b,
             std::vector<image::FeatureMatch>* matches) {
    if (in_a.empty() || in_b.empty()) return;
    descriptors_.clear();
    for (const std::uint32_t j : in_b) descriptors_.push_back(b_.descriptors[j]);
    distances_.resize(in_b.size());
    nearest_.assign(in_b.size(), {257, image::kNoFeature});
    const std::size_t first = matches->size();
    for (const std::uint32_t i : in_a) {
      image::HammingDistances(a_.descriptors[i], descriptors_.data(), descriptors_.size(), distances_.data());
      image::BestTwo best;
      for (std::uint32_t j = 0; j < in_b.size(); ++j) {
        best.Add(j, distances_[j]);
        nearest_[j] = std::min(nearest_[j], {distances_[j], i});
      }
      if (best.Accept(options_.max_distance, options_.max_ratio)) matches->push_back({i, best.index, best.distance});
    }
    std::size_t kept = first;
    for (std::size_t m = first; m < matches->size(); ++m) {
      image::FeatureMatch match = (*matches)[m];
      if (options_.mutual && nearest_[match.b].second != match.a) continue;
      match.b = in_b[match.b];
      (*matches)[kept++] = match;
    }
    matches->resize(kept);
  }

 private:
  const image::Features& a_;
  const image::Features& b_;
  const image::MatchOptions& options_;
  std::vector<image::Descriptor> descriptors_;
  std::vector<std::uint16_t> distances_;
  std::vector<std::pair<std::uint16_t, std::uint32_t>> nearest_;  // by position in b: distance and feature of a
};

}  // namespace

std::vector<image::FeatureMatch> MatchByWords(const image::Features& a, const DirectIndex& direct_a,
                                              const image::Features& b, const DirectIndex& direct_b,
                                              const image::MatchOptions& options, std::span<const std::uint8_t> mask_a,
                                              std::span<const std::uint8_t> mask_b) {
  std::vector<image::FeatureMatch> matches;
  std::vector<std::uint32_t> in_a, in_b;
  NodeMatcher matcher(a, b, options);
  for (std::size_t i = 0, j = 0; i < direct_a.size() && j < direct_b.size();) {
    const std::size_t end_i = EndOfNode(direct_a, i);
    const std::size_t end_j = EndOfNode(direct_b, j);
    const NodeId node_a = direct_a[i].node, node_b = direct_b[j].node;
    if (node_a == node_b) {
      Collect(direct_a, i, end_i, mask_a, &in_a);
      Collect(direct_b, j, end_j, mask_b, &in_b);
      matcher.Match(in_a, in_b, &matches);
    }
    if (node_a <= node_b) i = end_i;
    if (node_b <= node_a) j = end_j;
  }
  std::sort(matches.begin(), matches.end(),
            [](const image::FeatureMatch& p, const image::FeatureMatch& q) { return p.a < q.a; });
  if (options.check_rotation) {
    matches = image::KeepConsistentRotations(a.keypoints, b.keypoints, std::move(matches));
  }
  return matches;
}

}  // namespace cairn::place
