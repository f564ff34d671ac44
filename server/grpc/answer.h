// How a call comes in and ends in gRPC: who asks is in its metadata, an error carries its reason (wire/errors.h) and
// the id of the request.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/status.h>

#include <utility>

#include "server/rpc/serve.h"

namespace cairn::server {

// `bytes`: of the request; those of a stream are counted as they come.
Caller CallerOf(const grpc::ServerContext& call, std::int64_t bytes);

grpc::Status ToGrpc(const Served& served, grpc::ServerContext* call);

// `function` gets the context of the call (serve.h).
template <class Function>
grpc::Status Answer(const CallContext& server, grpc::ServerContext* call, absl::string_view name, std::int64_t bytes,
                    Function&& function) {
  return ToGrpc(Serve(server, CallerOf(*call, bytes), name, std::forward<Function>(function)), call);
}

// A call of one request and one response, by the function of server/rpc/calls.h that answers it.
template <class Request, class Response>
grpc::Status AnswerOne(const CallContext& server, grpc::ServerContext* call, absl::string_view name,
                       absl::Status (*function)(const CallContext&, const Request&, Response*), const Request& request,
                       Response* response) {
  return Answer(server, call, name, static_cast<std::int64_t>(request.ByteSizeLong()),
                [&](const CallContext& context) { return function(context, request, response); });
}

}  // namespace cairn::server
