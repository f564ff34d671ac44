// Pictures that several verbs draw.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "eval/ate.h"
#include "geometry/se3.h"
#include "map/snapshot.h"

namespace cairn::cli {

// The map from above, .png or .svg, in the world frame if the map is aligned: points, keyframes coloured by session,
// covisibility, and `queries` (world_from_camera) on top. Replaces the file.
absl::Status DrawMap(const map::Snapshot& map, const std::string& path, const std::vector<SE3>& queries = {});

// A trajectory against its ground truth, coloured by error. Replaces the file.
absl::Status DrawAte(const eval::AteResult& result, const std::vector<io::StampedPose>& groundtruth,
                     const std::string& title, const std::string& path);

}  // namespace cairn::cli
