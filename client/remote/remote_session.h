// A session at a daemon. A connection that breaks is made again and the session resumed, and after a restart of the
// daemon another one goes on in the same map: frames that were not in the map for good are sent again, as far as they
// are kept. The caller notices that a frame takes longer.
#pragma once

#include <cairn/v1/sessions.grpc.pb.h>

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "api/map_session.h"
#include "base/status.h"
#include "client/remote/channel.h"

namespace cairn::client {

class RemoteSession final : public api::MapSession {
 public:
  static absl::StatusOr<std::unique_ptr<api::MapSession>> Start(const RemoteOptions& options,
                                                                std::shared_ptr<grpc::Channel> channel,
                                                                const api::SessionRequest& request);
  // What was kept of the frames before is lost with the client that had it.
  static absl::StatusOr<std::unique_ptr<api::MapSession>> Resume(const RemoteOptions& options,
                                                                 std::shared_ptr<grpc::Channel> channel,
                                                                 const std::string& token);
  ~RemoteSession() override;

  const std::string& token() const override { return token_; }
  const std::string& map() const override { return request_.map; }
  const std::string& map_id() const override { return request_.map_id; }
  const Camera& camera() const override { return request_.camera; }
  const std::optional<api::SessionAnswer>& last_answer() const override { return last_answer_; }
  const api::SessionProgress& progress() const override { return progress_; }

  // Unavailable if the server cannot be reached for longer than RemoteOptions::outage_s.
  absl::StatusOr<api::SessionAnswer> AddFrame(const api::SessionFrame& frame) override;
  absl::StatusOr<api::SessionSummary> Finish() override;

 private:
  using Stream = grpc::ClientReaderWriter<v1::RunSessionRequest, v1::RunSessionResponse>;

  RemoteSession(const RemoteOptions& options, std::shared_ptr<grpc::Channel> channel);

  // One message there, one back. An error ends the stream, and is the server's or the connection's.
  absl::Status Exchange(const v1::RunSessionRequest& request, v1::RunSessionResponse* response);
  absl::Status Open(const v1::StartSession& start);
  absl::Status Connect(const v1::StartSession& start);
  void Drop();
  // After a broken connection: the session, or another one that goes on where it was durable.
  absl::Status Reconnect();
  absl::Status BeginAnew();
  // `attempt` until it succeeds, fails for good, or the outage lasts too long; reconnects before all but the first.
  absl::Status Persist(const std::function<absl::Status()>& attempt);
  void Keep(v1::RunSessionRequest frame);

  const RemoteOptions options_;
  const std::shared_ptr<grpc::Channel> channel_;
  const std::unique_ptr<v1::Sessions::Stub> stub_;
  std::unique_ptr<grpc::ClientContext> context_;
  std::unique_ptr<Stream> stream_;  // null: there is no connection
  std::string shown_;               // the token that began it

  api::SessionRequest request_;
  std::string token_;
  std::optional<api::SessionAnswer> last_answer_;
  api::SessionProgress progress_;
  bool ever_durable_ = false;
  // Of which nothing says yet that they are in the map for good, in temporal order.
  std::deque<v1::RunSessionRequest> kept_;
  std::size_t kept_bytes_ = 0;
};

}  // namespace cairn::client
