// Errors are values: absl::Status with what was wrong, where, and what to do.
#pragma once

#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

namespace cairn {

// The same status, payloads included, with `context` in front of its message ("reading kitchen.cairn: ...").
inline absl::Status Annotate(const absl::Status& status, absl::string_view context) {
  if (status.ok()) return status;
  absl::Status annotated(status.code(), absl::StrCat(context, ": ", status.message()));
  status.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) { annotated.SetPayload(url, payload); });
  return annotated;
}

}  // namespace cairn

#define CAIRN_RETURN_IF_ERROR(expression)                                                  \
  do {                                                                                     \
    if (absl::Status cairn_status = (expression); !cairn_status.ok()) return cairn_status; \
  } while (false)

#define CAIRN_CONCAT_INNER(a, b) a##b
#define CAIRN_CONCAT(a, b) CAIRN_CONCAT_INNER(a, b)
#define CAIRN_ASSIGN_OR_RETURN_IMPL(result, lhs, expression) \
  auto result = (expression);                                \
  if (!result.ok()) return result.status();                  \
  lhs = std::move(result).value()
// CAIRN_ASSIGN_OR_RETURN(auto map, Load(path));
#define CAIRN_ASSIGN_OR_RETURN(lhs, expression) \
  CAIRN_ASSIGN_OR_RETURN_IMPL(CAIRN_CONCAT(cairn_result_, __LINE__), lhs, expression)
