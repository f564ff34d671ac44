// A session as it comes in, message by message, whatever carries them.
#pragma once

#include <cairn/v1/sessions.pb.h>

#include "base/status.h"
#include "server/rpc/calls.h"

namespace cairn::server {

class SessionStream {
 public:
  virtual ~SessionStream() = default;
  // False: the client has ended the stream, or is gone.
  virtual bool Read(v1::RunSessionRequest* request) = 0;
  virtual bool Write(const v1::RunSessionResponse& response) = 0;
};

// Until the session is finished, or its client is gone: then it can be resumed for a while.
absl::Status RunSession(const CallContext& context, SessionStream* stream);

}  // namespace cairn::server
