// Which web pages may ask this server from a browser: cross-origin resource sharing (the Fetch standard, "HTTP
// extensions"). A browser asks for leave (OPTIONS) before a page of another origin may send what a form could not.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "server/http/message.h"

namespace cairn::server {

struct CorsOptions {
  // As "https://maps.example.org" or "http://localhost:8080"; "*": any. Empty: none, and browsers keep to it.
  std::vector<std::string> origins;

  absl::Status Validate() const;
};

// Whether this is a page's question of another origin that is allowed here.
bool IsAllowedOrigin(const CorsOptions& options, const HttpRequest& request);

// What an answer to a page of an allowed origin needs so that the page may see it; nothing for others.
void AddCorsHeaders(const CorsOptions& options, const HttpRequest& request, HttpResponse* response);

// Leave for `methods` ("GET, POST"), as an answer to OPTIONS. It needs no token: browsers send none with the question.
HttpResponse Preflight(const std::string& methods);

}  // namespace cairn::server
