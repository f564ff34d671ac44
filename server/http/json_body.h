// Messages of cairn.v1 as JSON, the way they come in over HTTP.
#pragma once

#include <google/protobuf/message.h>

#include <string>

#include "base/status.h"

namespace cairn::server {

// InvalidArgument says what is wrong in terms of the JSON: where it ends to be any, a field that there is not with
// those that there are, or a value that is none.
absl::Status ReadJsonMessage(const std::string& body, google::protobuf::Message* message);

}  // namespace cairn::server
