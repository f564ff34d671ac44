#include "store/fault.h"

#include <array>
#include <string>

#include "absl/strings/cord.h"

namespace cairn::store {
namespace {

constexpr absl::string_view kPayloadType = "cairn.store.Fault";

struct FaultEntry {
  Fault fault;
  absl::StatusCode code;
  absl::string_view name;
};

constexpr std::array<FaultEntry, 12> kFaults = {{
    {Fault::kNone, absl::StatusCode::kUnknown, "none"},
    {Fault::kNotFound, absl::StatusCode::kNotFound, "not_found"},
    {Fault::kExists, absl::StatusCode::kAlreadyExists, "exists"},
    {Fault::kNotAMap, absl::StatusCode::kInvalidArgument, "not_a_map"},
    {Fault::kDamaged, absl::StatusCode::kDataLoss, "damaged"},
    {Fault::kNewerVersion, absl::StatusCode::kUnimplemented, "newer_version"},
    {Fault::kBusy, absl::StatusCode::kUnavailable, "busy"},
    {Fault::kFull, absl::StatusCode::kResourceExhausted, "full"},
    {Fault::kReadOnly, absl::StatusCode::kPermissionDenied, "read_only"},
    {Fault::kForeignLog, absl::StatusCode::kFailedPrecondition, "foreign_log"},
    {Fault::kMoved, absl::StatusCode::kAborted, "moved"},
    {Fault::kIo, absl::StatusCode::kInternal, "io"},
}};

const FaultEntry& EntryOf(Fault fault) {
  for (const FaultEntry& entry : kFaults) {
    if (entry.fault == fault) return entry;
  }
  return kFaults[0];
}

}  // namespace

absl::string_view FaultName(Fault fault) { return EntryOf(fault).name; }

Fault FaultOf(const absl::Status& status) {
  const absl::optional<absl::Cord> payload = status.GetPayload(kPayloadType);
  if (!payload) return Fault::kNone;
  for (const FaultEntry& entry : kFaults) {
    if (*payload == entry.name) return entry.fault;
  }
  return Fault::kNone;
}

absl::Status MakeFault(Fault fault, absl::string_view message) {
  const FaultEntry& entry = EntryOf(fault);
  absl::Status status(entry.code, message);
  if (fault != Fault::kNone) status.SetPayload(kPayloadType, absl::Cord(entry.name));
  return status;
}

}  // namespace cairn::store
