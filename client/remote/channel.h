// The connection to a server, and how a call over it ends.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <string>

#include "base/status.h"
#include "client/remote/remote_map_service.h"

namespace cairn::client {

std::shared_ptr<grpc::Channel> NewChannel(const RemoteOptions& options);

void SetDeadline(double deadline_s, grpc::ClientContext* context);

// Before connecting again: longer from one attempt to the next, by a random share, so that clients of a server that
// comes back do not all knock at once.
std::chrono::milliseconds PauseBefore(int attempt);
// That, and then until there is a connection, for half a second at most. Calls that fail at once do not make gRPC look
// after its connections: left alone it does so every five seconds only.
void PauseAndConnect(int attempt, grpc::Channel* channel);

// With its fault, and for a server that cannot be reached with its name and what to do.
absl::Status FromGrpc(const grpc::Status& status, const RemoteOptions& options);

}  // namespace cairn::client
