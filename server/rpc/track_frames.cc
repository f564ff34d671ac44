#include "server/rpc/track_frames.h"

#include <memory>

#include "base/guarded.h"
#include "server/rpc/images.h"
#include "wire/convert.h"
#include "wire/convert_tracks.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

absl::StatusOr<api::TrackAnswer> AnswerFrame(const CallContext& context, const v1::TrackFrame& frame,
                                             const Camera& camera, api::Tracker* tracker) {
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat gray, GrayImageOf(frame.image(), camera, context.images));
  return tracker->Track({gray, frame.time_ns()});
}

absl::Status Follow(const CallContext& context, TrackStream* stream) {
  v1::TrackFramesRequest request;
  // gRPC ends a stream in the same way where it cannot read a message.
  if (!stream->Read(&request)) return absl::InvalidArgumentError("track: no `start` came that could be read");
  if (!request.has_start()) return absl::InvalidArgumentError("track: it begins with `start`");
  CAIRN_ASSIGN_OR_RETURN(const Camera camera, wire::FromProto(request.start().camera()));
  CAIRN_RETURN_IF_ERROR(CheckImageSize(camera, context.images));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<api::Tracker> tracker,
                         context.maps->NewTracker(request.start().map(), camera));
  v1::TrackFramesResponse response;
  response.mutable_started();
  while (stream->Write(response) && stream->Read(&request)) {
    if (!request.has_frame()) return absl::InvalidArgumentError("track: after `start` come frames");
    const absl::StatusOr<api::TrackAnswer> answer = AnswerFrame(context, request.frame(), camera, tracker.get());
    v1::TrackAnswer* out = response.mutable_answer();
    out->Clear();
    if (answer.ok()) {
      wire::ToProto(*answer, out);
    } else if (absl::IsInvalidArgument(answer.status())) {
      out->set_time_ns(request.frame().time_ns());
      out->set_error_reason(std::string(wire::KindOf(answer.status()).reason));
      out->set_error_message(std::string(answer.status().message()));
    } else {
      return answer.status();
    }
    if (context.observer != nullptr) context.observer->OnTracked(answer.ok() ? &*answer : nullptr);
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status TrackFrames(const CallContext& context, TrackStream* stream) {
  return Guarded([&] { return Follow(context, stream); });
}

}  // namespace cairn::server
