// Damage in the write-ahead log of a map that somebody is about to open.
#pragma once

#include <string>

namespace cairn::store {

// For a user: what of the changes in the log of the map at `path` (a file) will be passed over, as bytes of it are not
// as they were written, and what to do. Empty: nothing, or a writer is at work, whose log it is. Nothing is changed,
// and nothing is by who only reads the map.
std::string LogDamageOf(const std::string& path);

}  // namespace cairn::store
