// Whole files: read with a limit, written so that they exist whole or not at all.
#pragma once

#include <cstdint>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn {

inline constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 30;

// The whole file. NotFound, PermissionDenied, InvalidArgument or Unavailable name it: a folder, a device or a pipe is
// no file, and one of more than `max_bytes` is none of its kind.
absl::StatusOr<std::string> ReadWholeFile(const std::string& path, std::uint64_t max_bytes = kMaxFileBytes);

enum class FilePermissions {
  kUsual,      // that the process gives to new files
  kOwnerOnly,  // read and write for its owner, from the first byte on. Written by root it stays with the owner of the
               // file that it replaces, or else becomes that of its folder's
};

// Writes a temporary file in the same folder, syncs it and renames it. A symbolic link stays: what it names is written.
// AlreadyExists if there is a file and not `overwrite`; NotFound if the folder does not exist; InvalidArgument for what
// is no ordinary file; nothing is left behind on failure.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view contents, bool overwrite,
                                 FilePermissions permissions = FilePermissions::kUsual);

// "is a folder", "is a device", "is a pipe", ...; empty for an ordinary file, and where there is nothing.
std::string WhyNoFile(const std::string& path);

}  // namespace cairn
