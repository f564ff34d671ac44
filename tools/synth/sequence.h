// A virtual recording: a world, a path through it, a camera and what is wrong with it. Everything follows from the
// options, so the same options give the same images, in memory or on disk (write.h).
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "synth/arm.h"
#include "synth/render.h"
#include "synth/trajectory.h"
#include "synth/world.h"

namespace cairn::synth {

struct SequenceOptions {
  WorldOptions world;
  TrajectoryOptions trajectory;
  Camera camera = Camera::FromPinhole({640, 480, 420.0, 420.0, 319.5, 239.5});
  Effects effects;
  double rate_hz = 20.0;
  // Ends earlier than the path does; 0: does not.
  double max_duration_s = 0.0;
  double exposure_s = 0.006;
  // The exposure time swings by about this factor up and down (0.3: from 6 to 4.4 and 8.1 ms); 0: constant.
  double exposure_swing = 0.0;
  // Something moves before the camera and hides about this share of the view; 0: nothing.
  double arm_share = 0.0;
  // Of the first image of session 0; later sessions start an hour apart.
  TimeNs first_time_ns = 1600000000000000000;

  absl::Status Validate() const;
};

// What `cairn synth` offers by name.
//   office    a furnished office of 34 square metres, one round
//   corridor  a closed corridor of 60 m, a little more than one round
//   aliasing  the same with two sides that look exactly alike
//   plain     the office with 30 % of its walls blank
//   soft      a closed corridor of 45 m, of which the second side is painted with soft-edged stripes: about 8 s with
//             gradients and next to no corners
//   rooms     two rooms with a passage between them: session 1 walks about in one, session 2 begins in the other and
//             walks into the first
//   alike     a room furnished from a catalogue: other seeds give other rooms with furniture and posters of the same
//             few models
//   turning   the office, seen by a camera that turns about all axes within 0.2 m
//   desk      furniture from 1.5 m, by a camera that is nearly still but for 5 to 9 and 15 to 18 s, while an arm works
//   in
//             a fifth of the view
//   spin      the office, as by somebody who first turns about for 3 s, fast and blurred, and then walks
//   aside     a straight corridor of 90 m, seen by a camera that looks at its wall
//   ahead     the same, looking ahead
// NotFound lists the names.
absl::StatusOr<SequenceOptions> Preset(const std::string& name);
std::vector<std::string> PresetNames();

// Another pinhole camera with its principal point in the middle; 0: as it was.
void SetCamera(int width_px, int height_px, double focal_px, SequenceOptions& options);

// Switches what spoils an image on, to usual amounts, or off. Names: distortion, response, vignette, exposure, noise,
// blur, rolling_shutter. NotFound lists the names.
absl::Status SetEffect(const std::string& name, bool on, SequenceOptions& options);
std::vector<std::string> EffectNames();

class Sequence {
 public:
  static absl::StatusOr<Sequence> Create(const SequenceOptions& options);

  const SequenceOptions& options() const { return options_; }
  const World& world() const { return *world_; }
  const Renderer& renderer() const { return *renderer_; }

  int size() const { return size_; }
  TimeNs TimeNsOf(int frame) const;
  double ExposureS(int frame) const;
  // At the middle of the exposure (of the middle row with a rolling shutter).
  SE3 WorldFromCamera(int frame) const { return WorldFromCameraAt(SecondsOf(frame)); }
  // Seconds since the first image; any time.
  SE3 WorldFromCameraAt(double time_s) const { return trajectory_->Pose(time_s); }
  double SecondsOf(int frame) const { return static_cast<double>(frame) / options_.rate_hz; }
  // CV_8UC1. Thread-safe.
  cv::Mat Render(int frame) const;
  // z in the camera frame in metres, CV_32FC1, 0: nothing there.
  cv::Mat Depth(int frame) const;

 private:
  Sequence() = default;

  SequenceOptions options_;
  std::unique_ptr<World> world_;  // the renderer keeps its address
  std::unique_ptr<Renderer> renderer_;
  std::unique_ptr<Trajectory> trajectory_;
  std::unique_ptr<Arm> arm_;  // may be none
  int size_ = 0;
};

}  // namespace cairn::synth
