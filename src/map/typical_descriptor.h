// Which of a point's descriptors stands for all of them.
#pragma once

#include <cstddef>
#include <vector>

#include "image/feature.h"

namespace cairn::map {

// The one with the least median distance to the others. Of many, an even sample stands for all: the choice is
// quadratic. Leaves the sample in `descriptors`, of which there must be one.
std::size_t MostTypicalDescriptor(std::vector<image::Descriptor>* descriptors);

}  // namespace cairn::map
