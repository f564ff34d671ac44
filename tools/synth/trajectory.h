// How a person would carry a camera through a world: smooth paths with parallax, gazes that follow them, and a hand
// that is never quite still. Poses are functions of time, so that blur and rolling shutter can ask for any.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/status.h"
#include "geometry/se3.h"
#include "synth/walk.h"
#include "synth/world.h"

namespace cairn::synth {

enum class Motion {
  kWalk,  // through a room, a corridor, or from room to room
  kDesk,  // before the furniture of a wall, nearly still but for 5 to 9 and 15 to 18 s
  kSpin,  // turns about fast for 3 s where it stands, then walks through a room
  kTurn,  // stands in the middle of a room and turns the camera about all axes, its centre within 0.15 m
};

struct TrajectoryOptions {
  Motion motion = Motion::kWalk;
  std::uint64_t seed = 1;
  // Sessions of one world take other paths, heights and gazes past the same places. From 0. Of two rooms, session 0
  // walks about in the first; session 1 begins in the second and walks through the passage into the first; session 2
  // stays in the second; and so on.
  int session = 0;
  // Rounds through the room or corridor; more than 1 comes back to places already seen.
  double laps = 1.0;
  // Mean speed along the path; a room's round is about 8 m. One who turns does a round in as long as 8 m take.
  double speed_m_s = 0.5;
  // To the left of where one looks while walking through a corridor.
  double look_aside_rad = 0.0;
  // Of the tremor of the hand: 1 is some 4 mm and 0.3 degrees; 0 is a rail.
  double tremor = 1.0;

  absl::Status Validate() const;
};

// When a camera of Motion::kDesk is still, and how long one of Motion::kSpin turns.
inline constexpr double kDeskStill_s[3][2] = {{0.0, 5.0}, {9.0, 15.0}, {18.0, 22.0}};
inline constexpr double kDeskDuration_s = 22.0;
inline constexpr double kSpin_s = 3.0;

class Trajectory {
 public:
  static absl::StatusOr<Trajectory> Create(const WorldOptions& world, const TrajectoryOptions& options);

  double duration_s() const { return duration_s_; }
  // world_from_camera at any time; before 0 and after the end the path goes on.
  SE3 Pose(double time_s) const;

 private:
  struct Wave {
    double amplitude = 0.0;
    double frequency_hz = 0.0;
    double phase_rad = 0.0;
  };
  Trajectory() = default;
  double Sum(const std::vector<Wave>& waves, double time_s) const;
  // Position and direction of gaze along the path, without tremor. `at`: path length in metres.
  void Room(double at_m, Vector3d& position, Vector3d& gaze) const;
  void Corridor(double at_m, Vector3d& position, Vector3d& gaze) const;
  void Rooms(double at_m, Vector3d& position, Vector3d& gaze) const;
  SE3 Turning(double at_m) const;
  SE3 Desk(double time_s) const;
  SE3 Spin(double time_s) const;
  Vector3d Centerline(double at_m) const;

  WorldOptions world_;
  TrajectoryOptions options_;
  double round_m_ = 0.0;  // length of one round
  double duration_s_ = 0.0;
  double start_m_ = 0.0;
  double direction_ = 1.0;
  double height_m_ = 1.5;
  double radius_x_m_ = 0.0, radius_y_m_ = 0.0, corner_radius_m_ = 0.0;
  double gaze_offset_rad_ = 0.0;
  Walk walk_;                                // from room to room
  std::array<std::vector<Wave>, 3> sway_;    // of the position along the path: outward, forward (room) or aside, up
  std::array<std::vector<Wave>, 2> gaze_;    // yaw and pitch along the path
  std::array<std::vector<Wave>, 6> tremor_;  // over time: translation in metres, rotation in radians
};

}  // namespace cairn::synth
