#include "server/rpc/run_session.h"

#include <chrono>
#include <memory>
#include <optional>

#include "base/guarded.h"
#include "server/rpc/images.h"
#include "wire/convert.h"
#include "wire/convert_sessions.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

// One stream of messages.
class SessionCall {
 public:
  SessionCall(const CallContext& context, SessionStream* stream) : context_(context), stream_(*stream) {}

  absl::Status Run() {
    // gRPC ends a stream in the same way where it cannot read a message.
    if (!stream_.Read(&request_)) return absl::InvalidArgumentError("session: no `start` came that could be read");
    CAIRN_RETURN_IF_ERROR(Start());
    while (stream_.Read(&request_)) {
      response_.Clear();
      switch (request_.step_case()) {
        case v1::RunSessionRequest::kFrame:
          CAIRN_RETURN_IF_ERROR(AddFrame());
          break;
        case v1::RunSessionRequest::kFinish:
          return Finish();
        default:
          return absl::InvalidArgumentError("session: after `start` come frames, and then `finish`");
      }
      if (!stream_.Write(response_)) break;
    }
    return Left();
  }

 private:
  absl::Status Left() const {
    if (context_.access != nullptr && context_.access->stopping()) {
      return absl::UnavailableError("the server stops; what the session was told is durable stays in the map");
    }
    return absl::CancelledError("the client is gone; the session waits for it");
  }

  absl::Status Start() {
    if (!request_.has_start()) return absl::InvalidArgumentError("session: it begins with `start`");
    const v1::StartSession& start = request_.start();
    v1::SessionStarted* started = response_.mutable_started();
    if (!start.token().empty()) {
      CAIRN_ASSIGN_OR_RETURN(session_, context_.maps->ResumeSession(start.token()));
      started->set_resumed(true);
      started->set_map(session_->map());
      wire::ToProto(session_->camera(), started->mutable_camera());
    } else {
      CAIRN_ASSIGN_OR_RETURN(const api::SessionRequest request, wire::FromProto(start));
      CAIRN_RETURN_IF_ERROR(CheckImageSize(request.camera, context_.images));
      CAIRN_ASSIGN_OR_RETURN(session_, context_.maps->StartSession(request));
    }
    started->set_token(session_->token());
    started->set_map_id(session_->map_id());
    if (session_->last_answer()) {
      started->set_has_received(true);
      started->set_received_ns(session_->last_answer()->time_ns);
      wire::ToProto(*session_->last_answer(), started->mutable_answer());
    }
    AddProgress();
    if (!stream_.Write(response_)) return Left();
    return absl::OkStatus();
  }

  // A frame that cannot be used is told so, and the session goes on.
  absl::Status AddFrame() {
    const auto begin = std::chrono::steady_clock::now();
    const absl::StatusOr<api::SessionAnswer> answer = Answer();
    if (!answer.ok() && !absl::IsInvalidArgument(answer.status())) return answer.status();
    v1::FrameAnswer* frame = response_.mutable_frame();
    if (answer.ok()) {
      wire::ToProto(*answer, frame);
    } else {
      frame->set_time_ns(request_.frame().time_ns());
      frame->set_error_reason(std::string(wire::KindOf(answer.status()).reason));
      frame->set_error_message(std::string(answer.status().message()));
    }
    if (context_.observer != nullptr) {
      const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
      context_.observer->OnSessionFrame(answer.ok() ? api::SessionStateName(answer->state) : "refused",
                                        seconds.count());
    }
    AddProgress();
    return absl::OkStatus();
  }

  absl::StatusOr<api::SessionAnswer> Answer() {
    const v1::SessionFrame& frame = request_.frame();
    // The camera is the one that the session was started with; a resumed one's is not sent again.
    CAIRN_ASSIGN_OR_RETURN(const cv::Mat gray, GrayImageOf(frame.image(), session_->camera(), context_.images));
    if (frame.dropped_before() > 0 && context_.observer != nullptr) {
      context_.observer->OnFramesDropped(frame.dropped_before());
    }
    return session_->AddFrame({gray, frame.time_ns(), frame.dropped_before()});
  }

  absl::Status Finish() {
    CAIRN_ASSIGN_OR_RETURN(const api::SessionSummary summary, session_->Finish());
    wire::ToProto(summary, response_.mutable_finished());
    AddProgress();
    stream_.Write(response_);
    return absl::OkStatus();
  }

  void AddProgress() {
    if (told_ == session_->progress()) return;
    told_ = session_->progress();
    wire::ToProto(*told_, response_.mutable_progress());
  }

  const CallContext& context_;
  SessionStream& stream_;
  std::unique_ptr<api::MapSession> session_;
  std::optional<api::SessionProgress> told_;
  v1::RunSessionRequest request_;
  v1::RunSessionResponse response_;
};

}  // namespace

absl::Status RunSession(const CallContext& context, SessionStream* stream) {
  return Guarded([&] { return SessionCall(context, stream).Run(); });
}

}  // namespace cairn::server
