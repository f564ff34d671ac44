// Requests and answers of HTTP, without what carries them.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"

namespace cairn::server {

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
};

struct HttpResponse {
  int status = 200;
  std::string content_type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers = {};  // further ones
};

}  // namespace cairn::server
