// The query of a URL, "max_count=20&session=3", as fields of a message.
#pragma once

#include <google/protobuf/message.h>

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::server {

using QueryParameters = std::vector<std::pair<std::string, std::string>>;

// Decoded, in order. InvalidArgument for what is no query.
absl::StatusOr<QueryParameters> ParseQuery(absl::string_view query);

// A part of a path, in which %2D stands for '-'. InvalidArgument for what is no encoding.
absl::StatusOr<std::string> DecodedPath(absl::string_view part);

// Sets the fields of these names: numbers, truth values, texts, and enumerations by name. InvalidArgument for names
// that the message does not have, those in `taken`, values that are none, and what is there twice.
absl::Status SetFields(const QueryParameters& parameters, absl::string_view taken, google::protobuf::Message* message);

}  // namespace cairn::server
