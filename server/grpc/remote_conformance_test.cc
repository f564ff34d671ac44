// Remote equals local: the conformance suites, asked over gRPC.
#include "client/conformance/localizer_conformance.h"
#include "client/conformance/map_admin_conformance.h"
#include "client/conformance/map_service_conformance.h"
#include "client/conformance/tracker_conformance.h"
#include "server/grpc/testing_server.h"

namespace cairn::conformance {
namespace {

// Each keeps the server that it asks.

struct ServiceWithServer : public api::MapService {
  absl::StatusOr<std::vector<api::MapSummary>> List() override { return service->List(); }
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) override { return service->Describe(map); }
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& query) override {
    return service->Localize(map, query);
  }
  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTracker(const std::string& map, const Camera& camera) override {
    return service->NewTracker(map, camera);
  }
  absl::StatusOr<std::unique_ptr<api::MapFeed>> Follow(const std::string& map,
                                                       const api::FollowRequest& request) override {
    return service->Follow(map, request);
  }
  absl::StatusOr<std::unique_ptr<api::MapSession>> StartSession(const api::SessionRequest& request) override {
    return service->StartSession(request);
  }
  absl::StatusOr<std::unique_ptr<api::MapSession>> ResumeSession(const std::string& token) override {
    return service->ResumeSession(token);
  }
  absl::StatusOr<api::AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                   const api::LocalizeQuery& query) override {
    return service->LocalizeAcross(maps, query);
  }
  absl::StatusOr<std::vector<api::ActiveSession>> Sessions(const std::string& map) override {
    return service->Sessions(map);
  }
  absl::StatusOr<api::MapSummary> Create(const std::string& map, const std::string& title) override {
    return service->Create(map, title);
  }
  absl::StatusOr<api::MapSummary> Snapshot(const std::string& map, const std::string& as) override {
    return service->Snapshot(map, as);
  }
  absl::StatusOr<std::string> Delete(const std::string& map) override { return service->Delete(map); }
  absl::StatusOr<std::vector<api::DeletedMap>> ListDeleted() override { return service->ListDeleted(); }
  absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) override {
    return service->Restore(deleted, as);
  }
  absl::StatusOr<api::MapVerification> Verify(const std::string& map, api::VerifyDepth depth) override {
    return service->Verify(map, depth);
  }
  absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session) override {
    return service->RemoveSession(map, session);
  }
  absl::StatusOr<api::AlignAnswer> Align(const std::string& map, const api::AlignRequest& request) override {
    return service->Align(map, request);
  }
  absl::StatusOr<map::MapOverview> Overview(const std::string& map) override { return service->Overview(map); }
  absl::StatusOr<api::MapLog> Log(const std::string& map, const map::ChangeQuery& query) override {
    return service->Log(map, query);
  }
  absl::Status Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) override {
    return service->Export(map, content, sink);
  }

  std::unique_ptr<server::TestingServer> server;
  std::unique_ptr<client::RemoteMapService> service;
};

struct LocalizerWithServer : public api::Localizer {
  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer->Localize(query);
  }

  std::unique_ptr<server::TestingServer> server;
  std::unique_ptr<client::RemoteLocalizer> localizer;
};

absl::StatusOr<std::unique_ptr<api::MapService>> ConnectService(const std::string& directory) {
  auto made = std::make_unique<ServiceWithServer>();
  CAIRN_ASSIGN_OR_RETURN(made->server, server::TestingServer::Start(directory));
  CAIRN_ASSIGN_OR_RETURN(made->service, client::RemoteMapService::Connect(made->server->Remote()));
  return made;
}

template <bool kSendFeatures>
absl::StatusOr<std::unique_ptr<api::Localizer>> ConnectLocalizer(const std::string& path) {
  const std::filesystem::path file(path);
  auto made = std::make_unique<LocalizerWithServer>();
  CAIRN_ASSIGN_OR_RETURN(made->server, server::TestingServer::Start(file.parent_path().string()));
  client::RemoteOptions options = made->server->Remote();
  options.send_features = kSendFeatures;
  CAIRN_ASSIGN_OR_RETURN(made->localizer, client::RemoteLocalizer::Connect(options, file.stem().string()));
  return made;
}

struct TrackerWithServer : public api::Tracker {
  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override { return tracker->Track(frame); }

  std::unique_ptr<server::TestingServer> server;
  std::unique_ptr<client::RemoteMapService> service;
  std::unique_ptr<api::Tracker> tracker;
};

constexpr int kFewKeyframes = 4;  // of those of the map

template <client::TrackAt kWhere, client::TrackMode kMode = client::TrackMode::kSemiDirect, int kMaxKeyframes = 1000>
absl::StatusOr<std::unique_ptr<api::Tracker>> ConnectTracker(const std::string& path, const Camera& camera) {
  const std::filesystem::path file(path);
  auto made = std::make_unique<TrackerWithServer>();
  CAIRN_ASSIGN_OR_RETURN(made->server, server::TestingServer::Start(file.parent_path().string()));
  client::RemoteOptions options = made->server->Remote();
  options.track_at = kWhere;
  options.tracker.mode = kMode;
  options.max_copied_keyframes = kMaxKeyframes;
  CAIRN_ASSIGN_OR_RETURN(made->service, client::RemoteMapService::Connect(options));
  CAIRN_ASSIGN_OR_RETURN(made->tracker, made->service->NewTracker(file.stem().string(), camera));
  return made;
}

INSTANTIATE_TEST_SUITE_P(
    Remote, TrackerConformance,
    testing::Values(TrackerCase{"AtTheServer", &ConnectTracker<client::TrackAt::kServer>, true},
                    TrackerCase{"AtTheClient", &ConnectTracker<client::TrackAt::kClient>, true},
                    TrackerCase{"AtTheClientByFeatures",
                                &ConnectTracker<client::TrackAt::kClient, client::TrackMode::kFeatures>, false}),
    [](const auto& parameter) { return parameter.param.name; });
INSTANTIATE_TEST_SUITE_P(Remote, LocalizerConformance, testing::Values(LocalizerFactory(&ConnectLocalizer<false>)));
INSTANTIATE_TEST_SUITE_P(RemoteByFeatures, LocalizerConformance,
                         testing::Values(LocalizerFactory(&ConnectLocalizer<true>)));
INSTANTIATE_TEST_SUITE_P(Remote, MapServiceConformance, testing::Values(MapServiceFactory(&ConnectService)));
INSTANTIATE_TEST_SUITE_P(Remote, MapAdminConformance, testing::Values(MapServiceFactory(&ConnectService)));
INSTANTIATE_TEST_SUITE_P(Remote, MapSessionConformance, testing::Values(MapServiceFactory(&ConnectService)));

}  // namespace
}  // namespace cairn::conformance
