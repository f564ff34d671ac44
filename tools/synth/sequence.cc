#include "synth/sequence.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/str_join.h"
#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {

absl::Status SequenceOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(world.Validate());
  CAIRN_RETURN_IF_ERROR(trajectory.Validate());
  CAIRN_RETURN_IF_ERROR(camera.Validate());
  CAIRN_RETURN_IF_ERROR(effects.Validate());
  if (!(rate_hz > 0.0 && rate_hz <= 1000.0)) return absl::InvalidArgumentError("rate_hz must be in (0, 1000]");
  if (!(max_duration_s >= 0.0)) return absl::InvalidArgumentError("max_duration_s must not be negative");
  if (!(exposure_s > 0.0 && exposure_s * rate_hz <= 1.0)) {
    return absl::InvalidArgumentError("exposure_s must be positive and shorter than the time between two images");
  }
  if (!(exposure_swing >= 0.0 && exposure_swing <= 2.0)) {
    return absl::InvalidArgumentError("exposure_swing must be in [0, 2]");
  }
  if (!(arm_share >= 0.0 && arm_share <= 0.6)) return absl::InvalidArgumentError("arm_share must be in [0, 0.6]");
  if (first_time_ns < 0) return absl::InvalidArgumentError("first_time_ns must not be negative");
  return absl::OkStatus();
}

std::vector<std::string> PresetNames() {
  return {"office", "corridor", "aliasing", "plain", "soft",  "rooms",
          "alike",  "turning",  "desk",     "spin",  "aside", "ahead"};
}

absl::StatusOr<SequenceOptions> Preset(const std::string& name) {
  SequenceOptions o;
  if (name == "desk" || name == "spin") {
    o.world.kind = WorldKind::kRoom;
    o.trajectory.motion = name == "desk" ? Motion::kDesk : Motion::kSpin;
    if (name == "desk") {
      o.arm_share = 0.2;
    } else {
      o.trajectory.laps = 0.8;
      o.exposure_s = 0.02;
      CAIRN_RETURN_IF_ERROR(SetEffect("blur", true, o));
    }
    return o;
  }
  if (name == "aside" || name == "ahead") {
    o.world.kind = WorldKind::kCorridor;
    o.world.size_m = Vector3d(98.0, 10.0, 2.6);
    o.world.corridor_width_m = 3.0;
    o.world.texels_per_m = 160.0;
    o.trajectory.speed_m_s = 1.1;
    o.trajectory.look_aside_rad = name == "aside" ? -0.5 * std::numbers::pi : 0.0;
    o.max_duration_s = 90.0 / o.trajectory.speed_m_s;
    return o;
  }
  if (name == "office" || name == "plain" || name == "alike" || name == "turning") {
    o.world.kind = WorldKind::kRoom;
    o.trajectory.laps = 1.1;
    if (name == "plain") o.world.blank_share = 0.3;
    if (name == "alike") o.world.catalogue = 1;
    if (name == "turning") o.trajectory.motion = Motion::kTurn;
    return o;
  }
  if (name == "rooms") {
    o.world.kind = WorldKind::kRooms;
    o.world.size_m = Vector3d(16.0, 5.2, 2.7);
    o.world.corridor_width_m = 2.0;
    o.trajectory.laps = 1.15;
    o.trajectory.speed_m_s = 0.7;
    return o;
  }
  if (name == "corridor" || name == "aliasing" || name == "soft") {
    o.world.kind = WorldKind::kCorridor;
    o.world.seed = 2;
    o.world.size_m = Vector3d(22.8, 11.6, 2.6);  // 60 m along the middle
    o.world.texels_per_m = 200.0;
    o.world.aliased_sides = name == "aliasing";
    o.world.soft_side = name == "soft";
    if (o.world.soft_side) o.world.size_m.head<2>() = Vector2d(14.0, 13.0);
    o.trajectory.laps = 1.15;
    o.trajectory.speed_m_s = 1.1;
    return o;
  }
  return absl::NotFoundError(absl::StrCat("no preset \"", name, "\"; there are ", absl::StrJoin(PresetNames(), ", ")));
}

void SetCamera(int width_px, int height_px, double focal_px, SequenceOptions& o) {
  Camera& c = o.camera;
  if (width_px > 0) c.width_px = width_px;
  if (height_px > 0) c.height_px = height_px;
  if (focal_px > 0.0) c.fx_px = c.fy_px = focal_px;
  c.cx_px = 0.5 * (c.width_px - 1);
  c.cy_px = 0.5 * (c.height_px - 1);
}

std::vector<std::string> EffectNames() {
  return {"distortion", "response", "vignette", "exposure", "noise", "blur", "rolling_shutter"};
}

absl::Status SetEffect(const std::string& name, bool on, SequenceOptions& o) {
  if (name == "distortion") {
    o.camera.model = on ? CameraModel::kRadialTangential : CameraModel::kPinhole;
    o.camera.distortion = on ? std::vector<double>{-0.28, 0.07, 2e-4, 2e-5} : std::vector<double>{};
  } else if (name == "response") {
    o.effects.gamma = on ? 2.2 : 1.0;
    o.effects.white_level = on ? 170.0 : Effects().white_level;
  } else if (name == "vignette") {
    o.effects.vignette = on ? 0.45 : 0.0;
  } else if (name == "exposure") {
    o.exposure_swing = on ? 0.3 : 0.0;
  } else if (name == "noise") {
    o.effects.noise_dark = on ? 1.2 : 0.0;
    o.effects.noise_bright = on ? 2.5 : 0.0;
  } else if (name == "blur") {
    o.effects.max_blur_samples = on ? 6 : 1;
  } else if (name == "rolling_shutter") {
    o.effects.rolling_shutter_s = on ? 0.02 : 0.0;
  } else {
    return absl::NotFoundError(
        absl::StrCat("no effect \"", name, "\"; there are ", absl::StrJoin(EffectNames(), ", ")));
  }
  return absl::OkStatus();
}

absl::StatusOr<Sequence> Sequence::Create(const SequenceOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  Sequence sequence;
  sequence.options_ = options;
  CAIRN_ASSIGN_OR_RETURN(Trajectory trajectory, Trajectory::Create(options.world, options.trajectory));
  double duration_s = trajectory.duration_s();
  if (options.max_duration_s > 0.0) duration_s = std::min(duration_s, options.max_duration_s);
  const double frames = std::floor(duration_s * options.rate_hz + 1e-6) + 1.0;
  if (frames > 1e6) {
    return absl::InvalidArgumentError(absl::StrCat("a sequence of ", frames, " images is too long (1000000 at most)"));
  }
  sequence.size_ = static_cast<int>(frames);
  sequence.trajectory_ = std::make_unique<Trajectory>(std::move(trajectory));
  CAIRN_ASSIGN_OR_RETURN(World world, World::Create(options.world));
  sequence.world_ = std::make_unique<World>(std::move(world));
  CAIRN_ASSIGN_OR_RETURN(Renderer renderer, Renderer::Create(*sequence.world_, options.camera, options.effects));
  sequence.renderer_ = std::make_unique<Renderer>(std::move(renderer));
  if (options.arm_share > 0.0) {
    CAIRN_ASSIGN_OR_RETURN(Arm arm, Arm::Create(sequence.trajectory_->Pose(0.0), options.arm_share,
                                                options.trajectory.seed, options.camera, options.effects));
    sequence.arm_ = std::make_unique<Arm>(std::move(arm));
  }
  return sequence;
}

TimeNs Sequence::TimeNsOf(int frame) const {
  return options_.first_time_ns + options_.trajectory.session * FromSeconds(3600.0) +
         static_cast<TimeNs>(std::llround(frame * 1e9 / options_.rate_hz));
}

double Sequence::ExposureS(int frame) const {
  if (options_.exposure_swing == 0.0) return options_.exposure_s;
  Random random(Derive(options_.trajectory.seed, 7000 + static_cast<std::uint64_t>(options_.trajectory.session)));
  const double t = 2.0 * std::numbers::pi * SecondsOf(frame);
  double swing = 0.0;
  for (const double hz : {0.11, 0.23, 0.41}) {
    const double phase_rad = random.Uniform(0.0, 6.283);
    swing += 0.5 * std::sin(hz * t + phase_rad);
  }
  const double longest_s = 1.0 / options_.rate_hz;
  return std::min(longest_s, options_.exposure_s * std::exp(options_.exposure_swing * swing));
}

cv::Mat Sequence::Render(int frame) const {
  Shot shot;
  shot.world_from_camera = [this](double time_s) { return trajectory_->Pose(time_s); };
  shot.time_s = SecondsOf(frame);
  shot.exposure_s = ExposureS(frame);
  shot.relative_exposure = shot.exposure_s / options_.exposure_s;
  shot.noise_seed = Derive(Derive(options_.trajectory.seed, static_cast<std::uint64_t>(options_.trajectory.session)),
                           static_cast<std::uint64_t>(frame));
  cv::Mat image = renderer_->Render(shot);
  if (arm_) arm_->DrawInto(shot, &image);
  return image;
}

cv::Mat Sequence::Depth(int frame) const {
  cv::Mat depth = renderer_->Depth(WorldFromCamera(frame));
  if (arm_) arm_->DrawIntoDepth(WorldFromCamera(frame), SecondsOf(frame), &depth);
  return depth;
}

}  // namespace cairn::synth
