// A furnished room, and two of them with a passage between.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

constexpr double kStretch_m = 2.6;    // of wall that is furnished, or blank, as a whole; about
constexpr double kDoorWidth_m = 1.4;  // of the openings between rooms and passage
constexpr double kDoorHeight_m = 2.15;
constexpr int kNoDoor = -1;

// A part of a wall, from its left end.
struct Stretch {
  double from_m = 0.0;
  double width_m = 0.0;
};

std::vector<Stretch> Stretches(double length, bool door) {
  std::vector<Stretch> all;
  if (door) {
    const double beside = 0.5 * (length - kDoorWidth_m);
    return {{0.0, beside}, {length - beside, beside}};
  }
  const int count = std::max(1, static_cast<int>(std::lround(length / kStretch_m)));
  for (int k = 0; k < count; ++k) all.push_back({k * (length / count), length / count});
  return all;
}

// Says of one stretch after the other whether it is blank: one whenever the share so far falls behind.
class Blanks {
 public:
  Blanks(double share, double length_m) : share_(share), length_m_(length_m) {}
  bool Next(double done_m, double width_m) {
    const bool blank = share_ > 0.0 && so_far_m_ + 0.5 * width_m <= share_ * length_m_ * done_m / length_m_;
    if (blank) so_far_m_ += width_m;
    return blank;
  }

 private:
  double share_, length_m_, so_far_m_ = 0.0;
};

// The floor's corner of least x and y, and its size. `door`: the wall with an opening in its middle, or kNoDoor; north
// (+y), east, south, west.
struct RoomPlan {
  Vector3d origin = Vector3d::Zero();
  double size_x_m = 0.0;
  double size_y_m = 0.0;
  int door = kNoDoor;
  std::uint64_t seed = 0;
};

void BuildWalls(WorldBuilder& b, const WorldOptions& o, const RoomPlan& plan, Random& random) {
  const double sx = plan.size_x_m, sy = plan.size_y_m, h = o.size_m.z();
  const Vector3d& at = plan.origin;
  const std::array<Place, 4> walls = {Place{at + Vector3d(0, sy, 0), 0.0},
                                      Place{at + Vector3d(sx, sy, 0), -0.5 * kHalfTurn},
                                      Place{at + Vector3d(sx, 0, 0), kHalfTurn}, Place{at, 0.5 * kHalfTurn}};
  const std::array<double, 4> lengths = {sx, sy, sx, sy};
  Random of_catalogue(o.catalogue);
  Blanks blanks(o.blank_share, 2.0 * (sx + sy));
  double before_m = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    const bool door = static_cast<int>(i) == plan.door;
    const Material rich = RichWall(o.catalogue == 0 ? random : of_catalogue);
    const std::uint64_t wall_seed = random.Next();
    const std::vector<Stretch> stretches = Stretches(lengths[i], door);
    for (std::size_t k = 0; k < stretches.size(); ++k) {
      const auto [start, width] = stretches[k];
      const bool blank = blanks.Next(before_m + start + width, width);
      AddWall(b, walls[i].At(start, 0), width, h, blank ? Material::kBlank : rich, Derive(wall_seed, k));
      if (o.furniture_density <= 0.0) continue;
      const bool end_wall = i % 2 == 1;  // corners belong to the long walls' furniture
      const double from = k == 0 && end_wall ? 0.85 : 0.05;
      const double to = width - (k + 1 == stretches.size() && end_wall ? 0.85 : 0.05);
      Random stretch(Derive(wall_seed, 100 + k));
      FurnishWall(b, walls[i].At(start, 0), from, to, {h, o.furniture_density, blank, o.catalogue}, stretch);
    }
    if (door) {  // the wall over it
      AddWall(
          b,
          {walls[i].At(0.5 * (lengths[i] - kDoorWidth_m), 0).origin + Vector3d(0, 0, kDoorHeight_m), walls[i].yaw_rad},
          kDoorWidth_m, h - kDoorHeight_m, rich, Derive(wall_seed, 50));
    }
    before_m += lengths[i];
  }
}

void BuildFurnishedRoom(WorldBuilder& b, const WorldOptions& o, const RoomPlan& plan) {
  const double sx = plan.size_x_m, sy = plan.size_y_m, h = o.size_m.z();
  const Vector3d& at = plan.origin;
  Random random(plan.seed);
  BuildWalls(b, o, plan, random);
  if (o.furniture_density > 0.0) {
    b.AddBox({at + Vector3d(0.5 * sx, 0.5 * sy, 0), random.Uniform(-0.2, 0.2)}, {-1.1, 1.1, -0.75, 0.75, 0.0, 0.012},
             Material::kCarpet, random.Next(), kTop);
  }
  b.AddRectangle(at + Vector3d(0, sy, 0), {1, 0, 0}, {0, -1, 0}, sx, sy,
                 random.Below(2) == 0 ? Material::kWood : Material::kTiles, random.Next(), true, true);
  b.AddRectangle(at + Vector3d(0, 0, h), {1, 0, 0}, {0, 1, 0}, sx, sy, Material::kCeiling, random.Next(), true);
}

// The wall of a passage around the opening at its end, as one stands facing it; `end`: its left end on the floor.
void AddWallAroundDoor(WorldBuilder& b, const Place& end, double width, double height, Material material,
                       std::uint64_t seed) {
  const double beside = 0.5 * (width - kDoorWidth_m);
  if (beside > 0.0) {
    AddWall(b, end, beside, height, material, Derive(seed, 0));
    AddWall(b, end.At(width - beside, 0), beside, height, material, Derive(seed, 1));
  }
  AddWall(b, {end.At(std::max(0.0, beside), 0).origin + Vector3d(0, 0, kDoorHeight_m), end.yaw_rad},
          std::min(width, kDoorWidth_m), height - kDoorHeight_m, material, Derive(seed, 2));
}

// Along x from x0 to x1, its middle at y: walls with posters, a cabinet or boxes, and rooms beyond its ends.
void BuildPassage(WorldBuilder& b, const WorldOptions& o, double x0, double x1, double y, std::uint64_t seed) {
  const double h = o.size_m.z(), w = o.corridor_width_m, length = x1 - x0;
  Random random(seed);
  const std::array<Place, 2> walls = {Place{{x0, y + 0.5 * w, 0}, 0.0}, Place{{x1, y - 0.5 * w, 0}, kHalfTurn}};
  for (const Place& wall : walls) {
    const int panels = std::max(1, static_cast<int>(std::lround(length / 2.0)));
    const double width = length / panels;
    for (int k = 0; k < panels; ++k) {
      const Place panel = wall.At(k * width, 0);
      const Material material = RichWall(random);
      AddWall(b, panel, width, h, material, random.Next());
      if (o.furniture_density > 0.0) AddPosters(b, panel, 0.1, width - 0.1, 0.75, 2.2, o.catalogue, random);
    }
  }
  const Material ends = RichWall(random);
  AddWallAroundDoor(b, {{x0, y - 0.5 * w, 0}, 0.5 * kHalfTurn}, w, h, ends, Derive(seed, 10));
  AddWallAroundDoor(b, {{x1, y + 0.5 * w, 0}, -0.5 * kHalfTurn}, w, h, ends, Derive(seed, 11));
  b.AddRectangle({x0, y + 0.5 * w, 0}, {1, 0, 0}, {0, -1, 0}, length, w, Material::kTiles, Derive(seed, 12), true,
                 true);
  b.AddRectangle({x0, y - 0.5 * w, h}, {1, 0, 0}, {0, 1, 0}, length, w, Material::kCeiling, Derive(seed, 13), true);
}

}  // namespace

void BuildRoom(WorldBuilder& b, const WorldOptions& o) {
  BuildFurnishedRoom(b, o, {Vector3d::Zero(), o.size_m.x(), o.size_m.y(), kNoDoor, o.seed});
}

void BuildRooms(WorldBuilder& b, const WorldOptions& o) {
  const double room = 0.5 * (o.size_m.x() - o.passage_length_m), depth = o.size_m.y();
  BuildFurnishedRoom(b, o, {Vector3d::Zero(), room, depth, 1, Derive(o.seed, 1)});
  BuildFurnishedRoom(b, o, {Vector3d(room + o.passage_length_m, 0, 0), room, depth, 3, Derive(o.seed, 2)});
  BuildPassage(b, o, room, room + o.passage_length_m, 0.5 * depth, Derive(o.seed, 3));
}

}  // namespace cairn::synth
