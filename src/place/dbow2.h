// Import of vocabularies in DBoW2's text form for ORB, e.g. the one published with ORB-SLAM.
//
// First line `k L scoring weighting`, then a line per node, parents before children:
// `parent is_leaf b0 ... b31 weight`. The n-th of them (from 1) is node n; node 0 is the root. Scoring and weighting
// must be 0 0 (L1, tf-idf), the only ones Cairn uses.
#pragma once

#include <istream>
#include <string>

#include "base/status.h"
#include "place/vocabulary.h"

namespace cairn::place {

// InvalidArgument naming `name` and the line, and what was expected there.
absl::StatusOr<Vocabulary> ImportDbow2Text(std::istream& in, const std::string& name);
absl::StatusOr<Vocabulary> ImportDbow2TextFile(const std::string& path);

}  // namespace cairn::place
