// A name for what a map contains: equal for equal content, whoever made it, when, in how many steps, and however the
// file is laid out.
#pragma once

#include <string>

#include "map/snapshot.h"

namespace cairn::store {

// 32 hex digits: xxHash's XXH3-128 over cameras, sessions, keyframes (poses, features, words, points, tree,
// covisibility), points, ORB parameters, vocabulary hash and world_from_map, in order of id. Left out: the map's id,
// name, revision and next free ids, software versions, settings and wall-clock times.
std::string ContentDigest(const map::Snapshot& snapshot);

}  // namespace cairn::store
