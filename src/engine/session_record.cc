#include "engine/session_record.h"

#include <xxhash.h>

#include <algorithm>
#include <chrono>
#include <random>
#include <utility>

#include "absl/strings/str_format.h"
#include "base/version.h"
#include "map/camera_identity.h"
#include "map/edit.h"

namespace cairn::engine {

namespace {

// "pinhole 640x480, 525.0 px"
std::string Describe(const Camera& camera) {
  return absl::StrFormat("%s %dx%d, %.1f px", CameraModelName(camera.model), camera.width_px, camera.height_px,
                         camera.fx_px);
}

std::string InFull(const Camera& camera) {
  std::string text =
      absl::StrFormat("%s %dx%d, fx %g fy %g cx %g cy %g", CameraModelName(camera.model), camera.width_px,
                      camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
  for (const double coefficient : camera.distortion) absl::StrAppendFormat(&text, " %g", coefficient);
  return text;
}

}  // namespace

absl::StatusOr<CameraId> FindOrAddCamera(const std::string& name, const Camera& camera, const Pinhole& pinhole,
                                         map::Edit* edit) {
  const auto& cameras = edit->base().cameras();
  for (const auto& [id, known] : cameras) {
    // One whose images were made otherwise, by an earlier version, is another camera to what is in the map.
    if (!map::SameCalibration(known.model, camera) || !map::SamePinhole(known.pinhole, pinhole)) continue;
    if (name.empty() || name == known.name) return id;
    return absl::InvalidArgumentError(absl::StrCat("the map knows a camera of this calibration as \"", known.name,
                                                   "\", and not as \"", name,
                                                   "\": leave the name out, or give that one"));
  }
  const auto has_name = [&](const std::string& wanted) {
    return std::ranges::any_of(cameras, [&](const auto& entry) { return entry.second.name == wanted; });
  };
  if (!name.empty() && has_name(name)) {
    const auto other = std::ranges::find_if(cameras, [&](const auto& entry) { return entry.second.name == name; });
    return absl::InvalidArgumentError(absl::StrCat(
        "the camera ", name, " of the map is calibrated otherwise: there ", InFull(other->second.model), "; here ",
        InFull(camera), ". Use the calibration of the map, or another name if it is another camera"));
  }
  map::MapCamera added;
  added.name = name.empty() ? Describe(camera) : name;
  for (int number = 2; name.empty() && has_name(added.name); ++number) {
    added.name = absl::StrCat(Describe(camera), " (", number, ")");
  }
  added.model = camera;
  added.pinhole = pinhole;
  return edit->AddCamera(added);
}

absl::StatusOr<map::Session> BeginSession(const SessionSource& source, const Pinhole& pinhole, bool wall_clock,
                                          mapping::MapHead& head) {
  map::Edit edit(head.View()->snapshot());
  map::Session session;
  CAIRN_ASSIGN_OR_RETURN(session.camera, FindOrAddCamera(source.camera_name, source.camera, pinhole, &edit));
  session.source = source.name;
  session.software_version = kVersion;
  session.settings_json = source.settings_json;
  session.first_ns = source.first_ns;
  session.last_ns = source.first_ns;
  session.started_unix_ns = wall_clock ? UnixNowNs() : 0;
  session.policy = edit.base().keyframes().empty() ? map::SessionPolicy::kCreate : map::SessionPolicy::kExtend;
  session.id = edit.AddSession(session);
  edit.SetSession(session.id);
  CAIRN_RETURN_IF_ERROR(head.Commit(edit.Finish(absl::StrCat("begin session ", session.id.value())), {}));
  return session;
}

absl::Status EndSession(SessionId session_id, TimeNs last_ns, bool wall_clock,
                        std::optional<map::ReportedTrajectory> trajectory, mapping::MapHead& head) {
  map::Edit edit(head.View()->snapshot());
  map::Session session = edit.base().sessions().at(session_id);
  session.last_ns = last_ns;
  session.ended_unix_ns = wall_clock ? UnixNowNs() : 0;
  session.complete = true;
  session.result = ResultOf(edit.base(), session_id);
  session.trajectory = std::move(trajectory);
  edit.PutSession(session);
  edit.SetSession(session_id);
  return head.Commit(edit.Finish(absl::StrCat("end session ", session.id.value())), {});
}

map::SessionResult ResultOf(const map::Snapshot& map, SessionId session_id) {
  const map::Session& session = map.sessions().at(session_id);
  if (session.policy == map::SessionPolicy::kCreate) return map::SessionResult::kCreated;
  // Components that were there before it began, or that others have begun since.
  for (const ComponentId id : session.components) {
    const auto component = map.components().find(id);
    if (component != map.components().end() && component->second.session != session_id) {
      return map::SessionResult::kLocated;
    }
  }
  return map::SessionResult::kApart;
}

std::string NewMapId(const std::optional<std::string>& deterministic_seed) {
  std::uint64_t high = 0, low = 0;
  if (deterministic_seed) {
    const XXH128_hash_t hash = XXH3_128bits(deterministic_seed->data(), deterministic_seed->size());
    high = hash.high64;
    low = hash.low64;
  } else {
    std::random_device device;
    for (int i = 0; i < 2; ++i) {
      high = (high << 32) | device();
      low = (low << 32) | device();
    }
  }
  return absl::StrCat(absl::Hex(high, absl::kZeroPad16), absl::Hex(low, absl::kZeroPad16));
}

std::int64_t UnixNowNs() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace cairn::engine
