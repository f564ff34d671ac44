#include <algorithm>
#include <array>
#include <cmath>

#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

constexpr double kSoftBeyond_m = 1.2;  // of the wall at the end of a soft side, past its corridor

// How many of a wall's panels, the last ones, have nothing but stripes on a corridor with a soft side: all of that
// side, the second; and `at_the_end` of the next side's outer wall, towards which one walks there.
int SoftPanels(std::size_t side, bool is_outer, int panels, double at_the_end) {
  if (side == 1) return panels;
  return side == 2 && is_outer ? std::min(panels, static_cast<int>(std::ceil(at_the_end))) : 0;
}

}  // namespace

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
          AddPosters(b, panel, 0.2, width - 0.2, 0.8, 2.2, 0, inside);
        } else if (pick < 0.55) {
          AddDoor(b, panel.At(0.3, 0), inside.Next());
          AddPosters(b, panel, 1.35, width - 0.1, 0.8, 2.2, 0, inside);
        } else if (pick < 0.75) {
          const std::uint64_t cabinet = inside.Next();
          AddCabinet(b, panel.At(0.4, 0), 0.9, cabinet, cabinet);
          AddPosters(b, panel, 0.2, width - 0.2, 1.6, 2.3, 0, inside);
        } else if (pick < 0.9) {
          const std::uint64_t shelf = inside.Next();
          AddShelf(b, panel.At(0.5, 0), 1.0, shelf, shelf);
        } else {
          AddBoxes(b, panel.At(0.5, 0), 0.6, inside.Next());
          AddPosters(b, panel, 0.2, width - 0.2, 1.45, 2.3, 0, inside);
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
