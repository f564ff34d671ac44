#include "server/http/http_api.h"

#include <google/protobuf/util/json_util.h>

#include <array>
#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "server/http/geopose.h"
#include "server/http/json_body.h"
#include "server/http/localize_request.h"
#include "server/http/query.h"
#include "server/rpc/serve.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

using Route = HttpApi::Route;

// In logs and metrics: what is no call of ours, whatever the client named it.
constexpr absl::string_view kUnknownCall = "unknown";

// What answers a route. `map`: what stands where it has {map}.
struct Call {
  const CallContext& server;
  const HttpHooks& hooks;
  const HttpRequest& http;
  const Caller& caller;
  const CorsOptions& cors;
  std::atomic<int>& exporting;  // at the moment
  std::string map;
};
using AnswerRoute = HttpResponse (*)(const Call& call);

// What stands where the route has {map}, if the path is one of the route's.
bool Matches(absl::string_view route, absl::string_view path, std::string* map) {
  constexpr absl::string_view kMap = "{map}";
  const std::size_t at = route.find(kMap);
  if (at == absl::string_view::npos) return route == path;
  const absl::string_view suffix = route.substr(at + kMap.size());
  if (!absl::ConsumePrefix(&path, route.substr(0, at)) || !absl::ConsumeSuffix(&path, suffix)) return false;
  if (absl::StrContains(path, '/') || absl::StrContains(path, ':')) return false;
  // What is no encoding is no name either, and refused as such.
  *map = DecodedPath(path).value_or(std::string(path));
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

// The message in the body, in JSON; an empty one without a body.
template <class Request>
absl::StatusOr<Request> FromBody(const std::string& body) {
  Request request;
  if (body.empty()) return request;
  CAIRN_RETURN_IF_ERROR(ReadJsonMessage(body, &request));
  return request;
}

// A call of cairn.v1 with the message in the body, and what `fill` adds to it: the field `in_path`, if it is not empty.
template <class Request, class Response, class Fill>
HttpResponse Answered(const Call& call, absl::string_view name,
                      absl::Status (*rpc)(const CallContext&, const Request&, Response*), absl::string_view in_path,
                      Fill&& fill) {
  Response response;
  const Served served = Serve(call.server, call.caller, name, [&](const CallContext& context) -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(Request request, FromBody<Request>(call.http.body));
    CAIRN_ASSIGN_OR_RETURN(const QueryParameters parameters, ParseQuery(call.http.query));
    CAIRN_RETURN_IF_ERROR(SetFields(parameters, in_path, &request));
    CAIRN_RETURN_IF_ERROR(fill(&request));
    return rpc(context, request, &response);
  });
  return Json(served, response);
}

// The map that the path names; a body may name it again.
template <class Request>
absl::Status SetMap(const Call& call, Request* request) {
  if (!request->map().empty() && request->map() != call.map) {
    return absl::InvalidArgumentError("request: the body names another map than the path");
  }
  request->set_map(call.map);
  return absl::OkStatus();
}

template <class Request, class Response>
HttpResponse AnsweredOfMap(const Call& call, absl::string_view name,
                           absl::Status (*rpc)(const CallContext&, const Request&, Response*)) {
  return Answered(call, name, rpc, "map", [&](Request* request) { return SetMap(call, request); });
}

template <class Request, class Response>
HttpResponse AnsweredAsIs(const Call& call, absl::string_view name,
                          absl::Status (*rpc)(const CallContext&, const Request&, Response*)) {
  return Answered(call, name, rpc, "", [](Request*) { return absl::OkStatus(); });
}

HttpResponse LocalizeOver(const Call& call) {
  v1::LocalizeImageResponse response;
  const auto localize = [&](const CallContext& context) -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(v1::LocalizeImageRequest request, ReadLocalizeRequest(call.http));
    CAIRN_RETURN_IF_ERROR(SetMap(call, &request));
    return LocalizeImage(context, request, &response);
  };
  return Json(Serve(call.server, call.caller, "Localize.LocalizeImage", localize), response);
}

HttpResponse LocalizeInMapsOver(const Call& call) {
  v1::LocalizeInMapsResponse response;
  const auto localize = [&](const CallContext& context) -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const v1::LocalizeInMapsRequest request, ReadLocalizeInMapsRequest(call.http));
    return LocalizeInMaps(context, request, &response);
  };
  return Json(Serve(call.server, call.caller, "Localize.LocalizeInMaps", localize), response);
}

HttpResponse Ready(const Call& call) {
  const absl::Status ready = Told(call.server, call.hooks.ready());
  return ready.ok() ? Text(200, "ok\n")
                    : ErrorResponse(absl::UnavailableError(ready.message()), call.caller.request_id);
}

// They name maps: who may read all of them may read them.
HttpResponse MetricsOver(const Call& call) {
  const Served served = Serve(call.server, call.caller, "Http.Metrics", [](const CallContext& context) {
    return context.access == nullptr ? absl::OkStatus() : context.access->Require(*context.client, Right::kRead, "*");
  });
  if (!served.status.ok()) return ErrorResponse(served.status, served.request_id);
  return {200, "text/plain; version=0.0.4; charset=utf-8", call.hooks.metrics()};
}

struct ExportKind {
  absl::string_view name;  // in the query
  v1::ExportMapRequest::Content content;
  absl::string_view suffix, type;
};
constexpr std::array<ExportKind, 3> kExports = {{
    {"map", v1::ExportMapRequest::CONTENT_MAP, ".cairn", "application/vnd.sqlite3"},
    {"trajectory", v1::ExportMapRequest::CONTENT_TRAJECTORY, ".txt", "text/plain; charset=utf-8"},
    {"points", v1::ExportMapRequest::CONTENT_POINTS, ".ply", "application/octet-stream"},
}};

absl::StatusOr<ExportKind> ExportKindOf(absl::string_view query) {
  CAIRN_ASSIGN_OR_RETURN(const QueryParameters parameters, ParseQuery(query));
  if (parameters.empty()) return kExports[0];
  for (const ExportKind& kind : kExports) {
    if (parameters.size() == 1 && parameters[0].first == "content" && parameters[0].second == kind.name) return kind;
  }
  return absl::InvalidArgumentError("query: give content=map, content=trajectory or content=points");
}

class ExportPlace {
 public:
  explicit ExportPlace(std::atomic<int>* exporting) : exporting_(*exporting), before_(exporting_.fetch_add(1)) {}
  ~ExportPlace() { --exporting_; }
  ExportPlace(const ExportPlace&) = delete;
  ExportPlace& operator=(const ExportPlace&) = delete;
  bool taken() const { return before_ < kMaxExports; }

 private:
  static constexpr int kMaxExports = 3;
  std::atomic<int>& exporting_;
  const int before_;
};

// A file of any size: it goes out as it is read, and what goes wrong after the first part ends the connection.
HttpResponse ExportOver(const Call& call) {
  HttpResponse head;
  bool begun = false;
  const Served served =
      Serve(call.server, call.caller, "Admin.ExportMap", [&](const CallContext& context) -> absl::Status {
        CAIRN_ASSIGN_OR_RETURN(const ExportKind kind, ExportKindOf(call.http.query));
        if (!call.http.send_part) return absl::InvalidArgumentError("this is for GET");
        // Each holds one of the threads that work on requests for as long as its client reads.
        const ExportPlace place(&call.exporting);
        if (!place.taken()) return absl::ResourceExhaustedError("too many maps are being exported: ask again later");
        head.content_type = std::string(kind.type);
        head.headers = {{"Content-Disposition", absl::StrCat("attachment; filename=\"", call.map, kind.suffix, "\"")},
                        {"X-Request-Id", call.caller.request_id}};
        AddCorsHeaders(call.cors, call.http, &head);
        v1::ExportMapRequest request;
        request.set_map(call.map);
        request.set_content(kind.content);
        return ExportMap(context, request, [&](const v1::ExportMapResponse& part) {
          begun = true;
          return call.http.send_part(head, part.part()).ok();
        });
      });
  if (!begun) return ErrorResponse(served.status, served.request_id);
  HttpResponse sent;
  sent.parts = served.status.ok() ? HttpResponse::Parts::kAll : HttpResponse::Parts::kBroken;
  return sent;
}

HttpResponse RestoreOver(const Call& call) {
  return Answered(call, "Admin.RestoreMap", RestoreMap, "deleted", [&](v1::RestoreMapRequest* request) -> absl::Status {
    if (!request->deleted().empty() && request->deleted() != call.map) {
      return absl::InvalidArgumentError("request: the body names another deleted map than the path");
    }
    request->set_deleted(call.map);
    return absl::OkStatus();
  });
}

struct RouteAnswer {
  Route route;
  AnswerRoute answer;
};
constexpr std::array<RouteAnswer, 22> kAnswers = {{
    {{"GET", "/v1/maps"}, [](const Call& c) { return AnsweredAsIs(c, "Maps.ListMaps", ListMaps); }},
    {{"POST", "/v1/maps"}, [](const Call& c) { return AnsweredAsIs(c, "Admin.CreateMap", CreateMap); }},
    {{"GET", "/v1/maps/{map}"}, [](const Call& c) { return AnsweredOfMap(c, "Maps.DescribeMap", DescribeMap); }},
    {{"DELETE", "/v1/maps/{map}"}, [](const Call& c) { return AnsweredOfMap(c, "Admin.DeleteMap", DeleteMap); }},
    {{"GET", "/v1/maps/{map}/sessions"},
     [](const Call& c) { return AnsweredOfMap(c, "Sessions.ListSessions", ListSessions); }},
    {{"GET", "/v1/maps/{map}/log"}, [](const Call& c) { return AnsweredOfMap(c, "Admin.ReadLog", ReadLog); }},
    {{"GET", "/v1/maps/{map}:export"}, ExportOver},
    {{"POST", "/v1/maps/{map}:localize"}, LocalizeOver},
    {{"POST", "/v1/maps/{map}:snapshot"},
     [](const Call& c) { return AnsweredOfMap(c, "Admin.SnapshotMap", SnapshotMap); }},
    {{"POST", "/v1/maps/{map}:verify"}, [](const Call& c) { return AnsweredOfMap(c, "Admin.VerifyMap", VerifyMap); }},
    {{"POST", "/v1/maps/{map}:align"}, [](const Call& c) { return AnsweredOfMap(c, "Admin.AlignMap", AlignMap); }},
    {{"POST", "/v1/maps/{map}:removeSession"},
     [](const Call& c) { return AnsweredOfMap(c, "Admin.RemoveSession", RemoveSession); }},
    {{"POST", "/v1/localize"}, LocalizeInMapsOver},
    {{"GET", "/v1/deleted"}, [](const Call& c) { return AnsweredAsIs(c, "Admin.ListDeletedMaps", ListDeletedMaps); }},
    {{"POST", "/v1/deleted/{map}:restore"}, RestoreOver},
    {{"GET", "/v1/status"}, [](const Call& c) { return AnsweredAsIs(c, "Status.GetStatus", GetStatus); }},
    {{"POST", "/geopose"},
     [](const Call& c) { return AnswerGeoPose(c.server, c.caller, c.http, c.hooks.geopose_map); }},
    {{"GET", "/geopose"},
     [](const Call&) {
       return HttpResponse{200, "application/json", R"({"status": "running"})"};
     }},
    {{"GET", "/healthz"}, [](const Call&) { return Text(200, "ok\n"); }},
    {{"GET", "/readyz"}, Ready},
    {{"GET", "/metrics"}, MetricsOver},
    {{"GET", "/openapi.json"},
     [](const Call&) {
       return HttpResponse{200, "application/json", HttpApi::OpenApi()};
     }},
}};

constexpr std::array<Route, kAnswers.size()> kRoutes = [] {
  std::array<Route, kAnswers.size()> routes;
  for (std::size_t i = 0; i < routes.size(); ++i) routes[i] = kAnswers[i].route;
  return routes;
}();

// Bodies that are packed would be looked at before anybody knows how large they are.
bool IsPlain(const HttpRequest& request) {
  const absl::string_view encoding = absl::StripAsciiWhitespace(request.content_encoding);
  return encoding.empty() || absl::EqualsIgnoreCase(encoding, "identity");
}

// Those by which the path is answered.
std::string MethodsOf(absl::string_view path) {
  std::vector<absl::string_view> methods;
  std::string ignored;
  for (const Route& route : kRoutes) {
    if (Matches(route.path, path, &ignored)) methods.push_back(route.method);
  }
  return absl::StrJoin(methods, ", ");
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
  // It may quote what the client sent, whatever its length.
  constexpr std::size_t kMaxMessage = 1000;
  std::string message(status.message().substr(0, kMaxMessage));
  if (message.size() < status.message().size()) absl::StrAppend(&message, "... (cut)");
  const wire::ErrorKind& kind = wire::KindOf(status);
  const nlohmann::ordered_json json = {
      {"error", {{"reason", std::string(kind.reason)}, {"message", message}, {"request_id", std::string(request_id)}}}};
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
  const bool asks_for_leave = request.method == "OPTIONS" && IsAllowedOrigin(cors_, request);
  const std::string methods = asks_for_leave ? MethodsOf(request.path) : "";
  if (stopping_ && request.path != "/healthz") {
    return WithHeaders(request, caller, Refused(caller, absl::UnavailableError("the server stops"), 503));
  }
  return WithHeaders(request, caller, methods.empty() ? Answer(request, caller) : Preflight(methods));
}

HttpResponse HttpApi::WithHeaders(const HttpRequest& request, const Caller& caller, HttpResponse response) const {
  AddCorsHeaders(cors_, request, &response);
  response.headers.emplace_back("X-Request-Id", caller.request_id);
  return response;
}

std::optional<HttpResponse> HttpApi::Refusal(const HttpRequest& request) const {
  if (!IsPlain(request)) return Handle(request);
  // Whatever has no body is refused where it is answered.
  if (context_.access == nullptr || request.method != "POST") return std::nullopt;
  Caller caller = CallerOf(request);
  if (!absl::IsUnauthenticated(context_.access->Identify(caller).status())) return std::nullopt;
  return Handle(request);
}

HttpResponse HttpApi::Refused(const Caller& caller, const absl::Status& why, int http_status) const {
  Note(context_, {.peer = caller.peer, .request_id = caller.request_id}, kUnknownCall, {why, caller.request_id}, 0.0,
       caller.bytes);
  HttpResponse response = ErrorResponse(why, caller.request_id);
  response.status = http_status;
  return response;
}

HttpResponse HttpApi::Answer(const HttpRequest& request, const Caller& caller) const {
  if (!IsPlain(request)) {
    HttpResponse response = Refused(caller,
                                    absl::InvalidArgumentError(absl::StrCat(
                                        "the body has Content-Encoding: ", request.content_encoding.substr(0, 40),
                                        ", and is taken as it is only: send it without (identity)")),
                                    415);
    response.headers.emplace_back("Accept-Encoding", "identity");
    return response;
  }
  Call call{context_, hooks_, request, caller, cors_, exporting_, ""};
  for (const RouteAnswer& answer : kAnswers) {
    if (!Matches(answer.route.path, request.path, &call.map)) continue;
    if (request.method == answer.route.method || (request.method == "HEAD" && answer.route.method == "GET")) {
      return answer.answer(call);
    }
  }
  const std::string allowed = MethodsOf(request.path);
  if (allowed.empty()) {
    return Refused(caller, absl::NotFoundError("there is nothing here: /openapi.json says what there is"), 404);
  }
  HttpResponse response = Refused(caller, absl::InvalidArgumentError(absl::StrCat("this takes ", allowed)), 405);
  response.headers.emplace_back("Allow", allowed);
  return response;
}

HttpResponse HttpApi::AnswerRefused(const HttpRequest& received, const absl::Status& why, int http_status) const {
  Caller caller = CallerOf(received);
  caller.request_id = RequestIdOf(caller);
  return WithHeaders(received, caller, Refused(caller, why, http_status));
}

}  // namespace cairn::server
