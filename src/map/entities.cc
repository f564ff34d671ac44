#include "map/entities.h"

#include <cmath>

namespace cairn::map {
namespace {

bool Same(const Sim3& a, const Sim3& b) {
  return a.scale() == b.scale() && a.rotation().coeffs() == b.rotation().coeffs() && a.translation() == b.translation();
}

}  // namespace

bool ComponentJoin::operator==(const ComponentJoin& other) const {
  return into == other.into && Same(into_from_component, other.into_from_component) && keyframe == other.keyframe &&
         into_keyframe == other.into_keyframe && keyframe_time_ns == other.keyframe_time_ns &&
         matches == other.matches && keyframes_agreeing == other.keyframes_agreeing &&
         keyframes_checked == other.keyframes_checked && revision == other.revision &&
         joined_unix_ns == other.joined_unix_ns;
}

bool Component::operator==(const Component& other) const {
  if (world_from_component.has_value() != other.world_from_component.has_value()) return false;
  if (world_from_component && !Same(*world_from_component, *other.world_from_component)) return false;
  return id == other.id && session == other.session && joined == other.joined;
}

absl::Status GeoAnchor::Validate() const {
  const auto bad = [](const char* what) {
    return absl::InvalidArgumentError(absl::StrCat("geographic anchor: ", what));
  };
  if (!(latitude_deg >= -90.0 && latitude_deg <= 90.0)) return bad("the latitude must be between -90 and 90 degrees");
  if (!(longitude_deg >= -180.0 && longitude_deg <= 180.0)) {
    return bad("the longitude must be between -180 and 180 degrees");
  }
  if (!(std::abs(height_m) <= 1e5)) return bad("the height must be within 100 km of the ellipsoid");
  if (!(std::abs(enu_from_world.norm() - 1.0) < 1e-6)) return bad("enu_from_world must be a unit quaternion");
  return absl::OkStatus();
}

const char* SessionPolicyName(SessionPolicy policy) { return policy == SessionPolicy::kExtend ? "extend" : "create"; }

const char* SessionResultName(SessionResult result) {
  switch (result) {
    case SessionResult::kUnknown:
      return "unknown";
    case SessionResult::kCreated:
      return "created";
    case SessionResult::kLocated:
      return "located";
    case SessionResult::kApart:
      return "apart";
  }
  return "unknown";
}

}  // namespace cairn::map
