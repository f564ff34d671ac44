#include "synth/trajectory.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr double kTurningRound_m = 8.0;  // what a round of turning counts as

// A camera that looks along `gaze` with the horizon level.
Matrix3d LookAlong(const Vector3d& gaze) {
  const Vector3d z = gaze.normalized(), x = z.cross(Vector3d::UnitZ()).normalized();
  Matrix3d rotation;
  rotation << x, z.cross(x), z;
  return rotation;
}

Vector3d GazeOf(double yaw, double pitch) {
  return {std::cos(yaw) * std::cos(pitch), std::sin(yaw) * std::cos(pitch), std::sin(pitch)};
}

// How far one looks to the left of the way ahead on a round through a room: to the right, at its walls.
constexpr double kLookAtWalls_rad = -0.25 * kTurn + 0.3;

// Waypoints of a round counter-clockwise about a room's middle, `share` of it, from `angle_rad` on.
void AppendRound(double x, double y, double radius_x, double radius_y, double angle_rad, double share,
                 std::vector<Walk::Waypoint>& points) {
  const int pieces = std::max(1, static_cast<int>(std::lround(12.0 * share)));
  for (int i = 0; i <= pieces; ++i) {
    const double a = angle_rad + kTurn * share * i / pieces;
    points.push_back({x + radius_x * std::cos(a), y + radius_y * std::sin(a), kLookAtWalls_rad});
  }
}

// Through two rooms with a passage between them (WorldKind::kRooms), or about one of them.
Walk WalkThroughRooms(const WorldOptions& world, const TrajectoryOptions& options, Random& random) {
  const double room = 0.5 * (world.size_m.x() - world.passage_length_m), y = 0.5 * world.size_m.y();
  const double first_x = 0.5 * room, second_x = world.size_m.x() - 0.5 * room;
  const double size = random.Uniform(0.92, 1.08);
  const double rx = std::max(0.4, size * (0.5 * room - 1.95)), ry = std::max(0.4, size * (y - 1.7));
  std::vector<Walk::Waypoint> points;
  if (options.session % 3 != 1) {
    const double from = -0.25 * kTurn + random.Uniform(-0.5, 0.5);
    AppendRound(options.session % 3 == 0 ? first_x : second_x, y, rx, ry, from, options.laps, points);
    return Walk(points);
  }
  // Half a round in the second room; at its north side one turns to the door, walks through and does the rest in the
  // first room, from its north side on.
  AppendRound(second_x, y, rx, ry, -0.27 * kTurn, 0.5, points);
  const double east = room + world.passage_length_m;
  points.push_back({0.5 * (second_x + east), y + 0.45 * ry, -0.1 * kTurn});
  for (const double x : {east + 0.3, east - 0.6, room + 0.6, room - 0.3}) points.push_back({x, y, 0.0});
  points.push_back({0.5 * (first_x + room), y + 0.45 * ry, -0.1 * kTurn});
  AppendRound(first_x, y, rx, ry, 0.23 * kTurn, std::max(0.3, options.laps - 0.5), points);
  return Walk(points);
}

}  // namespace

absl::Status TrajectoryOptions::Validate() const {
  const auto bad = [](const std::string& what) { return absl::InvalidArgumentError("trajectory: " + what); };
  if (session < 0 || session > 1000) return bad("session must be in [0, 1000]");
  if (!(laps > 0.0 && laps <= 1000.0)) return bad("laps must be in (0, 1000]");
  if (!(speed_m_s > 0.0 && speed_m_s <= 20.0)) return bad("speed_m_s must be in (0, 20]");
  if (!(tremor >= 0.0 && tremor <= 20.0)) return bad("tremor must be in [0, 20]");
  if (!std::isfinite(look_aside_rad)) return bad("look_aside_rad must be finite");
  return absl::OkStatus();
}

absl::StatusOr<Trajectory> Trajectory::Create(const WorldOptions& world, const TrajectoryOptions& options) {
  CAIRN_RETURN_IF_ERROR(world.Validate());
  CAIRN_RETURN_IF_ERROR(options.Validate());
  Trajectory t;
  t.world_ = world;
  t.options_ = options;
  Random random(Derive(options.seed, 1000 + static_cast<std::uint64_t>(options.session)));
  const bool room = world.kind == WorldKind::kRoom;
  if ((options.motion == Motion::kDesk || options.motion == Motion::kSpin) && !room) {
    return absl::InvalidArgumentError("trajectory: this motion is one in a room");
  }
  if (options.motion == Motion::kTurn) {
    t.round_m_ = kTurningRound_m;
    t.height_m_ = std::min(1.5, 0.55 * world.size_m.z());
  } else if (world.kind == WorldKind::kRooms) {
    t.walk_ = WalkThroughRooms(world, options, random);
    t.round_m_ = t.walk_.length_m() / options.laps;
    t.height_m_ = 1.5 + random.Uniform(-0.05, 0.05);
  } else if (room) {
    // An ellipse in the part of the room that furniture leaves free, looking outward.
    const double size = 0.92 + 0.08 * (options.session % 3) + random.Uniform(-0.03, 0.03);
    t.radius_x_m_ = std::max(0.25, size * (0.5 * world.size_m.x() - 1.95));
    t.radius_y_m_ = std::max(0.25, size * (0.5 * world.size_m.y() - 1.70));
    t.round_m_ = 0.5 * kTurn *
                 (3.0 * (t.radius_x_m_ + t.radius_y_m_) -
                  std::sqrt((3.0 * t.radius_x_m_ + t.radius_y_m_) * (t.radius_x_m_ + 3.0 * t.radius_y_m_)));
    t.height_m_ = std::min(1.45 + 0.1 * (options.session % 3) + random.Uniform(-0.04, 0.04), 0.6 * world.size_m.z());
    t.gaze_offset_rad_ = 0.3 + random.Uniform(-0.1, 0.1);
    t.direction_ = options.session % 4 == 3 ? -1.0 : 1.0;
    t.start_m_ = t.round_m_ * 0.13 * options.session;
  } else {
    t.corner_radius_m_ = 0.9;
    const double x = world.size_m.x() - world.corridor_width_m, y = world.size_m.y() - world.corridor_width_m;
    t.round_m_ = 2.0 * (x + y) - 8.0 * t.corner_radius_m_ + kTurn * t.corner_radius_m_;
    t.height_m_ = 1.5 + 0.08 * (options.session % 3) + random.Uniform(-0.04, 0.04);
    t.start_m_ = 1.5 * t.corner_radius_m_ + 0.4 * options.session;
  }
  t.duration_s_ = options.laps * t.round_m_ / options.speed_m_s;
  if (options.motion == Motion::kSpin) t.duration_s_ += kSpin_s;
  if (options.motion == Motion::kDesk) t.duration_s_ = kDeskDuration_s;

  // Slow variations along the path: whole numbers of waves a round would make two laps alike, so they are not.
  const auto waves = [&](double amplitude, double longest_m, int count) {
    std::vector<Wave> all;
    for (int i = 0; i < count; ++i) {
      all.push_back({amplitude * random.Uniform(0.5, 1.0) / (1.0 + 0.7 * i),
                     (1.0 + 0.8 * i) / (longest_m * random.Uniform(0.85, 1.15)), random.Uniform(0.0, kTurn)});
    }
    return all;
  };
  const bool rooms = world.kind == WorldKind::kRooms;
  t.sway_ = {waves(room    ? 0.16
                   : rooms ? 0.08
                           : 0.18,
                   room    ? 2.6
                   : rooms ? 3.0
                           : 7.0,
                   3),
             waves(0.05, 2.0, 2),
             waves(room    ? 0.14
                   : rooms ? 0.08
                           : 0.05,
                   room    ? 2.2
                   : rooms ? 2.6
                           : 5.0,
                   3)};
  t.gaze_ = {waves(room ? 0.16 : 0.10, room ? 2.4 : 6.0, 3), waves(room ? 0.11 : 0.05, room ? 1.9 : 5.0, 3)};
  for (std::size_t k = 0; k < 6; ++k) {
    const double amplitude = options.tremor * (k < 3 ? 0.0025 : 0.0030);
    for (const double hz : {0.7, 1.6, 3.1, 5.3}) {
      t.tremor_[k].push_back(
          {amplitude * random.Uniform(0.5, 1.2) / hz, hz * random.Uniform(0.85, 1.15), random.Uniform(0.0, kTurn)});
    }
  }
  if (!room) t.tremor_[2].push_back({0.012 * options.tremor, 1.8, 0.0});  // steps
  return t;
}

double Trajectory::Sum(const std::vector<Wave>& waves, double at) const {
  double sum = 0.0;
  for (const Wave& w : waves) sum += w.amplitude * std::sin(kTurn * w.frequency_hz * at + w.phase_rad);
  return sum;
}

void Trajectory::Room(double at_m, Vector3d& position, Vector3d& gaze) const {
  const double angle = direction_ * kTurn * (start_m_ + at_m) / round_m_;
  const Vector3d outward(std::cos(angle), std::sin(angle), 0.0);
  const double r = 1.0 + Sum(sway_[0], at_m);
  position = Vector3d(0.5 * world_.size_m.x() + r * radius_x_m_ * outward.x(),
                      0.5 * world_.size_m.y() + r * radius_y_m_ * outward.y(), height_m_ + Sum(sway_[2], at_m));
  const double yaw = angle + direction_ * gaze_offset_rad_ + Sum(gaze_[0], at_m);
  const double pitch = -0.17 + Sum(gaze_[1], at_m);
  gaze = GazeOf(yaw, pitch);
}

void Trajectory::Rooms(double at_m, Vector3d& position, Vector3d& gaze) const {
  const Walk::Step step = walk_.At(at_m);
  const Vector3d aside = Vector3d::UnitZ().cross(step.ahead);
  position = step.position + Sum(sway_[0], at_m) * aside + Vector3d(0, 0, height_m_ + Sum(sway_[2], at_m));
  const double yaw = std::atan2(step.ahead.y(), step.ahead.x()) + step.look_rad + Sum(gaze_[0], at_m);
  gaze = GazeOf(yaw, -0.1 + Sum(gaze_[1], at_m));
}

// The camera in a hand before the body: it turns about all three axes, and to and fro by some centimetres it goes
// faster.
SE3 Trajectory::Turning(double at_m) const {
  const double a = kTurn * at_m / round_m_;
  const double yaw = 0.9 * std::sin(a) + 0.25 * std::sin(2.3 * a + 1.0);
  const double pitch = 0.30 * std::sin(1.7 * a) - 0.1;
  const double roll = 0.35 * (std::sin(2.1 * a + 0.7) - std::sin(0.7));
  const double heading = kTurn * (0.15 + 0.21 * options_.session);
  const Vector3d middle(0.5 * world_.size_m.x(), 0.5 * world_.size_m.y(), height_m_);
  const Vector3d forward(std::cos(heading), std::sin(heading), 0.0), aside(-forward.y(), forward.x(), 0.0);
  const Vector3d arm = 0.066 * std::sin(6.1 * a + 0.2) * aside + 0.04 * std::sin(5.3 * a + 0.5) * forward +
                       Vector3d(0, 0, 0.062 * std::sin(7.3 * a + 0.3));
  const Quaterniond level(LookAlong(GazeOf(heading + yaw, pitch)));
  return SE3(level * ExpSO3(Vector3d(0, 0, roll)), middle + 0.2 * (options_.session % 3) * forward + arm);
}

// From side to side before the south wall, and to and fro; what has passed of the time in which it moves counts.
SE3 Trajectory::Desk(double time_s) const {
  constexpr double kEase_s = 0.5;  // in which it comes to rest
  double moved_s = time_s;
  for (const auto& still : kDeskStill_s) {
    // Slower and slower towards the rest, and out of it likewise: the integral of a smooth step down and up.
    const auto passed = [&](double edge_s) {
      const double x = std::clamp((time_s - edge_s) / kEase_s, -0.5, 0.5) + 0.5;
      return kEase_s * x * x * x * (1.0 - 0.5 * x) + std::max(0.0, time_s - edge_s - 0.5 * kEase_s);
    };
    moved_s -= passed(still[0]) - passed(still[1]);
  }
  const double a = kTurn * moved_s;
  const Vector3d position(0.5 * world_.size_m.x() + 0.3 * options_.session + 0.22 * std::sin(0.23 * a),
                          2.2 + 0.10 * std::sin(0.17 * a), 1.3 + 0.12 * std::sin(0.31 * a + 0.4));
  const double yaw = -0.25 * kTurn + 0.10 * std::sin(0.19 * a), pitch = -0.25 + 0.05 * std::sin(0.29 * a);
  return {Quaterniond(LookAlong(GazeOf(yaw, pitch))), position};
}

// About a body's axis, the camera a forearm before it: there is next to no parallax.
SE3 Trajectory::Spin(double time_s) const {
  Vector3d position = Vector3d::Zero(), gaze = Vector3d::UnitX();
  Room(options_.speed_m_s * std::max(0.0, time_s - kSpin_s), position, gaze);
  const double share = std::clamp(time_s / kSpin_s, 0.0, 1.0);
  const double still = std::sin(0.5 * kTurn * share);  // at both ends
  const double turn = 1.1 * still * still * std::sin(2.0 * kTurn * share), arm_m = 0.12;
  const Matrix3d turned = ExpSO3(Vector3d(0, 0, turn)).toRotationMatrix();
  const Vector3d forearm = arm_m * Vector3d(gaze.x(), gaze.y(), 0.0).normalized();
  return {Quaterniond(LookAlong(turned * gaze)), position - forearm + turned * forearm};
}

// The middle of the corridor, round the corners on arcs, counter-clockwise from the south-west.
Vector3d Trajectory::Centerline(double at_m) const {
  const double half = 0.5 * world_.corridor_width_m, r = corner_radius_m_;
  const double x0 = half, y0 = half, x1 = world_.size_m.x() - half, y1 = world_.size_m.y() - half;
  const double lengths[4] = {x1 - x0 - 2 * r, y1 - y0 - 2 * r, x1 - x0 - 2 * r, y1 - y0 - 2 * r};
  const Vector3d starts[4] = {{x0 + r, y0, 0}, {x1, y0 + r, 0}, {x1 - r, y1, 0}, {x0, y1 - r, 0}};
  const Vector3d along[4] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  const double arc = 0.25 * kTurn * r;
  double s = std::fmod(at_m, round_m_);
  if (s < 0.0) s += round_m_;
  for (int k = 0; k < 4; ++k) {
    if (s <= lengths[k]) return starts[k] + s * along[k];
    s -= lengths[k];
    if (s <= arc || k == 3) {
      const double a = s / r;
      return starts[k] + (lengths[k] + r * std::sin(a)) * along[k] + r * (1.0 - std::cos(a)) * along[(k + 1) % 4];
    }
    s -= arc;
  }
  return starts[0];
}

void Trajectory::Corridor(double at_m, Vector3d& position, Vector3d& gaze) const {
  const double at = start_m_ + at_m;
  const Vector3d ahead = (Centerline(at + 0.25) - Centerline(at - 0.25)).normalized();
  const Vector3d aside = Vector3d::UnitZ().cross(ahead);
  position = Centerline(at) + Sum(sway_[0], at_m) * aside + Vector3d(0, 0, height_m_ + Sum(sway_[2], at_m));
  // One looks where one will be: turns begin before the corner and are slow.
  const Vector3d look = (Centerline(at + 1.3) - Centerline(at - 0.5)).normalized();
  gaze = GazeOf(std::atan2(look.y(), look.x()) + options_.look_aside_rad + Sum(gaze_[0], at_m),
                -0.06 + Sum(gaze_[1], at_m));
}

SE3 Trajectory::Pose(double time_s) const {
  Vector3d position = Vector3d::Zero(), gaze = Vector3d::UnitX();
  const double at_m = options_.speed_m_s * time_s;
  SE3 pose;
  if (options_.motion == Motion::kTurn) {
    pose = Turning(at_m);
  } else if (options_.motion == Motion::kDesk) {
    pose = Desk(time_s);
  } else if (options_.motion == Motion::kSpin) {
    pose = Spin(time_s);
  } else {
    switch (world_.kind) {
      case WorldKind::kRoom:
        Room(at_m, position, gaze);
        break;
      case WorldKind::kCorridor:
        Corridor(at_m, position, gaze);
        break;
      case WorldKind::kRooms:
        Rooms(at_m, position, gaze);
        break;
    }
    pose = SE3(Quaterniond(LookAlong(gaze)), position);
  }
  Vector3d shift, turn;
  for (int k = 0; k < 3; ++k) {
    shift[k] = Sum(tremor_[static_cast<std::size_t>(k)], time_s);
    turn[k] = Sum(tremor_[static_cast<std::size_t>(k + 3)], time_s);
  }
  return SE3(pose.rotation() * ExpSO3(turn), pose.translation() + shift);
}

}  // namespace cairn::synth
