// How a call ends in gRPC: an error carries its reason (wire/errors.h) and the id of the request.
#pragma once

#include <grpcpp/support/status.h>

#include <utility>

#include "server/rpc/serve.h"

namespace cairn::server {

grpc::Status ToGrpc(const Served& served);

template <class Function>
grpc::Status Answer(const CallContext& context, absl::string_view call, Function&& function) {
  return ToGrpc(Serve(context, call, std::forward<Function>(function)));
}

}  // namespace cairn::server
