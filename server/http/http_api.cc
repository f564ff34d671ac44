#include "server/http/http_api.h"

#include <google/protobuf/util/json_util.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/match.h"
#include "absl/strings/strip.h"
#include "server/http/localize_request.h"
#include "server/rpc/serve.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

using Route = HttpApi::Route;

enum Target { kListMaps, kDescribeMap, kLocalize, kHealth, kReady, kMetrics, kDescription };
constexpr std::array<Route, 7> kRoutes = {{
    {"GET", "/v1/maps"},
    {"GET", "/v1/maps/{map}"},
    {"POST", "/v1/maps/{map}:localize"},
    {"GET", "/healthz"},
    {"GET", "/readyz"},
    {"GET", "/metrics"},
    {"GET", "/openapi.json"},
}};

// What stands where the route has {map}, if the path is one of the route's.
bool Matches(absl::string_view route, absl::string_view path, std::string* map) {
  constexpr absl::string_view kMap = "{map}";
  const std::size_t at = route.find(kMap);
  if (at == absl::string_view::npos) return route == path;
  const absl::string_view suffix = route.substr(at + kMap.size());
  if (!absl::ConsumePrefix(&path, route.substr(0, at)) || !absl::ConsumeSuffix(&path, suffix)) return false;
  if (absl::StrContains(path, '/') || absl::StrContains(path, ':')) return false;
  *map = std::string(path);
  return true;
}

absl::StatusOr<std::string> ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  options.always_print_primitive_fields = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (!status.ok()) return absl::InternalError(absl::StrCat("the answer could not be written: ", status.ToString()));
  return json;
}

HttpResponse Json(const Served& served, const google::protobuf::Message& message) {
  if (!served.status.ok()) return ErrorResponse(served.status, served.request_id);
  const absl::StatusOr<std::string> json = ToJson(message);
  if (!json.ok()) return ErrorResponse(json.status(), served.request_id);
  return {200, "application/json", *json};
}

HttpResponse Text(int status, const std::string& text) { return {status, "text/plain; charset=utf-8", text}; }

Caller CallerOf(const HttpRequest& request) {
  return {request.peer, request.authorization, request.request_id, static_cast<std::int64_t>(request.body.size())};
}

HttpResponse ListMapsOver(const CallContext& server, const Caller& caller) {
  v1::ListMapsResponse response;
  const auto list = [&](const CallContext& context) { return ListMaps(context, {}, &response); };
  return Json(Serve(server, caller, "Maps.ListMaps", list), response);
}

HttpResponse DescribeMapOver(const CallContext& server, const Caller& caller, const std::string& map) {
  v1::DescribeMapRequest request;
  request.set_map(map);
  v1::DescribeMapResponse response;
  const auto describe = [&](const CallContext& context) { return DescribeMap(context, request, &response); };
  return Json(Serve(server, caller, "Maps.DescribeMap", describe), response);
}

HttpResponse LocalizeOver(const CallContext& server, const Caller& caller, const std::string& map,
                          const HttpRequest& http) {
  v1::LocalizeImageResponse response;
  const auto localize = [&](const CallContext& context) -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(v1::LocalizeImageRequest request, ReadLocalizeRequest(http));
    request.set_map(map);
    return LocalizeImage(context, request, &response);
  };
  return Json(Serve(server, caller, "Localize.LocalizeImage", localize), response);
}

}  // namespace

std::span<const Route> HttpApi::Routes() { return kRoutes; }

const std::string& HttpApi::OpenApi() {
  static const std::string text =
#include "openapi_text.inc"
      ;
  return text;
}

HttpResponse ErrorResponse(const absl::Status& status, absl::string_view request_id) {
  const wire::ErrorKind& kind = wire::KindOf(status);
  const nlohmann::ordered_json json = {{"error",
                                        {{"reason", std::string(kind.reason)},
                                         {"message", std::string(status.message())},
                                         {"request_id", std::string(request_id)}}}};
  HttpResponse response{kind.http_status, "application/json",
                        json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
  if (absl::IsUnauthenticated(status)) response.headers.emplace_back("WWW-Authenticate", "Bearer");
  if (const double seconds = wire::RetryAfterOf(status); seconds > 0.0) {
    response.headers.emplace_back("Retry-After", absl::StrCat(static_cast<std::int64_t>(std::ceil(seconds))));
  }
  return response;
}

HttpResponse HttpApi::Handle(const HttpRequest& request) const {
  Caller caller = CallerOf(request);
  caller.request_id = RequestIdOf(caller);
  HttpResponse response = Answer(request, caller);
  response.headers.emplace_back("X-Request-Id", caller.request_id);
  return response;
}

// They name maps: who may read all of them may read them.
HttpResponse HttpApi::MetricsOver(const Caller& caller) const {
  const Served served = Serve(context_, caller, "Http.Metrics", [](const CallContext& context) {
    return context.access == nullptr ? absl::OkStatus() : context.access->Require(*context.client, Right::kRead, "*");
  });
  if (!served.status.ok()) return ErrorResponse(served.status, served.request_id);
  return {200, "text/plain; version=0.0.4; charset=utf-8", hooks_.metrics()};
}

HttpResponse HttpApi::Answer(const HttpRequest& request, const Caller& caller) const {
  const std::string& id = caller.request_id;
  std::string map, allowed;
  for (std::size_t i = 0; i < kRoutes.size(); ++i) {
    if (!Matches(kRoutes[i].path, request.path, &map)) continue;
    if (request.method != kRoutes[i].method && !(request.method == "HEAD" && kRoutes[i].method == "GET")) {
      allowed = std::string(kRoutes[i].method);
      continue;
    }
    switch (static_cast<Target>(i)) {
      case kListMaps:
        return ListMapsOver(context_, caller);
      case kDescribeMap:
        return DescribeMapOver(context_, caller, map);
      case kLocalize:
        return LocalizeOver(context_, caller, map, request);
      case kHealth:
        return Text(200, "ok\n");
      case kReady: {
        const absl::Status ready = hooks_.ready();
        return ready.ok() ? Text(200, "ok\n") : ErrorResponse(absl::UnavailableError(ready.message()), id);
      }
      case kMetrics:
        return MetricsOver(caller);
      case kDescription:
        return {200, "application/json", OpenApi()};
    }
  }
  if (!allowed.empty()) {
    HttpResponse response = ErrorResponse(absl::InvalidArgumentError(absl::StrCat("this takes ", allowed)), id);
    response.status = 405;
    response.headers.emplace_back("Allow", allowed);
    return response;
  }
  return ErrorResponse(absl::NotFoundError("there is nothing here: /openapi.json says what there is"), id);
}

}  // namespace cairn::server
