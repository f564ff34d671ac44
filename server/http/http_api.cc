#include "server/http/http_api.h"

#include <google/protobuf/util/json_util.h>

#include <array>
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

HttpResponse ListMapsOver(const CallContext& context) {
  v1::ListMapsResponse response;
  return Json(Serve(context, "Maps.ListMaps", [&] { return ListMaps(context, {}, &response); }), response);
}

HttpResponse DescribeMapOver(const CallContext& context, const std::string& map) {
  v1::DescribeMapRequest request;
  request.set_map(map);
  v1::DescribeMapResponse response;
  return Json(Serve(context, "Maps.DescribeMap", [&] { return DescribeMap(context, request, &response); }), response);
}

HttpResponse LocalizeOver(const CallContext& context, const std::string& map, const HttpRequest& http) {
  v1::LocalizeImageResponse response;
  const Served served = Serve(context, "Localize.LocalizeImage", [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(v1::LocalizeImageRequest request, ReadLocalizeRequest(http));
    request.set_map(map);
    return LocalizeImage(context, request, &response);
  });
  return Json(served, response);
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
  return {kind.http_status, "application/json", json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

HttpResponse HttpApi::Handle(const HttpRequest& request) const {
  std::string map, allowed;
  for (std::size_t i = 0; i < kRoutes.size(); ++i) {
    if (!Matches(kRoutes[i].path, request.path, &map)) continue;
    if (request.method != kRoutes[i].method && !(request.method == "HEAD" && kRoutes[i].method == "GET")) {
      allowed = std::string(kRoutes[i].method);
      continue;
    }
    switch (static_cast<Target>(i)) {
      case kListMaps:
        return ListMapsOver(context_);
      case kDescribeMap:
        return DescribeMapOver(context_, map);
      case kLocalize:
        return LocalizeOver(context_, map, request);
      case kHealth:
        return Text(200, "ok\n");
      case kReady: {
        const absl::Status ready = hooks_.ready();
        return ready.ok() ? Text(200, "ok\n") : ErrorResponse(absl::UnavailableError(ready.message()), "");
      }
      case kMetrics:
        return {200, "text/plain; version=0.0.4; charset=utf-8", hooks_.metrics()};
      case kDescription:
        return {200, "application/json", OpenApi()};
    }
  }
  if (!allowed.empty()) {
    HttpResponse response = ErrorResponse(absl::InvalidArgumentError(absl::StrCat("this takes ", allowed)), "");
    response.status = 405;
    response.headers.emplace_back("Allow", allowed);
    return response;
  }
  return ErrorResponse(absl::NotFoundError("there is nothing here: /openapi.json says what there is"), "");
}

}  // namespace cairn::server
