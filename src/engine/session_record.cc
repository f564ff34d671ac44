#include "engine/session_record.h"

#include <xxhash.h>

#include <chrono>
#include <random>
#include <utility>

#include "base/version.h"
#include "map/edit.h"

namespace cairn::engine {

absl::StatusOr<map::Session> BeginSession(const SessionSource& source, const Pinhole& pinhole, bool wall_clock,
                                          MapWriter* writer) {
  map::Edit edit(writer->Current());
  map::MapCamera camera;
  camera.name = source.name;
  camera.model = source.camera;
  camera.pinhole = pinhole;
  map::Session session;
  session.camera = edit.AddCamera(camera);
  session.source = source.name;
  session.software_version = kVersion;
  session.settings_json = source.settings_json;
  session.first_ns = source.first_ns;
  session.last_ns = source.first_ns;
  session.started_unix_ns = wall_clock ? UnixNowNs() : 0;
  session.id = edit.AddSession(session);
  CAIRN_RETURN_IF_ERROR(writer->Commit(edit.Finish(absl::StrCat("begin session ", session.id.value()))).status());
  return session;
}

absl::Status EndSession(SessionId session_id, TimeNs last_ns, bool wall_clock,
                        std::optional<map::ReportedTrajectory> trajectory, MapWriter* writer) {
  map::Edit edit(writer->Current());
  map::Session session = edit.base().sessions().at(session_id);
  session.last_ns = last_ns;
  session.ended_unix_ns = wall_clock ? UnixNowNs() : 0;
  session.complete = true;
  session.trajectory = std::move(trajectory);
  edit.PutSession(session);
  return writer->Commit(edit.Finish(absl::StrCat("end session ", session.id.value()))).status();
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
