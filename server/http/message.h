// Requests and answers of HTTP, without what carries them.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::server {

struct HttpResponse;

struct HttpRequest {
  std::string method;  // "GET"
  std::string path;    // without the query, not decoded
  std::string content_type;
  std::string body;
  std::string peer = {};           // address of the client
  std::string authorization = {};  // headers, as they are named; empty: not there
  std::string request_id = {};     // X-Request-Id
  std::string origin = {};
  std::string accept = {};  // the header, as it came; empty: none
  std::string content_encoding = {};
  std::string query = {};  // what stands behind the first `?`, not decoded
  // For bodies that are not held in memory: sends the next part of the answer's, its head before the first one, and
  // returns when there is room for another; an error if the client is gone or too slow. Whoever has called it answers
  // with `parts`. Null: parts cannot be sent.
  std::function<absl::Status(const HttpResponse& head, absl::string_view part)> send_part = nullptr;
};

struct HttpResponse {
  int status = 200;
  std::string content_type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers = {};  // further ones
  // The body has gone out in parts: all of it, or not, and then the connection ends in the middle.
  enum class Parts { kNone, kAll, kBroken } parts = Parts::kNone;
};

}  // namespace cairn::server
