#include "cli/session_report.h"

#include <cstdio>
#include <numbers>

#include "text/text.h"

namespace cairn::cli {
namespace {

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;

}  // namespace

nlohmann::ordered_json LoopsAsJson(const map::Session& session) {
  nlohmann::ordered_json loops = nlohmann::ordered_json::array();
  for (const map::ClosedLoop& loop : session.loops) {
    loops.push_back({{"keyframe", loop.keyframe.value()},
                     {"at_s", ToSeconds(loop.keyframe_time_ns - session.first_ns)},
                     {"loop_keyframe", loop.loop_keyframe.value()},
                     {"loop_at_s", ToSeconds(loop.loop_time_ns - session.first_ns)},
                     {"matches", loop.matches},
                     {"scale", loop.scale},
                     {"shift", loop.shift},
                     {"frame", "map"},
                     {"unit", "map units"},
                     {"turn_deg", loop.turn_rad * kDegreesPerRadian},
                     {"way", loop.way}});
  }
  return loops;
}

nlohmann::ordered_json TrajectoryAsJson(const map::Session& session) {
  if (!session.trajectory) return nullptr;
  return {{"reported", session.trajectory->refined ? "refined" : "direct"},
          {"keyframes", session.trajectory->keyframes},
          {"collinear", session.trajectory->collinear},
          {"reason", session.trajectory->reason}};
}

nlohmann::ordered_json SettingsAsJson(const map::Session& session) {
  auto settings = nlohmann::ordered_json::parse(session.settings_json, nullptr, /*allow_exceptions=*/false);
  return settings.is_discarded() ? nlohmann::ordered_json(nullptr) : settings;
}

nlohmann::ordered_json LensAsJson(const std::optional<mapping::LensReport>& lens) {
  if (!lens) return nullptr;
  return {{"corrected", lens->applied},
          {"focal_scale", lens->lens.focal_scale},
          {"k1", lens->lens.k1},
          {"k2", lens->lens.k2},
          {"shift_rms_px", lens->shift.rms_px},
          {"shift_max_px", lens->shift.max_px},
          {"gain", lens->gain},
          {"reason", lens->reason}};
}

nlohmann::ordered_json LensAsJson(const map::MapCamera& camera) {
  if (!camera.lens) return nullptr;
  const LensCorrection::Shift shift = camera.lens->ShiftOver(camera.pinhole);
  return {{"focal_scale", camera.lens->focal_scale},
          {"k1", camera.lens->k1},
          {"k2", camera.lens->k2},
          {"shift_rms_px", shift.rms_px},
          {"shift_max_px", shift.max_px}};
}

void PrintLoopsAndTrajectory(const map::Session& session, const char* indent) {
  for (const map::ClosedLoop& loop : session.loops) {
    std::printf("%sloop closed at %.1f s to %.1f s (keyframe %u to %u): %d matches;\n", indent,
                ToSeconds(loop.keyframe_time_ns - session.first_ns), ToSeconds(loop.loop_time_ns - session.first_ns),
                loop.keyframe.value(), loop.loop_keyframe.value(), loop.matches);
    std::printf("%s  moved by %.3f, turned by %.2f deg, scale %.4f\n", indent, loop.shift,
                loop.turn_rad * kDegreesPerRadian, loop.scale);
  }
  if (session.trajectory) {
    std::printf("%s", text::Wrapped(absl::StrCat("reported trajectory: ", text::Shown(session.trajectory->reason)),
                                    indent, absl::StrCat(indent, "  "))
                          .c_str());
  }
}

}  // namespace cairn::cli
