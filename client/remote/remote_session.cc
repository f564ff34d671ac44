#include "client/remote/remote_session.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "base/guarded.h"
#include "client/query_image.h"
#include "client/remote/server_token.h"
#include "wire/convert.h"
#include "wire/convert_sessions.h"

namespace cairn::client {
namespace {

// What is kept to be sent again: some twenty seconds of a common camera.
constexpr std::size_t kMaxKeptFrames = 600;
constexpr std::size_t kMaxKeptBytes = 256u << 20;

}  // namespace

RemoteSession::RemoteSession(const RemoteOptions& options, std::shared_ptr<grpc::Channel> channel)
    : options_(options), channel_(std::move(channel)), stub_(v1::Sessions::NewStub(channel_)) {}

RemoteSession::~RemoteSession() { Drop(); }

absl::StatusOr<std::unique_ptr<api::MapSession>> RemoteSession::Start(const RemoteOptions& options,
                                                                      std::shared_ptr<grpc::Channel> channel,
                                                                      const api::SessionRequest& request) {
  auto session = std::unique_ptr<RemoteSession>(new RemoteSession(options, std::move(channel)));
  session->request_ = request;
  v1::StartSession start;
  wire::ToProto(request, &start);
  CAIRN_RETURN_IF_ERROR(session->Open(start));
  return session;
}

absl::StatusOr<std::unique_ptr<api::MapSession>> RemoteSession::Resume(const RemoteOptions& options,
                                                                       std::shared_ptr<grpc::Channel> channel,
                                                                       const std::string& token) {
  auto session = std::unique_ptr<RemoteSession>(new RemoteSession(options, std::move(channel)));
  v1::StartSession start;
  start.set_token(token);
  CAIRN_RETURN_IF_ERROR(session->Open(start));
  return session;
}

void RemoteSession::Drop() {
  if (stream_ == nullptr) return;
  context_->TryCancel();
  stream_->Finish();
  stream_.reset();
}

absl::Status RemoteSession::Exchange(const v1::RunSessionRequest& request, v1::RunSessionResponse* response) {
  if (stream_ == nullptr) return absl::UnavailableError("there is no connection");
  if (stream_->Write(request) && stream_->Read(response)) {
    if (response->has_progress()) {
      progress_ = wire::FromProto(response->progress());
      ever_durable_ |= progress_.durable_ns.has_value();
    }
    return absl::OkStatus();
  }
  const absl::Status status = FromGrpc(stream_->Finish(), options_);
  stream_.reset();
  return status.ok() ? absl::UnavailableError(absl::StrCat(options_.server, " ended the session's stream")) : status;
}

absl::Status RemoteSession::Open(const v1::StartSession& start) {
  return Patiently(options_, [&] { return WithToken(options_, [&] { return Connect(start); }); });
}

absl::Status RemoteSession::Connect(const v1::StartSession& start) {
  Drop();
  if (options_.shown != nullptr) shown_ = options_.shown->Text();
  context_ = std::make_unique<grpc::ClientContext>();
  stream_ = stub_->RunSession(context_.get());
  v1::RunSessionRequest request;
  *request.mutable_start() = start;
  v1::RunSessionResponse response;
  CAIRN_RETURN_IF_ERROR(Exchange(request, &response));
  const v1::SessionStarted& started = response.started();
  token_ = started.token();
  request_.map_id = started.map_id();
  if (start.token().empty()) return absl::OkStatus();
  request_.map = started.map();
  if (started.has_camera()) {
    CAIRN_ASSIGN_OR_RETURN(request_.camera, wire::FromProto(started.camera()));
  }
  last_answer_.reset();
  if (started.has_received()) {
    CAIRN_ASSIGN_OR_RETURN(last_answer_, wire::FromProto(started.answer()));
  }
  return absl::OkStatus();
}

absl::Status RemoteSession::Reconnect() {
  v1::StartSession start;
  start.set_token(token_);
  const absl::Status resumed = Open(start);
  // Not noticed by the server yet that its client is gone: a matter of moments.
  if (absl::IsFailedPrecondition(resumed)) return absl::UnavailableError(resumed.message());
  return absl::IsNotFound(resumed) ? BeginAnew() : resumed;
}

absl::Status RemoteSession::BeginAnew() {
  api::SessionRequest request = request_;  // with the id of the map: nobody else's that has its name now is extended
  if (ever_durable_) {
    request.policy = map::SessionPolicy::kExtend;
    request.least_revision = progress_.revision;
  }
  if (!kept_.empty()) request.first_ns = kept_.front().frame().time_ns();
  v1::StartSession start;
  wire::ToProto(request, &start);
  absl::Status begun = Open(start);
  if (absl::IsAlreadyExists(begun)) {  // it came into being, and nobody could say so
    start.set_policy(v1::SessionInfo::POLICY_EXTEND);
    begun = Open(start);
  }
  CAIRN_RETURN_IF_ERROR(begun);
  last_answer_.reset();
  for (const v1::RunSessionRequest& frame : kept_) {
    v1::RunSessionResponse response;
    CAIRN_RETURN_IF_ERROR(Exchange(frame, &response));
    const absl::StatusOr<api::SessionAnswer> answer = wire::FromProto(response.frame());
    if (answer.ok()) last_answer_ = *answer;
  }
  return absl::OkStatus();
}

absl::Status RemoteSession::Persist(const std::function<absl::Status()>& attempt) {
  Outage outage(options_, channel_.get());
  absl::Status status = attempt();
  const auto renewed = [&] { return options_.shown != nullptr && options_.shown->Renewed(status, shown_); };
  while ((IsOutage(status) && outage.Wait(status)) || renewed()) {
    status = Reconnect();
    if (status.ok()) status = attempt();
  }
  return status;
}

void RemoteSession::Keep(v1::RunSessionRequest frame) {
  const auto drop = [&] {
    kept_bytes_ -= kept_.front().frame().image().gray().size();
    kept_.pop_front();
  };
  while (!kept_.empty() && progress_.durable_ns && kept_.front().frame().time_ns() <= *progress_.durable_ns) drop();
  kept_bytes_ += frame.frame().image().gray().size();
  kept_.push_back(std::move(frame));
  while (kept_.size() > kMaxKeptFrames || (kept_.size() > 1 && kept_bytes_ > kMaxKeptBytes)) drop();
}

absl::StatusOr<api::SessionAnswer> RemoteSession::AddFrame(const api::SessionFrame& frame) {
  return Guarded([&]() -> absl::StatusOr<api::SessionAnswer> {
    CAIRN_RETURN_IF_ERROR(CheckImage(frame.image, request_.camera, "session"));
    v1::RunSessionRequest request;
    request.mutable_frame()->set_time_ns(frame.time_ns);
    wire::ToProto(frame.image, request.mutable_frame()->mutable_image());
    request.mutable_frame()->set_dropped_before(frame.dropped_before);
    v1::RunSessionResponse response;
    bool sent_before = false;
    CAIRN_RETURN_IF_ERROR(Persist([&] {
      // It had arrived, and only its answer was lost.
      if (sent_before && last_answer_ && last_answer_->time_ns == frame.time_ns) {
        wire::ToProto(*last_answer_, response.mutable_frame());
        return absl::OkStatus();
      }
      sent_before = true;
      return Exchange(request, &response);
    }));
    CAIRN_ASSIGN_OR_RETURN(const api::SessionAnswer answer, wire::FromProto(response.frame()));
    Keep(std::move(request));
    return answer;
  });
}

absl::StatusOr<api::SessionSummary> RemoteSession::Finish() {
  return Guarded([&]() -> absl::StatusOr<api::SessionSummary> {
    v1::RunSessionRequest request;
    request.mutable_finish();
    v1::RunSessionResponse response;
    CAIRN_RETURN_IF_ERROR(Persist([&] { return Exchange(request, &response); }));
    Drop();
    return wire::FromProto(response.finished());
  });
}

}  // namespace cairn::client
