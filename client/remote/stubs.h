// The connection of a RemoteMapService: for the files of its implementation.
#pragma once

#include <cairn/v1/admin.grpc.pb.h>
#include <cairn/v1/localize.grpc.pb.h>
#include <cairn/v1/maps.grpc.pb.h>
#include <cairn/v1/sessions.grpc.pb.h>
#include <cairn/v1/status.grpc.pb.h>

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "base/guarded.h"
#include "client/remote/channel.h"
#include "client/remote/feature_sender.h"
#include "client/remote/followed_map.h"
#include "client/remote/remote_map_service.h"
#include "client/remote/server_token.h"

namespace cairn::client {

struct RemoteMapService::Stubs {
  explicit Stubs(const RemoteOptions& given)
      : options(given),
        channel(NewChannel(given)),
        maps(v1::Maps::NewStub(channel)),
        localize(v1::Localize::NewStub(channel)),
        sessions(v1::Sessions::NewStub(channel)),
        admin(v1::Admin::NewStub(channel)),
        status(v1::Status::NewStub(channel)) {}

  // One call with its deadline.
  template <class Function>
  absl::Status Call(Function&& call) const {
    return CallWithin(options.deadline_s, std::forward<Function>(call));
  }
  // One that goes over all of a map.
  template <class Function>
  absl::Status LongCall(Function&& call) const {
    return CallWithin(options.long_deadline_s, std::forward<Function>(call));
  }
  // The same of calls that only read.
  template <class Function>
  absl::Status Read(Function&& call) const {
    return ReadWithin(options.deadline_s, std::forward<Function>(call));
  }
  template <class Function>
  absl::Status LongRead(Function&& call) const {
    return ReadWithin(options.long_deadline_s, std::forward<Function>(call));
  }
  template <class Function>
  absl::Status ReadWithin(double deadline_s, const Function& call) const {
    Outage outage(options, channel.get());
    absl::Status done = CallWithin(deadline_s, call);
    while (answered && IsOutage(done) && outage.Wait(done)) done = CallWithin(deadline_s, call);
    if (!IsOutage(done)) answered = true;
    return done;
  }
  template <class Function>
  absl::Status CallWithin(double deadline_s, Function&& call) const {
    return Guarded([&] {
      return Patiently(options, [&] {
        return WithToken(options, [&] {
          grpc::ClientContext context;
          SetDeadline(deadline_s, &context);
          return FromGrpc(call(&context), options);
        });
      });
    });
  }

  // RemoteMapService::Localize().
  absl::StatusOr<api::LocalizeAnswer> Locate(const std::string& map, const api::LocalizeQuery& query);
  // The call, with what the query has: an image or features.
  absl::StatusOr<api::LocalizeAnswer> Ask(const std::string& map, const api::LocalizeQuery& query) const;
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) const;

  const RemoteOptions options;
  const std::shared_ptr<grpc::Channel> channel;
  const std::unique_ptr<v1::Maps::Stub> maps;
  const std::unique_ptr<v1::Localize::Stub> localize;
  const std::unique_ptr<v1::Sessions::Stub> sessions;
  const std::unique_ptr<v1::Admin::Stub> admin;
  const std::unique_ptr<v1::Status::Stub> status;

  mutable std::atomic<bool> answered = false;  // there is a server at that address, or was
  FeatureSender sender;
  std::mutex mutex;  // of the maps that are followed
  std::map<std::string, std::weak_ptr<FollowedMap>> followed;
};

}  // namespace cairn::client
