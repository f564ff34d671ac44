// Writes a file so that it exists whole or not at all.
#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::io {

// Writes a temporary file in the same folder, syncs it and renames it. AlreadyExists if there is a file and not
// `overwrite`; NotFound if the folder does not exist; nothing is left behind on failure.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view contents, bool overwrite);

// The whole file, of up to 1 GiB. NotFound, InvalidArgument or Unavailable name it.
absl::StatusOr<std::string> ReadWholeFile(const std::string& path);

}  // namespace cairn::io
