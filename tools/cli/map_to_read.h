// The map that a verb looks into: a file of this machine, or, with --server, the newest revision of a map there. Of a
// server the file is fetched as a whole, so that the same code answers with the same words; it is gone with this
// object, and when a signal ends the process.
#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "cli/server_option.h"

namespace cairn::cli {

class MapToRead {
 public:
  // `map`: a file, or its name at the server. Errors of the server come as they are; ResourceExhausted if the temporary
  // folder (TMPDIR) has no room for it.
  static absl::StatusOr<MapToRead> Open(const ServerChoice& server, const std::string& map);

  MapToRead(MapToRead&& other) noexcept;
  MapToRead& operator=(MapToRead&&) = delete;
  ~MapToRead();

  // Of the file to be opened; `map` itself without a server.
  const std::string& path() const { return path_; }

 private:
  explicit MapToRead(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::string folder_;  // a temporary one, which this has made; else empty
};

// A message that may name the file of a map that was fetched: by the name that the map has at the server.
std::string NamedAsServed(absl::string_view message);

// Tells of changes in the log of a map of this machine that are passed over as it is damaged there; nothing of others.
// For verbs that do not tell all notes of the map.
void TellLogDamage(const std::string& verb, const ServerChoice& server, const std::string& map);

// `map` where it is a file of this machine, for checks of outputs against inputs; else empty.
std::string InputFile(const ServerChoice& server, const std::string& map);

}  // namespace cairn::cli
