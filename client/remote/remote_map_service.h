// The maps of a cairnd, asked over gRPC. Nothing is connected before the first call, and a connection that is lost is
// made again by the next one.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "api/map_service.h"
#include "api/server_status.h"
#include "base/status.h"
#include "client/local_tracker_options.h"
#include "client/remote/client_tls.h"

namespace cairn::client {

class FollowedMap;
class ServerToken;

// Where the frames of a tracker are tracked.
enum class TrackAt {
  kClient,  // in a copy of the map that follows the server's: no frame is sent, and an outage is got through
  kServer,  // each frame is sent there: for clients that have neither the memory for the map nor the processor
};

struct RemoteOptions {
  std::string server = "localhost:7878";  // HOST, HOST:PORT, or unix:/path
  double deadline_s = 30.0;               // of each call, retries included
  double long_deadline_s = 1800.0;        // of calls that go over all of a map: copies, checks, files
  // A call that only reads is made again when the server could not be reached, so often in all, after 0.1 to 1 s.
  int attempts = 4;
  // A session or a tracker at the server whose connection breaks tries so long to go on, as do calls that only read,
  // once the server has answered before: one that is started again is back within a second or two.
  double outage_s = 30.0;
  // So long, too, a call is made again that the server refuses for now, as this client asks too much: when it says.
  // Told why an outage begins; by the thread whose call it is.
  std::function<void(const absl::Status&)> on_outage;
  // Asked meanwhile, again and again: true ends the wait (Ctrl-C). By the thread whose call it is.
  std::function<bool()> give_up;
  TrackAt track_at = TrackAt::kClient;
  LocalTrackerOptions tracker;  // of those at the client
  // Of a larger map they keep a part with so many keyframes, around the camera (client/remote/region_tracker.h); 150 kB
  // each, as a rule.
  int max_copied_keyframes = 2000;

  // Of an image that is to be located in one map, send its features in place of its pixels: they are extracted here, as
  // those of the map were (client/remote/feature_sender.h).
  bool send_features = false;

  // Sent with every call; empty: none. Without TLS it goes to this machine only, unless `token_in_clear`.
  std::string token;
  bool token_in_clear = false;
  // Where `token` came from, which may have another one by now: asked once the server does not know the one that it was
  // shown, before the call is given up. By any thread. May be empty.
  std::function<absl::StatusOr<std::string>()> read_token;
  std::shared_ptr<ServerToken> shown;  // by all calls over one connection; made with that, not by who sets options
  std::optional<ClientTls> tls;        // none: not encrypted. A Unix socket never is

  absl::Status Validate() const;
};

// InvalidArgument for what is no token; empty: none.
absl::Status CheckToken(const std::string& token);

class RemoteMapService : public api::MapService {
 public:
  static absl::StatusOr<std::unique_ptr<RemoteMapService>> Connect(const RemoteOptions& options);
  ~RemoteMapService() override;

  // Further errors: Unavailable (no server there), DeadlineExceeded.
  absl::StatusOr<std::vector<api::MapSummary>> List() override;
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) override;
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& query) override;
  absl::StatusOr<api::AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                   const api::LocalizeQuery& query) override;
  // RemoteOptions says where it tracks: here, in a copy of the map, of which there is one for all trackers in it
  // (client/remote/followed_map.h), or there (client/remote/served_tracker.h).
  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTracker(const std::string& map, const Camera& camera) override;
  // The copy: begun, or the one that others have already.
  absl::StatusOr<std::shared_ptr<FollowedMap>> CopyOf(const std::string& map);
  // Over a copy: the first step is all of it, unless the follower has just that.
  absl::StatusOr<std::unique_ptr<api::MapFeed>> Follow(const std::string& map,
                                                       const api::FollowRequest& request) override;
  // Sessions survive broken connections and restarts of the server (client/remote/remote_session.h).
  absl::StatusOr<std::unique_ptr<api::MapSession>> StartSession(const api::SessionRequest& request) override;
  absl::StatusOr<std::unique_ptr<api::MapSession>> ResumeSession(const std::string& token) override;
  absl::StatusOr<std::vector<api::ActiveSession>> Sessions(const std::string& map) override;

  absl::StatusOr<api::MapSummary> Create(const std::string& map, const std::string& title) override;
  absl::StatusOr<api::MapSummary> Snapshot(const std::string& map, const std::string& as) override;
  absl::StatusOr<std::string> Delete(const std::string& map) override;
  absl::StatusOr<std::vector<api::DeletedMap>> ListDeleted() override;
  absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) override;
  absl::StatusOr<api::MapVerification> Verify(const std::string& map, api::VerifyDepth depth) override;
  absl::StatusOr<api::AlignAnswer> Align(const std::string& map, const api::AlignRequest& request) override;
  absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session) override;
  absl::StatusOr<map::MapOverview> Overview(const std::string& map) override;
  absl::StatusOr<api::MapLog> Log(const std::string& map, const map::ChangeQuery& query) override;
  absl::Status Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) override;

  // How the server is doing.
  absl::StatusOr<api::ServerStatus> Status();

 private:
  struct Stubs;
  explicit RemoteMapService(std::shared_ptr<Stubs> stubs);
  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTrackerInRegion(const std::string& map, const Camera& camera);
  const std::shared_ptr<Stubs> stubs_;  // trackers in a region keep it, too
};

// One map of a server.
class RemoteLocalizer : public api::Localizer {
 public:
  static absl::StatusOr<std::unique_ptr<RemoteLocalizer>> Connect(const RemoteOptions& options, const std::string& map);
  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer_.Localize(query);
  }

 private:
  RemoteLocalizer(std::unique_ptr<RemoteMapService> service, const std::string& map)
      : service_(std::move(service)), localizer_(service_.get(), map) {}
  const std::unique_ptr<RemoteMapService> service_;
  api::ServedLocalizer localizer_;
};

}  // namespace cairn::client
