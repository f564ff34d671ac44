// The maps that somebody keeps: a directory in this process, or a daemon. Coarse calls with values; a map is named as
// its file is, without ".cairn".
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "api/active_session.h"
#include "api/localize_across.h"
#include "api/localizer.h"
#include "api/map_admin.h"
#include "api/map_alignment.h"
#include "api/map_feed.h"
#include "api/map_session.h"
#include "api/tracker.h"
#include "base/ids.h"
#include "base/status.h"
#include "map/entities.h"
#include "map/overview.h"

namespace cairn::api {

// Sizes of a map at one revision.
struct MapSummary {
  std::string name;
  // Why it cannot be read; OK for all others. Of a map that cannot be read only the name is known.
  absl::Status status;
  std::string id;     // 32 hex digits, fixed when it was made
  std::string title;  // that it was given when it was made
  Revision revision = 0;
  int format_version = 0;
  std::int64_t keyframes = 0;
  std::int64_t points = 0;
  std::int64_t cameras = 0;
  std::int64_t components = 0;  // those that were joined to others included
  std::int64_t sessions = 0;
  std::int64_t file_bytes = 0;
  bool open = false;                         // in the memory of who keeps it
  bool writing = false;                      // sessions are extending it
  std::optional<map::GeoAnchor> geo_anchor;  // none: it is not known where on the earth it is
};

// A camera that sessions of the map were made with.
struct CameraInfo {
  CameraId id;
  std::string name;
  Camera camera;                // as calibrated, of the raw images
  bool lens_corrected = false;  // a session has found what the calibration left over
  bool operator==(const CameraInfo&) const = default;
};

struct ComponentInfo {
  ComponentId id;
  SessionId session;  // that began it
  std::int64_t keyframes = 0;
  std::optional<Sim3> world_from_component;  // none: not aligned
  ComponentId joined_into;                   // none: it stands by itself
};

// One map, with what is known of its cameras and sessions.
struct MapDescription {
  MapSummary summary;
  std::vector<CameraInfo> cameras;        // ascending by id, as the others
  std::vector<ComponentInfo> components;  // those that were joined to others included
  std::vector<map::Session> sessions;     // without their loops, settings and trajectories
  image::OrbParameters orb;               // how the features of its keyframes were extracted
};

struct MapVerification {
  std::optional<MapSummary> summary;   // none: not even that could be read
  std::vector<map::Finding> findings;  // none: the map is good
  std::vector<std::string> notes;      // what a user should know, but no damage
};

// Safe from several threads at once.
class MapService {
 public:
  virtual ~MapService() = default;

  // By name, ascending.
  virtual absl::StatusOr<std::vector<MapSummary>> List() = 0;

  // NotFound if there is no map of that name; errors of the store (damaged, newer version, ...) as they are;
  // InvalidArgument for what is no name.
  virtual absl::StatusOr<MapDescription> Describe(const std::string& map) = 0;

  // As Localizer::Localize(), against the newest revision; further errors as of Describe().
  virtual absl::StatusOr<LocalizeAnswer> Localize(const std::string& map, const LocalizeQuery& query) = 0;

  // The same against several maps; without any against all, of which there may be kMaxMapsAcross. Of those that cannot
  // be read the status says why. Priors are of one map: InvalidArgument with one, and for more maps than that.
  virtual absl::StatusOr<AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                      const LocalizeQuery& query) = 0;

  // Finds itself in the newest revision and follows those after it. Errors as of Describe(); InvalidArgument for a
  // camera that makes no sense.
  virtual absl::StatusOr<std::unique_ptr<Tracker>> NewTracker(const std::string& map, const Camera& camera) = 0;

  // All of it, or from what the follower has on. The service must outlive the feed. Errors as of Describe().
  virtual absl::StatusOr<std::unique_ptr<MapFeed>> Follow(const std::string& map, const FollowRequest& request) = 0;

  // The service must outlive the session. AlreadyExists if the map to create is there, NotFound if the one to extend is
  // not; InvalidArgument for a camera that makes no sense or contradicts one of the map; ResourceExhausted if there are
  // too many sessions already.
  virtual absl::StatusOr<std::unique_ptr<MapSession>> StartSession(const SessionRequest& request) = 0;
  // One that was let go of. NotFound if there is none of this token (any more), FailedPrecondition if it is not let go.
  virtual absl::StatusOr<std::unique_ptr<MapSession>> ResumeSession(const std::string& token) = 0;
  // Those that are running, by map, then by their start; with a name those of that map. Errors as of Describe(), but
  // for a map that a session is making there need be no file yet.
  virtual absl::StatusOr<std::vector<ActiveSession>> Sessions(const std::string& map) = 0;

  // What follows is for those who keep the maps; errors as of Describe().

  // A map without keyframes. AlreadyExists if there is one. `title`: empty: its name.
  virtual absl::StatusOr<MapSummary> Create(const std::string& map, const std::string& title) = 0;
  // Copies the newest durable revision, while sessions may go on writing. AlreadyExists if there is a map `as`. Of the
  // copy.
  virtual absl::StatusOr<MapSummary> Snapshot(const std::string& map, const std::string& as) = 0;
  // Moves it to the trash; the name by which it is restored. FailedPrecondition while sessions extend it, Unavailable
  // while another process does.
  virtual absl::StatusOr<std::string> Delete(const std::string& map) = 0;
  // What is in the trash, by time.
  virtual absl::StatusOr<std::vector<DeletedMap>> ListDeleted() = 0;
  // `as` empty: under the name that it had. That name. NotFound if it is not in the trash, AlreadyExists if there is a
  // map of that name.
  virtual absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) = 0;
  // One screen about it, as store::ReadMapOverview: only a sample of its keyframes is looked at.
  virtual absl::StatusOr<map::MapOverview> Overview(const std::string& map) = 0;
  // Reads all of it. What keeps a map from being opened is a finding as well.
  virtual absl::StatusOr<MapVerification> Verify(const std::string& map, VerifyDepth depth) = 0;
  // Further errors as of engine::AlignMap.
  virtual absl::StatusOr<AlignAnswer> Align(const std::string& map, const AlignRequest& request) = 0;
  // Takes a session's keyframes and points out, and adjusts what the others saw of the same places. NotFound for a
  // session that there is not, FailedPrecondition for one that is running or was removed already.
  virtual absl::StatusOr<SessionRemoval> RemoveSession(const std::string& map, SessionId session) = 0;
  virtual absl::StatusOr<MapLog> Log(const std::string& map, const map::ChangeQuery& query) = 0;
  // Of the newest durable revision.
  virtual absl::Status Export(const std::string& map, ExportContent content, const ExportSink& sink) = 0;
};

// InvalidArgument unless it is a name: letters, digits, '.', '_' and '-', 1 to 128 of them, the first one a letter or a
// digit. So it stays in its directory.
absl::Status CheckMapName(const std::string& name);

// One map of a service, asked as a Localizer. The service must outlive it.
class ServedLocalizer : public Localizer {
 public:
  ServedLocalizer(MapService* service, std::string map) : service_(service), map_(std::move(map)) {}
  absl::StatusOr<LocalizeAnswer> Localize(const LocalizeQuery& query) override {
    return service_->Localize(map_, query);
  }

 private:
  MapService* const service_;
  const std::string map_;
};

}  // namespace cairn::api
