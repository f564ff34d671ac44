// What the server answers over HTTP: the calls of cairn.v1 as JSON, the health of the process, its metrics, and its own
// description in OpenAPI 3.0. Errors are JSON with the HTTP status of wire/errors.h.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "server/http/cors.h"
#include "server/http/message.h"
#include "server/rpc/calls.h"

namespace cairn::server {

struct HttpHooks {
  std::function<absl::Status()> ready;   // whether requests can be served
  std::function<std::string()> metrics;  // in Prometheus' text format
  std::string geopose_map = {};          // that the GeoPose Protocol asks; empty: those that are near
};

class HttpApi {
 public:
  // What `context` refers to must outlive this.
  HttpApi(const CallContext& context, HttpHooks hooks, CorsOptions cors = {})
      : context_(context), hooks_(std::move(hooks)), cors_(std::move(cors)) {}

  // Any thread. Nothing is thrown.
  HttpResponse Handle(const HttpRequest& request) const;

  // The answer to a request without a token that is known, or with a body that is encoded, before that is read; none:
  // go on. Any thread.
  std::optional<HttpResponse> Refusal(const HttpRequest& request) const;

  // The answer to what never became a request that is handled: `received` is what is known of it
  // (HttpServerOptions::on_refused). Writes it down. Any thread.
  HttpResponse AnswerRefused(const HttpRequest& received, const absl::Status& why, int http_status) const;

  // From now on all requests but /healthz are refused (Unavailable): the server stops. Any thread.
  void Stop() { stopping_ = true; }

  // Every path that is answered, "{map}" in place of a name (of a map, or of a deleted one), and by which method.
  struct Route {
    absl::string_view method;
    absl::string_view path;
  };
  static std::span<const Route> Routes();
  // The description of all of them.
  static const std::string& OpenApi();

 private:
  HttpResponse Answer(const HttpRequest& request, const Caller& caller) const;
  HttpResponse WithHeaders(const HttpRequest& request, const Caller& caller, HttpResponse response) const;
  // What no handler gets to see, with a line in the log.
  HttpResponse Refused(const Caller& caller, const absl::Status& why, int http_status) const;

  const CallContext context_;
  const HttpHooks hooks_;
  const CorsOptions cors_;
  mutable std::atomic<int> exporting_ = 0;  // files that are being sent at the moment
  std::atomic<bool> stopping_ = false;
};

// {"error": {"reason": ..., "message": ..., "request_id": ...}}, and the headers that go with it.
HttpResponse ErrorResponse(const absl::Status& status, absl::string_view request_id);

}  // namespace cairn::server
