// Training of a vocabulary: hierarchical k-medians over binary descriptors with k-means++ seeding (Arthur,
// Vassilvitskii: "k-means++: the advantages of careful seeding", SODA 2007) on Hamming distance; the median of a
// cluster is the majority of each bit; word weights are idf over the training images (Galvez-Lopez & Tardos 2012).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/status.h"
#include "image/feature.h"
#include "place/vocabulary.h"

namespace cairn::place {

struct TrainingOptions {
  int branching = 10;       // children per node, 2 to 255
  int depth = 5;            // levels below the root, 1 to 16
  int max_iterations = 12;  // of k-medians per node; ends earlier when nothing moves
  std::uint64_t seed = 1;

  absl::Status Validate() const;
};

using ImageDescriptors = std::vector<image::Descriptor>;

// Share of the work that is done, in [0, 1], rising.
using TrainingProgress = std::function<void(double)>;

// One entry of `images` per training image. The result depends on the input and the options only. InvalidArgument: bad
// options, fewer than two different descriptors.
absl::StatusOr<Vocabulary> Train(std::span<const ImageDescriptors> images, const TrainingOptions& options = {},
                                 const TrainingProgress& progress = nullptr);

}  // namespace cairn::place
