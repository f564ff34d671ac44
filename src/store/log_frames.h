// The frames of an SQLite write-ahead log, also of a damaged one (https://www.sqlite.org/fileformat2.html, section 4).
// SQLite replays frames up to the last change that is whole, and passes over the rest without a word: also over changes
// that were safe, behind a single bad bit. Here they are told apart.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "store/sqlite.h"

namespace cairn::store {

struct LogFrame {
  std::uint32_t page = 0;  // of the database, from 1
  bool ends_change = false;
  // In the part that SQLite replays, if the change that it is in is whole.
  bool in_order = false;
  // Its own bytes are as they were written. Frames that are not are damaged, or were never written to their end.
  bool intact = false;
  Bytes bytes;  // of the page
};

// Gives `visit` every frame of the newest use of the log at `path`, in order. Frames behind the first that is not in
// order are told intact by the checksum that the frame before them carries. Returns the size of a page; 0 if this is no
// log.
std::uint32_t ForEachLogFrame(const std::string& path, const std::function<void(const LogFrame&)>& visit);

}  // namespace cairn::store
