#include "place/training.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/random.h"
#include "image/hamming.h"

namespace cairn::place {
namespace {

using image::Descriptor;

// Byte j of entry b is bit j of b: adding entries counts the bits of eight positions at once.
constexpr std::array<std::uint64_t, 256> MakeSpreadTable() {
  std::array<std::uint64_t, 256> table{};
  for (std::uint64_t b = 0; b < 256; ++b) {
    for (int j = 0; j < 8; ++j) table[b] |= ((b >> j) & 1) << (8 * j);
  }
  return table;
}
constexpr std::array<std::uint64_t, 256> kSpread = MakeSpreadTable();

// Counts how often each bit is set; the median of the descriptors added is the majority of each bit.
class BitCounter {
 public:
  void Add(const Descriptor& descriptor) {
    for (std::size_t byte = 0; byte < 32; ++byte) {
      narrow_[byte] += kSpread[(descriptor[byte / 8] >> (8 * (byte % 8))) & 0xFF];
    }
    ++count_;
    if (++pending_ == 255) Flush();
  }
  std::uint32_t count() const { return count_; }
  // A tie gives 0.
  Descriptor Median() {
    Flush();
    Descriptor median{};
    for (std::size_t bit = 0; bit < 256; ++bit) {
      if (2 * static_cast<std::uint64_t>(wide_[bit]) > count_) median[bit / 64] |= std::uint64_t{1} << (bit % 64);
    }
    return median;
  }

 private:
  void Flush() {
    for (std::size_t byte = 0; byte < 32; ++byte) {
      for (std::size_t j = 0; j < 8; ++j) wide_[8 * byte + j] += (narrow_[byte] >> (8 * j)) & 0xFF;
    }
    narrow_.fill(0);
    pending_ = 0;
  }

  std::array<std::uint64_t, 32> narrow_{};  // 8-bit counts, eight per word
  std::array<std::uint32_t, 256> wide_{};
  std::uint32_t count_ = 0;
  int pending_ = 0;
};

// k-means++: each further centre is drawn with a probability that grows with the square of the distance to the nearest
// centre so far. Fewer than k if there are not as many different descriptors.
std::vector<Descriptor> Seed(std::span<const Descriptor> points, int k, Random* random) {
  std::vector<Descriptor> centers = {points[random->Below(points.size())]};
  std::vector<std::uint16_t> nearest(points.size());
  image::HammingDistances(centers[0], points.data(), points.size(), nearest.data());
  std::vector<std::uint16_t> distances(points.size());
  while (static_cast<int>(centers.size()) < k) {
    std::uint64_t sum = 0;
    for (const std::uint64_t d : nearest) sum += d * d;
    if (sum == 0) break;
    std::uint64_t left = random->Below(sum);
    std::size_t chosen = 0;
    for (; chosen + 1 < points.size(); ++chosen) {
      const std::uint64_t square = static_cast<std::uint64_t>(nearest[chosen]) * nearest[chosen];
      if (left < square) break;
      left -= square;
    }
    centers.push_back(points[chosen]);
    image::HammingDistances(centers.back(), points.data(), points.size(), distances.data());
    for (std::size_t i = 0; i < points.size(); ++i) nearest[i] = std::min(nearest[i], distances[i]);
  }
  return centers;
}

struct Clusters {
  std::vector<Descriptor> centers;
  std::vector<std::uint32_t> size;
};

// k-medians. Reorders `points` so that the clusters follow each other.
Clusters Cluster(std::span<Descriptor> points, const TrainingOptions& options, Random* random) {
  std::vector<Descriptor> centers = Seed(points, options.branching, random);
  std::vector<std::uint8_t> label(points.size(), 255);
  std::vector<std::uint16_t> distances(centers.size());
  std::vector<BitCounter> counters;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    bool changed = false;
    counters.assign(centers.size(), {});
    for (std::size_t i = 0; i < points.size(); ++i) {
      image::HammingDistances(points[i], centers.data(), centers.size(), distances.data());
      const auto best =
          static_cast<std::uint8_t>(std::min_element(distances.begin(), distances.end()) - distances.begin());
      changed |= best != label[i];
      label[i] = best;
      counters[best].Add(points[i]);
    }
    if (!changed) break;
    for (std::size_t c = 0; c < centers.size(); ++c) {
      if (counters[c].count() > 0) centers[c] = counters[c].Median();
    }
  }
  Clusters clusters;
  std::vector<std::size_t> next(centers.size(), 0);
  std::size_t begin = 0;
  for (std::size_t c = 0; c < centers.size(); ++c) {
    next[c] = begin;
    begin += counters[c].count();
    if (counters[c].count() == 0) continue;
    clusters.centers.push_back(centers[c]);
    clusters.size.push_back(counters[c].count());
  }
  std::vector<Descriptor> sorted(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) sorted[next[label[i]]++] = points[i];
  std::copy(sorted.begin(), sorted.end(), points.begin());
  return clusters;
}

std::vector<Vocabulary::Node> BuildTree(std::vector<Descriptor> points, const TrainingOptions& options,
                                        const TrainingProgress& progress) {
  struct Work {
    NodeId node;
    int level;
    std::size_t begin;
    std::size_t size;
  };
  Random random(options.seed);
  std::vector<Vocabulary::Node> nodes(1);
  std::vector<Work> queue = {{0, 0, 0, points.size()}};
  double done = 0.0;
  const double total = static_cast<double>(points.size()) * options.depth;
  for (std::size_t i = 0; i < queue.size(); ++i) {
    const Work work = queue[i];
    const Clusters clusters = Cluster(std::span(points).subspan(work.begin, work.size), options, &random);
    std::size_t begin = work.begin;
    // One cluster only: all alike, so this node stays a leaf. The root always gets a child.
    const bool split = clusters.centers.size() > 1 || work.level == 0;
    for (std::size_t c = 0; split && c < clusters.centers.size(); ++c) {
      nodes.push_back({work.node, clusters.centers[c], 0.0f});
      const bool leaf = work.level + 1 == options.depth || clusters.size[c] == 1;
      if (!leaf) queue.push_back({static_cast<NodeId>(nodes.size() - 1), work.level + 1, begin, clusters.size[c]});
      // The levels that this cluster will never need count as done.
      if (clusters.size[c] == 1) done += options.depth - work.level - 1;
      begin += clusters.size[c];
    }
    done += split ? static_cast<double>(work.size) : static_cast<double>(work.size) * (options.depth - work.level);
    if (progress) progress(std::min(1.0, done / total));
  }
  return nodes;
}

}  // namespace

absl::Status TrainingOptions::Validate() const {
  if (branching < 2 || branching > Vocabulary::kMaxBranching) {
    return absl::InvalidArgumentError(absl::StrCat("vocabulary training: branching is ", branching,
                                                   "; it must be between 2 and ", Vocabulary::kMaxBranching));
  }
  if (depth < 1 || depth > Vocabulary::kMaxDepth) {
    return absl::InvalidArgumentError(
        absl::StrCat("vocabulary training: depth is ", depth, "; it must be between 1 and ", Vocabulary::kMaxDepth));
  }
  if (max_iterations < 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("vocabulary training: max_iterations is ", max_iterations, "; it must be at least 1"));
  }
  return absl::OkStatus();
}

absl::StatusOr<Vocabulary> Train(std::span<const ImageDescriptors> images, const TrainingOptions& options,
                                 const TrainingProgress& progress) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (images.size() < 2) {
    return absl::InvalidArgumentError(absl::StrCat(
        "vocabulary training needs at least two images (many hundreds for a useful vocabulary), not ", images.size()));
  }
  std::size_t total = 0;
  for (const ImageDescriptors& image : images) total += image.size();
  std::vector<Descriptor> points;
  points.reserve(total);
  for (const ImageDescriptors& image : images) points.insert(points.end(), image.begin(), image.end());
  if (std::adjacent_find(points.begin(), points.end(), std::not_equal_to<>()) == points.end()) {
    return absl::InvalidArgumentError(absl::StrCat("vocabulary training needs at least two different descriptors; ",
                                                   images.size(), " images gave ", total, " that are all alike"));
  }
  CAIRN_ASSIGN_OR_RETURN(const Vocabulary tree, Vocabulary::FromNodes(BuildTree(std::move(points), options, progress),
                                                                      options.branching, options.depth));

  // idf (Galvez-Lopez & Tardos 2012, sec. III): the rarer a word, the more it says.
  std::vector<std::uint32_t> images_with(tree.num_words(), 0);
  std::vector<std::uint32_t> last_image(tree.num_words(), 0);
  for (std::uint32_t i = 0; i < images.size(); ++i) {
    for (const Descriptor& descriptor : images[i]) {
      const WordId word = tree.Lookup(descriptor);
      if (last_image[word] == i + 1) continue;
      last_image[word] = i + 1;
      ++images_with[word];
    }
  }
  std::vector<float> weights(tree.num_words());
  for (std::size_t word = 0; word < weights.size(); ++word) {
    weights[word] = static_cast<float>(
        std::log(static_cast<double>(images.size()) / static_cast<double>(std::max(images_with[word], 1u))));
  }
  return tree.WithWeights(std::move(weights));
}

}  // namespace cairn::place
