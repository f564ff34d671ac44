// Tracking at a daemon: every frame is sent there, and its pose comes back. For clients that cannot track by
// themselves; without the network there is no pose. The server has no photometric calibration: exposures are not sent.
#pragma once

#include <cairn/v1/track.grpc.pb.h>

#include <memory>
#include <string>

#include "api/tracker.h"
#include "base/status.h"
#include "client/remote/channel.h"

namespace cairn::client {

class ServedTracker final : public api::Tracker {
 public:
  // Errors of the server come at once.
  static absl::StatusOr<std::unique_ptr<api::Tracker>> Start(const RemoteOptions& options,
                                                             std::shared_ptr<grpc::Channel> channel,
                                                             const std::string& map, const Camera& camera);
  ~ServedTracker() override;

  // A connection that breaks is made again, for RemoteOptions::outage_s at most, and the tracker at the server finds
  // itself anew. Unavailable if that takes longer; the next call tries once more.
  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override;

 private:
  using Stream = grpc::ClientReaderWriter<v1::TrackFramesRequest, v1::TrackFramesResponse>;

  ServedTracker(const RemoteOptions& options, std::shared_ptr<grpc::Channel> channel, const std::string& map,
                const Camera& camera);
  absl::Status Connect();
  absl::Status Exchange(const v1::TrackFramesRequest& request, v1::TrackFramesResponse* response);

  const RemoteOptions options_;
  const std::shared_ptr<grpc::Channel> channel_;
  const std::unique_ptr<v1::Track::Stub> stub_;
  const std::string map_;
  const Camera camera_;
  std::string shown_;  // the token that opened the stream
  std::unique_ptr<grpc::ClientContext> context_;
  std::unique_ptr<Stream> stream_;  // null: there is no connection
};

}  // namespace cairn::client
