#include "server/grpc/services.h"

#include <cairn/v1/follow.grpc.pb.h>
#include <cairn/v1/localize.grpc.pb.h>
#include <cairn/v1/maps.grpc.pb.h>
#include <cairn/v1/sessions.grpc.pb.h>
#include <cairn/v1/track.grpc.pb.h>

#include "server/grpc/answer.h"
#include "server/rpc/follow_map.h"
#include "server/rpc/run_session.h"
#include "server/rpc/track_frames.h"

namespace cairn::server {
namespace {

using grpc::ServerContext;

class MapsService final : public v1::Maps::Service {
 public:
  explicit MapsService(const CallContext* context) : context_(*context) {}

  grpc::Status ListMaps(ServerContext* call, const v1::ListMapsRequest* request,
                        v1::ListMapsResponse* response) override {
    return AnswerOne(context_, call, "Maps.ListMaps", &server::ListMaps, *request, response);
  }
  grpc::Status DescribeMap(ServerContext* call, const v1::DescribeMapRequest* request,
                           v1::DescribeMapResponse* response) override {
    return AnswerOne(context_, call, "Maps.DescribeMap", &server::DescribeMap, *request, response);
  }

 private:
  const CallContext& context_;
};

class LocalizeService final : public v1::Localize::Service {
 public:
  explicit LocalizeService(const CallContext* context) : context_(*context) {}

  grpc::Status LocalizeImage(ServerContext* call, const v1::LocalizeImageRequest* request,
                             v1::LocalizeImageResponse* response) override {
    return AnswerOne(context_, call, "Localize.LocalizeImage", &server::LocalizeImage, *request, response);
  }

 private:
  const CallContext& context_;
};

// One of our streams over one of gRPC's.
template <class Interface, class Request, class Response>
class GrpcStream final : public Interface {
 public:
  using Stream = grpc::ServerReaderWriter<Response, Request>;
  GrpcStream(Stream* stream, const CallContext* context) : stream_(*stream), context_(*context) {}
  bool Read(Request* request) override {
    if (!stream_.Read(request)) return false;
    CountReceived(context_, static_cast<std::int64_t>(request->ByteSizeLong()));
    return true;
  }
  bool Write(const Response& response) override { return stream_.Write(response); }

 private:
  Stream& stream_;
  const CallContext& context_;
};
using GrpcSessionStream = GrpcStream<SessionStream, v1::RunSessionRequest, v1::RunSessionResponse>;
using GrpcTrackStream = GrpcStream<TrackStream, v1::TrackFramesRequest, v1::TrackFramesResponse>;

class TrackService final : public v1::Track::Service {
 public:
  explicit TrackService(const CallContext* context) : context_(*context) {}

  grpc::Status TrackFrames(ServerContext* call, GrpcTrackStream::Stream* stream) override {
    return Answer(context_, call, "Track.TrackFrames", 0, [&](const CallContext& context) {
      GrpcTrackStream messages(stream, &context);
      return server::TrackFrames(context, &messages);
    });
  }

 private:
  const CallContext& context_;
};

class FollowService final : public v1::Follow::Service {
 public:
  explicit FollowService(const CallContext* context) : context_(*context) {}

  grpc::Status FollowMap(ServerContext* call, const v1::FollowMapRequest* request,
                         grpc::ServerWriter<v1::FollowMapResponse>* writer) override {
    const auto bytes = static_cast<std::int64_t>(request->ByteSizeLong());
    return Answer(context_, call, "Follow.FollowMap", bytes, [&](const CallContext& context) {
      GrpcFollowStream messages(call, writer);
      return server::FollowMap(context, *request, &messages);
    });
  }

 private:
  class GrpcFollowStream final : public FollowStream {
   public:
    GrpcFollowStream(ServerContext* call, grpc::ServerWriter<v1::FollowMapResponse>* writer)
        : call_(*call), writer_(*writer) {}
    bool Ended() override { return call_.IsCancelled(); }
    bool Write(const v1::FollowMapResponse& response) override { return writer_.Write(response); }

   private:
    ServerContext& call_;
    grpc::ServerWriter<v1::FollowMapResponse>& writer_;
  };

  const CallContext& context_;
};

class SessionsService final : public v1::Sessions::Service {
 public:
  explicit SessionsService(const CallContext* context) : context_(*context) {}

  grpc::Status RunSession(ServerContext* call, GrpcSessionStream::Stream* stream) override {
    return Answer(context_, call, "Sessions.RunSession", 0, [&](const CallContext& context) {
      GrpcSessionStream messages(stream, &context);
      return server::RunSession(context, &messages);
    });
  }

 private:
  const CallContext& context_;
};

}  // namespace

std::vector<std::unique_ptr<grpc::Service>> MakeServices(const CallContext* context) {
  std::vector<std::unique_ptr<grpc::Service>> services;
  services.push_back(std::make_unique<MapsService>(context));
  services.push_back(std::make_unique<LocalizeService>(context));
  services.push_back(std::make_unique<SessionsService>(context));
  services.push_back(std::make_unique<TrackService>(context));
  services.push_back(std::make_unique<FollowService>(context));
  return services;
}

}  // namespace cairn::server
