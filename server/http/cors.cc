#include "server/http/cors.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_split.h"

namespace cairn::server {

absl::Status CorsOptions::Validate() const {
  for (const std::string& origin : origins) {
    if (origin == "*") continue;
    const std::vector<std::string> parts = absl::StrSplit(origin, absl::MaxSplits("://", 1));
    const bool web = parts.size() == 2 && (parts[0] == "https" || parts[0] == "http") && !parts[1].empty();
    if (web && parts[1].find_first_of("/?#@, ") == std::string::npos) continue;
    return absl::InvalidArgumentError(absl::StrCat(
        "cors_origins: \"", origin, "\" is no origin: give https://HOST or https://HOST:PORT without a path, or *"));
  }
  return absl::OkStatus();
}

bool IsAllowedOrigin(const CorsOptions& options, const HttpRequest& request) {
  return !request.origin.empty() && std::ranges::any_of(options.origins, [&](const std::string& origin) {
    return origin == "*" || absl::EqualsIgnoreCase(origin, request.origin);
  });
}

void AddCorsHeaders(const CorsOptions& options, const HttpRequest& request, HttpResponse* response) {
  if (options.origins.empty()) return;
  response->headers.emplace_back("Vary", "Origin");  // whatever keeps answers must not give this one to another page
  if (!IsAllowedOrigin(options, request)) return;
  response->headers.emplace_back("Access-Control-Allow-Origin", request.origin);
  response->headers.emplace_back("Access-Control-Expose-Headers", "X-Request-Id, Retry-After");
}

HttpResponse Preflight(const std::string& methods) {
  HttpResponse response{200, "text/plain", ""};
  response.headers = {{"Access-Control-Allow-Methods", methods},
                      {"Access-Control-Allow-Headers", "Authorization, Content-Type, X-Request-Id"},
                      {"Access-Control-Max-Age", "600"}};
  return response;
}

}  // namespace cairn::server
