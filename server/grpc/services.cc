#include "server/grpc/services.h"

#include <cairn/v1/admin.grpc.pb.h>
#include <cairn/v1/follow.grpc.pb.h>
#include <cairn/v1/localize.grpc.pb.h>
#include <cairn/v1/maps.grpc.pb.h>
#include <cairn/v1/sessions.grpc.pb.h>
#include <cairn/v1/status.grpc.pb.h>
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

class AdminService final : public v1::Admin::Service {
 public:
  explicit AdminService(const CallContext* context) : context_(*context) {}

  grpc::Status CreateMap(ServerContext* call, const v1::CreateMapRequest* request,
                         v1::CreateMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.CreateMap", &server::CreateMap, *request, response);
  }
  grpc::Status SnapshotMap(ServerContext* call, const v1::SnapshotMapRequest* request,
                           v1::SnapshotMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.SnapshotMap", &server::SnapshotMap, *request, response);
  }
  grpc::Status DeleteMap(ServerContext* call, const v1::DeleteMapRequest* request,
                         v1::DeleteMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.DeleteMap", &server::DeleteMap, *request, response);
  }
  grpc::Status ListDeletedMaps(ServerContext* call, const v1::ListDeletedMapsRequest* request,
                               v1::ListDeletedMapsResponse* response) override {
    return AnswerOne(context_, call, "Admin.ListDeletedMaps", &server::ListDeletedMaps, *request, response);
  }
  grpc::Status RestoreMap(ServerContext* call, const v1::RestoreMapRequest* request,
                          v1::RestoreMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.RestoreMap", &server::RestoreMap, *request, response);
  }
  grpc::Status VerifyMap(ServerContext* call, const v1::VerifyMapRequest* request,
                         v1::VerifyMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.VerifyMap", &server::VerifyMap, *request, response);
  }
  grpc::Status RemoveSession(ServerContext* call, const v1::RemoveSessionRequest* request,
                             v1::RemoveSessionResponse* response) override {
    return AnswerOne(context_, call, "Admin.RemoveSession", &server::RemoveSession, *request, response);
  }
  grpc::Status AlignMap(ServerContext* call, const v1::AlignMapRequest* request,
                        v1::AlignMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.AlignMap", &server::AlignMap, *request, response);
  }
  grpc::Status OverviewMap(ServerContext* call, const v1::OverviewMapRequest* request,
                           v1::OverviewMapResponse* response) override {
    return AnswerOne(context_, call, "Admin.OverviewMap", &server::OverviewMap, *request, response);
  }
  grpc::Status ReadLog(ServerContext* call, const v1::ReadLogRequest* request, v1::ReadLogResponse* response) override {
    return AnswerOne(context_, call, "Admin.ReadLog", &server::ReadLog, *request, response);
  }
  grpc::Status ExportMap(ServerContext* call, const v1::ExportMapRequest* request,
                         grpc::ServerWriter<v1::ExportMapResponse>* writer) override {
    const auto write = [&](const v1::ExportMapResponse& part) { return writer->Write(part); };
    return Answer(context_, call, "Admin.ExportMap", static_cast<std::int64_t>(request->ByteSizeLong()),
                  [&](const CallContext& context) { return server::ExportMap(context, *request, write); });
  }

 private:
  const CallContext& context_;
};

class StatusService final : public v1::Status::Service {
 public:
  explicit StatusService(const CallContext* context) : context_(*context) {}

  grpc::Status GetStatus(ServerContext* call, const v1::GetStatusRequest* request,
                         v1::GetStatusResponse* response) override {
    return AnswerOne(context_, call, "Status.GetStatus", &server::GetStatus, *request, response);
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
  grpc::Status LocalizeInMaps(ServerContext* call, const v1::LocalizeInMapsRequest* request,
                              v1::LocalizeInMapsResponse* response) override {
    return AnswerOne(context_, call, "Localize.LocalizeInMaps", &server::LocalizeInMaps, *request, response);
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
  grpc::Status ListSessions(ServerContext* call, const v1::ListSessionsRequest* request,
                            v1::ListSessionsResponse* response) override {
    return AnswerOne(context_, call, "Sessions.ListSessions", &server::ListSessions, *request, response);
  }

 private:
  const CallContext& context_;
};

}  // namespace

std::vector<std::unique_ptr<grpc::Service>> MakeServices(const CallContext* context) {
  std::vector<std::unique_ptr<grpc::Service>> services;
  services.push_back(std::make_unique<MapsService>(context));
  services.push_back(std::make_unique<AdminService>(context));
  services.push_back(std::make_unique<StatusService>(context));
  services.push_back(std::make_unique<LocalizeService>(context));
  services.push_back(std::make_unique<SessionsService>(context));
  services.push_back(std::make_unique<TrackService>(context));
  services.push_back(std::make_unique<FollowService>(context));
  return services;
}

}  // namespace cairn::server
