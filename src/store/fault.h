// What kind of trouble a map file is in, attached to the absl::Status of every error of cairn::store. The command line
// turns it into its exit code.
#pragma once

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::store {

enum class Fault {
  kNone,          // not an error of the store, or one about what the caller asked
  kNotFound,      // there is no such file
  kExists,        // there is one, and overwriting was not asked for
  kNotAMap,       // a directory, an empty file, another kind of file, another program's database
  kDamaged,       // a map that is truncated, or whose content does not match its checksums
  kNewerVersion,  // a map in a format that this software does not know yet
  kBusy,          // another process writes it
  kFull,          // no room left on the disk (or a limit on file sizes); the map is at its last revision
  kReadOnly,      // the file or its folder cannot be written
  kForeignLog,    // beside the map lies a write-ahead log that is not this map's, or of another state of it
  kMoved,         // the file was removed, moved or replaced while it was open
  kIo,            // the operating system failed to read or write
};

// "damaged", "newer_version", ...: what `--json` prints.
absl::string_view FaultName(Fault fault);

// kNone if the status is ok or carries no fault. Annotate() keeps it.
Fault FaultOf(const absl::Status& status);
inline bool IsDamaged(const absl::Status& status) { return FaultOf(status) == Fault::kDamaged; }
inline bool IsNewerVersion(const absl::Status& status) { return FaultOf(status) == Fault::kNewerVersion; }

// A status of the code that belongs to the fault: NotFound, AlreadyExists, InvalidArgument (kNotAMap), DataLoss,
// Unimplemented (kNewerVersion), Unavailable (kBusy), ResourceExhausted (kFull), PermissionDenied (kReadOnly),
// FailedPrecondition (kForeignLog), Aborted (kMoved), Internal (kIo).
absl::Status MakeFault(Fault fault, absl::string_view message);

}  // namespace cairn::store
