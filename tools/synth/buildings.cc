#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

constexpr double kHalfTurn = std::numbers::pi;
constexpr double kSoftBeyond_m = 1.2;  // of the wall at the end of a soft side, past its corridor

Material RichWall(Random& random) {
  constexpr std::array<Material, 5> kWalls = {Material::kPlaster, Material::kWallpaper, Material::kBrick,
                                              Material::kPaneling, Material::kConcrete};
  return kWalls[random.Below(kWalls.size())];
}

// A stretch of wall as one stands facing it: its left end on the floor, and the direction to the right.
void AddWall(WorldBuilder& b, const Place& place, double width, double height, Material material, std::uint64_t seed) {
  const Vector3d right = Place{Vector3d::Zero(), place.yaw_rad}.ToWorld({1, 0, 0});
  b.AddRectangle(place.ToWorld({0, 0, height}), right, Vector3d(0, 0, -1), width, height, material, seed,
                 material != Material::kBlank);
}

// Posters over the free part of a wall, above `z`.
void AddPosters(WorldBuilder& b, const Place& wall, double x0, double x1, double z, double z_max, Random& random) {
  double x = x0 + random.Uniform(0.03, 0.15);
  while (x < x1 - 0.25) {
    const double w = std::min(random.Uniform(0.3, 0.75), x1 - x - 0.03);
    const double h = std::clamp(w * random.Uniform(0.7, 1.45), 0.2, std::max(0.2, z_max - z - 0.05));
    if (z + h < z_max) AddPoster(b, wall.At(x, 0), w, h, random.Uniform(z, z_max - h), random.Next());
    x += w + random.Uniform(0.08, 0.4);
  }
}

// Things side by side along a wall between x0 and x1.
void FurnishWall(WorldBuilder& b, const Place& wall, double x0, double x1, double height, double density, bool blank,
                 Random& random) {
  double x = x0;
  while (x < x1 - 0.5) {
    const double left = x1 - x;
    const std::uint64_t seed = random.Next(), choice = random.Below(12);
    const bool skip = random.Uniform() >= density;
    double w = random.Uniform(0.5, 0.9), clear_above = 0.4;
    if (skip || blank) {
      clear_above = blank ? height : 0.9;
    } else if (choice < 4 && left > 1.25) {
      w = std::min(random.Uniform(1.3, 1.75), left);
      AddDesk(b, wall.At(x, 0), w, seed);
      if (random.Below(2) == 0) {
        AddChair(b, wall.At(x + 0.5 * w + random.Uniform(-0.2, 0.2), -1.0, random.Uniform(-0.6, 0.6)),
                 Derive(seed, 99));
      }
      clear_above = 1.35;
    } else if (choice < 7 && left > 0.85) {
      w = std::min(random.Uniform(0.85, 1.25), left);
      AddShelf(b, wall.At(x, 0), w, seed);
      clear_above = height;
    } else if (choice < 9 && left > 0.6) {
      w = std::min(random.Uniform(0.6, 1.0), left);
      AddCabinet(b, wall.At(x, 0), w, seed);
      clear_above = 1.65;
    } else if (choice == 9 && left > 1.05) {
      w = 1.05;
      AddDoor(b, wall.At(x + 0.05, 0), seed);
      clear_above = height;
    } else if (choice == 10 && left > 1.2) {
      w = std::min(random.Uniform(1.2, 1.8), left);
      AddWindow(b, wall.At(x + 0.05, 0), w - 0.1, seed);
      AddBoxes(b, wall.At(x + 0.1, 0), 0.6, Derive(seed, 98));
      clear_above = height;
    } else {
      w = std::min(0.8, left);
      AddBoxes(b, wall.At(x, 0), w, seed);
      clear_above = 1.4;
    }
    if (clear_above < height - 0.5) AddPosters(b, wall, x, x + w, clear_above, std::min(height - 0.2, 2.35), random);
    x += w + random.Uniform(0.03, 0.25);
  }
}

// How many of a wall's panels, the last ones, have nothing but stripes on a corridor with a soft side: all of that
// side, the second; and `at_the_end` of the next side's outer wall, towards which one walks there.
int SoftPanels(std::size_t side, bool is_outer, int panels, double at_the_end) {
  if (side == 1) return panels;
  return side == 2 && is_outer ? std::min(panels, static_cast<int>(std::ceil(at_the_end))) : 0;
}

}  // namespace

void BuildRoom(WorldBuilder& b, const WorldOptions& o) {
  const double sx = o.size_m.x(), sy = o.size_m.y(), h = o.size_m.z();
  Random random(o.seed);
  // Facing north (+y), east, south, west.
  const std::array<Place, 4> walls = {Place{{0, sy, 0}, 0.0}, Place{{sx, sy, 0}, -0.5 * kHalfTurn},
                                      Place{{sx, 0, 0}, kHalfTurn}, Place{{0, 0, 0}, 0.5 * kHalfTurn}};
  const std::array<double, 4> lengths = {sx, sy, sx, sy};
  const double blank_length = o.blank_share * 2.0 * (sx + sy);
  double blank_so_far = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    // Walls come in stretches, so that a share of them can be blank.
    const int stretches = std::max(1, static_cast<int>(std::lround(lengths[i] / 2.6)));
    const double width = lengths[i] / stretches;
    const Material rich = RichWall(random);
    const std::uint64_t wall_seed = random.Next();
    for (int k = 0; k < stretches; ++k) {
      // Blank stretches are spread evenly: one whenever the share so far falls behind.
      const double done =
          (i >= 1 ? lengths[0] : 0) + (i >= 2 ? lengths[1] : 0) + (i >= 3 ? lengths[2] : 0) + (k + 1) * width;
      const bool blank = o.blank_share > 0.0 && blank_so_far + 0.5 * width <= blank_length * done / (2.0 * (sx + sy));
      if (blank) blank_so_far += width;
      AddWall(b, walls[i].At(k * width, 0), width, h, blank ? Material::kBlank : rich,
              Derive(wall_seed, static_cast<std::uint64_t>(k)));
      const bool end_wall = i % 2 == 1;  // corners belong to the long walls' furniture
      const double from = k == 0 && end_wall ? 0.85 : 0.05, to = width - (k == stretches - 1 && end_wall ? 0.85 : 0.05);
      if (o.furniture_density > 0.0) {
        Random stretch(Derive(wall_seed, 100 + static_cast<std::uint64_t>(k)));
        FurnishWall(b, walls[i].At(k * width, 0), from, to, h, o.furniture_density, blank, stretch);
      }
    }
  }
  if (o.furniture_density > 0.0) {
    b.AddBox({{0.5 * sx, 0.5 * sy, 0}, random.Uniform(-0.2, 0.2)}, {-1.1, 1.1, -0.75, 0.75, 0.0, 0.012},
             Material::kCarpet, random.Next(), kTop);
  }
  b.AddRectangle({0, sy, 0}, {1, 0, 0}, {0, -1, 0}, sx, sy, random.Below(2) == 0 ? Material::kWood : Material::kTiles,
                 random.Next(), true, true);
  b.AddRectangle({0, 0, h}, {1, 0, 0}, {0, 1, 0}, sx, sy, Material::kCeiling, random.Next(), true);
}

void BuildCorridor(WorldBuilder& b, const WorldOptions& o) {
  const double sx = o.size_m.x(), sy = o.size_m.y(), h = o.size_m.z(), cw = o.corridor_width_m;
  const std::array<Place, 4> outer = {Place{{sx, 0, 0}, kHalfTurn}, Place{{sx, sy, 0}, -0.5 * kHalfTurn},
                                      Place{{0, sy, 0}, 0.0}, Place{{0, 0, 0}, 0.5 * kHalfTurn}};
  const std::array<Place, 4> inner = {Place{{cw, cw, 0}, 0.0}, Place{{sx - cw, cw, 0}, 0.5 * kHalfTurn},
                                      Place{{sx - cw, sy - cw, 0}, kHalfTurn},
                                      Place{{cw, sy - cw, 0}, -0.5 * kHalfTurn}};
  const std::array<double, 4> lengths = {sx, sy, sx, sy};
  for (std::size_t side = 0; side < 4; ++side) {
    const std::uint64_t side_seed = Derive(o.seed, o.aliased_sides && side == 2 ? 0 : side);
    for (const bool is_outer : {true, false}) {
      const double length = is_outer ? lengths[side] : lengths[side] - 2.0 * cw;
      const Place& wall = is_outer ? outer[side] : inner[side];
      Random random(Derive(side_seed, is_outer ? 1 : 2));
      const int panels = std::max(1, static_cast<int>(std::lround(length / 2.4)));
      const double width = length / panels;
      const int rich = panels - (o.soft_side ? SoftPanels(side, is_outer, panels, (cw + kSoftBeyond_m) / width) : 0);
      if (rich < panels) {
        AddWall(b, wall.At(rich * width, 0), (panels - rich) * width, h, Material::kStripes, Derive(side_seed, 4));
      }
      for (int k = 0; k < rich; ++k) {
        const std::uint64_t seed = random.Next();
        const bool blank = random.Uniform() < o.blank_share;
        AddWall(b, wall.At(k * width, 0), width, h, blank ? Material::kBlank : RichWall(random), seed);
        if (blank || o.furniture_density <= 0.0) continue;
        Random inside(Derive(seed, 1));
        const Place panel = wall.At(k * width, 0);
        const bool corner = is_outer && (k == 0 || k == panels - 1);
        const double pick = inside.Uniform();
        if (corner || pick > o.furniture_density || pick < 0.35) {
          AddPosters(b, panel, 0.2, width - 0.2, 0.8, 2.2, inside);
        } else if (pick < 0.55) {
          AddDoor(b, panel.At(0.3, 0), inside.Next());
          AddPosters(b, panel, 1.35, width - 0.1, 0.8, 2.2, inside);
        } else if (pick < 0.75) {
          AddCabinet(b, panel.At(0.4, 0), 0.9, inside.Next());
          AddPosters(b, panel, 0.2, width - 0.2, 1.6, 2.3, inside);
        } else if (pick < 0.9) {
          AddShelf(b, panel.At(0.5, 0), 1.0, inside.Next());
        } else {
          AddBoxes(b, panel.At(0.5, 0), 0.6, inside.Next());
          AddPosters(b, panel, 0.2, width - 0.2, 1.45, 2.3, inside);
        }
      }
    }
    // Floor and ceiling of this side: its length less one corner, so that the four cover the loop once. The far end of
    // one side is the near end of the next.
    const Place& wall = outer[side];
    const Vector3d right = Place{Vector3d::Zero(), wall.yaw_rad}.ToWorld({1, 0, 0});
    const Vector3d away = Place{Vector3d::Zero(), wall.yaw_rad}.ToWorld({0, 1, 0});
    const double length = lengths[side] - cw;
    Random random(Derive(side_seed, 3));
    const bool soft = o.soft_side && side == 1;
    const Material floor = random.Below(2) == 0 ? Material::kTiles : Material::kCarpet;
    b.AddRectangle(wall.ToWorld({0, 0, 0}), right, -away, length, cw, soft ? Material::kStripes : floor, random.Next(),
                   true, true);
    if (o.soft_side && side == 2) {  // what is seen of it from the soft side
      const double beyond = kSoftBeyond_m, from = lengths[side] - cw - beyond;
      b.AddRectangle(wall.ToWorld({from, 0, 0.002}), right, -away, beyond, cw, Material::kStripes,
                     Derive(side_seed, 5));
      b.AddRectangle(wall.ToWorld({from, -cw, h - 0.002}), right, away, beyond, cw, Material::kStripes,
                     Derive(side_seed, 6));
    }
    b.AddRectangle(wall.ToWorld({0, -cw, h}), right, away, length, cw, soft ? Material::kStripes : Material::kCeiling,
                   random.Next(), true);
  }
}

}  // namespace cairn::synth
