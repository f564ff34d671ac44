#include "client/remote/remote_map_service.h"

#include <utility>

#include "base/guarded.h"
#include "client/local_tracker.h"
#include "client/query_image.h"
#include "client/remote/followed_map.h"
#include "client/remote/region_tracker.h"
#include "client/remote/remote_session.h"
#include "client/remote/served_tracker.h"
#include "client/remote/stubs.h"
#include "client/view_feed.h"
#include "wire/addresses.h"
#include "wire/convert.h"

namespace cairn::client {

absl::StatusOr<api::LocalizeAnswer> RemoteMapService::Stubs::Locate(const std::string& map,
                                                                    const api::LocalizeQuery& query) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  if (!options.send_features || query.features) return Ask(map, query);
  return Guarded([&] {
    return sender.Localize(
        map, query, [&] { return Describe(map); }, [&](const api::LocalizeQuery& sent) { return Ask(map, sent); });
  });
}

absl::StatusOr<api::LocalizeAnswer> RemoteMapService::Stubs::Ask(const std::string& map,
                                                                 const api::LocalizeQuery& query) const {
  if (!query.features) CAIRN_RETURN_IF_ERROR(CheckImage(query.image, query.camera, "localize"));
  v1::LocalizeImageRequest request;
  request.set_map(map);
  if (query.features) {
    wire::ToProto(*query.features, request.mutable_features());
  } else {
    wire::ToProto(query.image, request.mutable_image());
  }
  wire::ToProto(query.camera, request.mutable_camera());
  request.set_time_ns(query.time_ns);
  if (query.prior) wire::ToProto(*query.prior, request.mutable_prior());
  v1::LocalizeImageResponse response;
  CAIRN_RETURN_IF_ERROR(Read([&](auto* call) { return localize->LocalizeImage(call, request, &response); }));
  return wire::FromProto(response);
}

absl::Status RemoteOptions::Validate() const {
  if (server.empty()) return absl::InvalidArgumentError("server: name it as HOST:PORT");
  CAIRN_RETURN_IF_ERROR(wire::CheckAddress(wire::WithPort(server)));
  if (!(deadline_s > 0.0)) return absl::InvalidArgumentError("server: deadline_s must be positive");
  if (!(long_deadline_s > 0.0)) return absl::InvalidArgumentError("server: long_deadline_s must be positive");
  if (!(outage_s >= 0.0)) return absl::InvalidArgumentError("server: outage_s must not be negative");
  if (attempts < 1 || attempts > 5) return absl::InvalidArgumentError("server: attempts must be 1 to 5");
  CAIRN_RETURN_IF_ERROR(CheckToken(token));
  if (!token.empty() && !tls && !token_in_clear && !wire::IsLoopback(server)) {
    return absl::FailedPreconditionError(
        absl::StrCat("the token is not sent to ", server,
                     " without TLS, as whoever listens on the way would have it: give --ca FILE or --tls, or say "
                     "--token-in-clear"));
  }
  if (max_copied_keyframes < 1) return absl::InvalidArgumentError("server: max_copied_keyframes must be positive");
  return tracker.Validate();
}

RemoteMapService::RemoteMapService(std::shared_ptr<Stubs> stubs) : stubs_(std::move(stubs)) {}
RemoteMapService::~RemoteMapService() = default;

absl::StatusOr<std::unique_ptr<RemoteMapService>> RemoteMapService::Connect(const RemoteOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<RemoteMapService>> {
    RemoteOptions resolved = options;
    resolved.server = wire::WithPort(options.server);
    resolved.shown = std::make_shared<ServerToken>(options);
    return std::unique_ptr<RemoteMapService>(new RemoteMapService(std::make_shared<Stubs>(resolved)));
  });
}

absl::StatusOr<std::vector<api::MapSummary>> RemoteMapService::List() {
  v1::ListMapsResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Read([&](auto* call) { return stubs_->maps->ListMaps(call, {}, &response); }));
  std::vector<api::MapSummary> maps;
  for (const v1::MapSummary& map : response.maps()) {
    CAIRN_ASSIGN_OR_RETURN(maps.emplace_back(), wire::FromProto(map));
  }
  return maps;
}

absl::StatusOr<api::MapDescription> RemoteMapService::Describe(const std::string& map) { return stubs_->Describe(map); }

absl::StatusOr<api::MapDescription> RemoteMapService::Stubs::Describe(const std::string& map) const {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));  // what is no text cannot be sent as one
  v1::DescribeMapRequest request;
  request.set_map(map);
  v1::DescribeMapResponse response;
  CAIRN_RETURN_IF_ERROR(Read([&](auto* call) { return maps->DescribeMap(call, request, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<api::LocalizeAnswer> RemoteMapService::Localize(const std::string& map,
                                                               const api::LocalizeQuery& query) {
  return stubs_->Locate(map, query);
}

absl::StatusOr<api::AcrossAnswer> RemoteMapService::LocalizeAcross(const std::vector<std::string>& maps,
                                                                   const api::LocalizeQuery& query) {
  if (query.prior) return absl::InvalidArgumentError("localize: a prior is of one map, not of several");
  if (!query.features) CAIRN_RETURN_IF_ERROR(CheckImage(query.image, query.camera, "localize"));
  v1::LocalizeInMapsRequest request;
  for (const std::string& map : maps) {
    CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
    request.add_maps(map);
  }
  if (query.features) {
    wire::ToProto(*query.features, request.mutable_features());
  } else {
    wire::ToProto(query.image, request.mutable_image());
  }
  wire::ToProto(query.camera, request.mutable_camera());
  request.set_time_ns(query.time_ns);
  v1::LocalizeInMapsResponse response;
  CAIRN_RETURN_IF_ERROR(
      stubs_->LongRead([&](auto* call) { return stubs_->localize->LocalizeInMaps(call, request, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<std::unique_ptr<api::Tracker>> RemoteMapService::NewTracker(const std::string& map,
                                                                           const Camera& camera) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<api::Tracker>> {
    if (stubs_->options.track_at == TrackAt::kServer) {
      return ServedTracker::Start(stubs_->options, stubs_->channel, map, camera);
    }
    CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), "track"));  // before the map comes
    CAIRN_ASSIGN_OR_RETURN(const api::MapDescription there, Describe(map));
    if (there.summary.keyframes > stubs_->options.max_copied_keyframes) return NewTrackerInRegion(map, camera);
    CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<FollowedMap> followed, CopyOf(map));
    return LocalTracker::Open(followed->NewReader(), camera, stubs_->options.tracker);
  });
}

absl::StatusOr<std::unique_ptr<api::Tracker>> RemoteMapService::NewTrackerInRegion(const std::string& map,
                                                                                   const Camera& camera) {
  RegionTracker::Server server;
  server.localize = [stubs = stubs_, map](const api::LocalizeQuery& query) { return stubs->Locate(map, query); };
  server.follow = [stubs = stubs_, map](const map::RegionQuery& region) {
    return FollowedMap::Start(stubs->options, stubs->channel, map, region);
  };
  return RegionTracker::Create(std::move(server), camera, stubs_->options.tracker,
                               stubs_->options.max_copied_keyframes);
}

absl::StatusOr<std::shared_ptr<FollowedMap>> RemoteMapService::CopyOf(const std::string& map) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  return Guarded([&]() -> absl::StatusOr<std::shared_ptr<FollowedMap>> {
    const std::lock_guard lock(stubs_->mutex);  // others that want the same map wait for it
    std::weak_ptr<FollowedMap>& known = stubs_->followed[map];
    if (std::shared_ptr<FollowedMap> followed = known.lock()) return followed;
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<FollowedMap> followed,
                           FollowedMap::Start(stubs_->options, stubs_->channel, map));
    known = followed;
    return followed;
  });
}

absl::StatusOr<std::unique_ptr<api::MapFeed>> RemoteMapService::Follow(const std::string& map,
                                                                       const api::FollowRequest& request) {
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<FollowedMap> copy, CopyOf(map));
  FeedSource source;
  source.newest = [copy]() -> absl::StatusOr<std::shared_ptr<const tracking::MapView>> { return copy->view(); };
  source.wait = [copy](Revision seen, FeedSource::Clock::time_point until) { copy->WaitFor(seen + 1, until); };
  return std::make_unique<ViewFeed>(std::move(source), request);
}

absl::StatusOr<std::unique_ptr<api::MapSession>> RemoteMapService::StartSession(const api::SessionRequest& request) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(request.map));
  return Guarded([&] { return RemoteSession::Start(stubs_->options, stubs_->channel, request); });
}

absl::StatusOr<std::unique_ptr<api::MapSession>> RemoteMapService::ResumeSession(const std::string& token) {
  return Guarded([&] { return RemoteSession::Resume(stubs_->options, stubs_->channel, token); });
}

absl::StatusOr<std::unique_ptr<RemoteLocalizer>> RemoteLocalizer::Connect(const RemoteOptions& options,
                                                                          const std::string& map) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<RemoteMapService> service, RemoteMapService::Connect(options));
  return std::unique_ptr<RemoteLocalizer>(new RemoteLocalizer(std::move(service), map));
}

}  // namespace cairn::client
