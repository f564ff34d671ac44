// Tracking as it comes in, message by message, whatever carries them.
#pragma once

#include <cairn/v1/track.pb.h>

#include "base/status.h"
#include "server/rpc/calls.h"

namespace cairn::server {

class TrackStream {
 public:
  virtual ~TrackStream() = default;
  // False: the client has ended the stream, or is gone.
  virtual bool Read(v1::TrackFramesRequest* request) = 0;
  virtual bool Write(const v1::TrackFramesResponse& response) = 0;
};

// Until the client ends the stream.
absl::Status TrackFrames(const CallContext& context, TrackStream* stream);

}  // namespace cairn::server
