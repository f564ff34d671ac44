// The maps that somebody keeps: a directory in this process, or a daemon. Coarse calls with values; a map is named as
// its file is, without ".cairn".
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "api/localizer.h"
#include "api/map_feed.h"
#include "api/map_session.h"
#include "api/tracker.h"
#include "base/ids.h"
#include "base/status.h"
#include "map/entities.h"

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
  bool open = false;     // in the memory of who keeps it
  bool writing = false;  // sessions are extending it
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
