// tf-idf of bags of words (Sivic & Zisserman, "Video Google", ICCV 2003), L1-normalised: how often a word is in an
// image times what it weighs, over the sum of these. Always in this order, so that the same words have the same weights
// to the bit however they are kept.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "place/vocabulary.h"

namespace cairn::place {

// What a word adds to the sum of an image that has it `count` times ...
inline double TermWeight(std::uint32_t count, float idf) { return static_cast<double>(count) * idf; }
// ... and its weight there, of the inverse of that sum.
inline float NormalizedWeight(std::uint32_t count, float idf, float inverse_sum) {
  return static_cast<float>(TermWeight(count, idf)) * inverse_sum;
}

// Of one image. `words`: below idf.size(), in any order, each as often as it is there; those of weight 0 are left out.
BowVector Weigh(std::vector<WordId> words, std::span<const float> idf);

}  // namespace cairn::place
