/// \mainpage
/// Where a camera is, asked of a map that is kept: cairn/map.h for C++, where everything begins, cairn.h for C. What
/// the words mean, and how to link the library, is in client.md beside the other documents.
///
/// \file
/// A map, and all that is asked of it. Includes the rest:
///
///     absl::StatusOr<cairn::Map> map = cairn::Map::Open("office.cairn");
///     if (!map.ok()) return map.status();
///     absl::StatusOr<cairn::Tracker> tracker = map->NewTracker(camera);
///     if (!tracker.ok()) return tracker.status();
///     absl::StatusOr<cairn::TrackAnswer> answer = tracker->Track(image, time_ns);
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cairn/call_options.h"
#include "cairn/camera.h"
#include "cairn/export.h"
#include "cairn/localizer.h"
#include "cairn/pose.h"
#include "cairn/status.h"
#include "cairn/tracker.h"
#include "cairn/version.h"

CAIRN_BEGIN_NAMESPACE

/// How the server of a map is asked (docs/server.md, "Security"); of no account for a file. What is left empty is taken
/// from the environment of the process.
struct ServerOptions {
  std::string token;             ///< that the server asks for; CAIRN_TOKEN
  std::string ca_file;           ///< PEM: the CA of its certificate; CAIRN_CA. It turns TLS on
  std::string certificate_file;  ///< PEM: the certificate that it asks for; CAIRN_CERT
  std::string key_file;          ///< PEM: its key; CAIRN_KEY
  bool tls = false;              ///< TLS, with a certificate of a CA that this machine trusts; CAIRN_TLS=1
  bool token_in_clear = false;   ///< send the token without TLS, also to other machines
};

/// How a map is opened; the defaults are meant for use.
struct MapOptions {
  /// Features looked for in the image of a Localizer; 0: as many as the map's keyframes were made with.
  int num_features = 0;
  /// Of a map "cairn://HOST:PORT/NAME".
  ServerOptions server;
};

/// A camera that made part of the map.
struct MapCamera {
  std::uint32_t id = 0;  ///< in the map
  std::string name;      ///< "cam0"
  Camera camera;         ///< as it was calibrated
};

/// A part of the map with a frame of its own. Its scale and origin are arbitrary until it is aligned to the world.
struct MapComponent {
  std::uint32_t id = 0;             ///< in the map; never used twice
  std::int64_t keyframes = 0;       ///< in it
  bool aligned = false;             ///< world_from_component is known
  Similarity world_from_component;  ///< puts it into the world, in metres
};

/// What a map is, in one revision.
struct MapInfo {
  std::string id;                        ///< 32 hex digits, from its creation on
  std::string name;                      ///< for people
  std::uint64_t revision = 0;            ///< every change adds one
  std::int64_t keyframes = 0;            ///< in all components
  std::int64_t points = 0;               ///< in all components
  std::vector<MapCamera> cameras;        ///< ascending by id
  std::vector<MapComponent> components;  ///< those that have keyframes, ascending by id
};

/// A map that is only read: not a byte of it changes. A copy is the same map. Thread-safe.
class CAIRN_API Map {
 public:
  /// Loads the newest revision of the map file at `path`; it may lie on a read-only medium, and another process may be
  /// writing it. All that is needed is in the file. "cairn://HOST:PORT/NAME" is a map of a server (cairnd): a copy of
  /// it is kept, and follows what changes there; while the server is out of reach, what is known answers. Errors:
  /// kNotFound, kInvalidArgument (no map, or options), kUnauthenticated (the server asks for a token), kDataLoss,
  /// kUnimplemented (a newer version), kFailedPrecondition (no vocabulary, a foreign log beside it), kPermissionDenied,
  /// kResourceExhausted, kUnavailable (no server), kDeadlineExceeded, kCancelled.
  static absl::StatusOr<Map> Open(const std::string& path, const MapOptions& options = {},
                                  const CallOptions& call = {}) noexcept;

  /// Of the revision that this map is at.
  absl::StatusOr<MapInfo> Info() const noexcept;

  /// Goes on to the newest revision if a writer has made one; true if so. Costs what has changed. Waits for calls of
  /// localizers that are under way, and they for it. Errors: kAborted (removed or replaced: open it again), kDataLoss,
  /// kUnavailable, kDeadlineExceeded, kCancelled; the map is then at the revision before.
  absl::StatusOr<bool> Refresh(const CallOptions& call = {}) const noexcept;

  /// Finds single images. Errors: kResourceExhausted; kFailedPrecondition on a moved-from map.
  absl::StatusOr<Localizer> NewLocalizer() const noexcept;

  /// Follows a stream of images of `camera`: any camera, not only one that made the map. A tracker goes on to newer
  /// revisions by itself. Errors: kInvalidArgument (camera), and those of Open().
  absl::StatusOr<Tracker> NewTracker(const Camera& camera, const TrackerOptions& options = {},
                                     const CallOptions& call = {}) const noexcept;

  /// \cond What the library has behind it; of no use to others.
  class CAIRN_HIDDEN Impl;
  CAIRN_HIDDEN explicit Map(std::shared_ptr<Impl> impl) noexcept;
  /// \endcond

 private:
  std::shared_ptr<Impl> impl_;
};

CAIRN_END_NAMESPACE
