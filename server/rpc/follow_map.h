// A map as it goes out, message by message, whatever carries them.
#pragma once

#include <cairn/v1/follow.pb.h>

#include "base/status.h"
#include "server/rpc/calls.h"

namespace cairn::server {

class FollowStream {
 public:
  virtual ~FollowStream() = default;
  // The client is gone, or wants no more.
  virtual bool Ended() = 0;
  // Waits for a client that reads slowly. False: it is gone.
  virtual bool Write(const v1::FollowMapResponse& response) = 0;
};

// Until the stream has ended.
absl::Status FollowMap(const CallContext& context, const v1::FollowMapRequest& request, FollowStream* stream);

}  // namespace cairn::server
