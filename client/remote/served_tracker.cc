#include "client/remote/served_tracker.h"

#include <chrono>
#include <utility>

#include "base/guarded.h"
#include "client/query_image.h"
#include "client/remote/server_token.h"
#include "wire/convert.h"
#include "wire/convert_tracks.h"

namespace cairn::client {

ServedTracker::ServedTracker(const RemoteOptions& options, std::shared_ptr<grpc::Channel> channel,
                             const std::string& map, const Camera& camera)
    : options_(options),
      channel_(std::move(channel)),
      stub_(v1::Track::NewStub(channel_)),
      map_(map),
      camera_(camera) {}

ServedTracker::~ServedTracker() {
  if (stream_ == nullptr) return;
  context_->TryCancel();
  stream_->Finish();
}

absl::StatusOr<std::unique_ptr<api::Tracker>> ServedTracker::Start(const RemoteOptions& options,
                                                                   std::shared_ptr<grpc::Channel> channel,
                                                                   const std::string& map, const Camera& camera) {
  auto tracker = std::unique_ptr<ServedTracker>(new ServedTracker(options, std::move(channel), map, camera));
  CAIRN_RETURN_IF_ERROR(Patiently(options, [&] { return WithToken(options, [&] { return tracker->Connect(); }); }));
  return tracker;
}

absl::Status ServedTracker::Exchange(const v1::TrackFramesRequest& request, v1::TrackFramesResponse* response) {
  if (stream_->Write(request) && stream_->Read(response)) return absl::OkStatus();
  const absl::Status status = FromGrpc(stream_->Finish(), options_);
  stream_.reset();
  return status.ok() ? absl::UnavailableError(absl::StrCat(options_.server, " ended the tracker's stream")) : status;
}

absl::Status ServedTracker::Connect() {
  if (stream_ != nullptr) return absl::OkStatus();
  if (options_.shown != nullptr) shown_ = options_.shown->Text();
  context_ = std::make_unique<grpc::ClientContext>();
  stream_ = stub_->TrackFrames(context_.get());
  v1::TrackFramesRequest request;
  request.mutable_start()->set_map(map_);
  wire::ToProto(camera_, request.mutable_start()->mutable_camera());
  v1::TrackFramesResponse response;
  return Exchange(request, &response);
}

absl::StatusOr<api::TrackAnswer> ServedTracker::Track(const api::TrackFrame& frame) {
  return Guarded([&]() -> absl::StatusOr<api::TrackAnswer> {
    const auto begin = std::chrono::steady_clock::now();
    CAIRN_RETURN_IF_ERROR(CheckImage(frame.image, camera_, "track"));
    v1::TrackFramesRequest request;
    request.mutable_frame()->set_time_ns(frame.time_ns);
    wire::ToProto(frame.image, request.mutable_frame()->mutable_image());
    v1::TrackFramesResponse response;
    const auto attempt = [&]() -> absl::Status {
      CAIRN_RETURN_IF_ERROR(Connect());
      return Exchange(request, &response);
    };
    Outage outage(options_, channel_.get());
    // The stream goes on with the token that it was opened with, whatever other calls have found since.
    const auto with_token = [&] {
      const absl::Status status = attempt();
      return options_.shown != nullptr && options_.shown->Renewed(status, shown_) ? attempt() : status;
    };
    Patience patience(options_);
    absl::Status status = with_token();
    while ((IsOutage(status) && outage.Wait(status)) || patience.Wait(status)) status = with_token();
    CAIRN_RETURN_IF_ERROR(status);
    CAIRN_ASSIGN_OR_RETURN(api::TrackAnswer answer, wire::FromProto(response.answer()));
    answer.track_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    return answer;
  });
}

}  // namespace cairn::client
