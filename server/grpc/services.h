// The services that gRPC knows: each of their methods hands its request to the call of the same name.
#pragma once

#include <grpcpp/impl/codegen/service_type.h>

#include <memory>
#include <vector>

#include "server/rpc/calls.h"

namespace cairn::server {

// `context` must outlive them.
std::vector<std::unique_ptr<grpc::Service>> MakeServices(const CallContext* context);

}  // namespace cairn::server
