#include <array>
#include <cmath>
#include <numbers>

#include "base/random.h"
#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

void AddLegs(WorldBuilder& b, const Place& place, const WorldBuilder::Extent& top, double thickness,
             std::uint64_t seed) {
  int leg = 0;
  for (const double x : {top.x0, top.x1 - thickness}) {
    for (const double y : {top.y0, top.y1 - thickness}) {
      b.AddBox(place, {x, x + thickness, y, y + thickness, 0.0, top.z0}, Material::kMetal,
               Derive(seed, 40 + static_cast<std::uint64_t>(leg++)), kSides);
    }
  }
}

// Small things on a surface at height z, from x0 to x1, with their backs near y1.
void AddClutter(WorldBuilder& b, const Place& place, double x0, double x1, double y0, double y1, double z,
                std::uint64_t seed) {
  Random random(seed);
  double x = x0 + random.Uniform(0.02, 0.1);
  while (x < x1 - 0.12) {
    const double w = std::min(random.Uniform(0.1, 0.3), x1 - x - 0.02),
                 d = std::min(random.Uniform(0.1, 0.25), y1 - y0);
    const double h = random.Uniform(0.05, 0.3);
    const double y = random.Uniform(y0, std::max(y0 + 0.001, y1 - d));
    const Place at = place.At(x + 0.5 * w, y + 0.5 * d, random.Uniform(-0.35, 0.35));
    const std::array<Material, 5> kinds = {Material::kCardboard, Material::kPoster, Material::kBooks, Material::kMetal,
                                           Material::kPage};
    const Material kind = kinds[random.Below(kinds.size())];
    const std::uint64_t thing = random.Next();
    const WorldBuilder::Extent extent{-0.4 * w, 0.4 * w, -0.4 * d,
                                      0.4 * d,  z,       z + (kind == Material::kPage ? 0.02 : h)};
    b.AddPanel(at, extent, kind, kind == Material::kBooks ? Material::kPage : kind, thing, kAllFaces & ~kBottom);
    x += w + random.Uniform(0.03, 0.2);
  }
}

}  // namespace

void AddDesk(WorldBuilder& b, const Place& place, double width, std::uint64_t seed, std::uint64_t contents) {
  Random random(seed);
  const double depth = random.Uniform(0.65, 0.78), height = random.Uniform(0.71, 0.77);
  const WorldBuilder::Extent top{0.0, width, -depth, -0.03, height - 0.03, height};
  b.AddBox(place, top, Material::kWood, Derive(seed, 1), kAllFaces);
  AddLegs(b, place, top, 0.05, seed);
  b.AddBox(place, {width - 0.5, width - 0.06, -depth + 0.08, -0.08, 0.05, height - 0.04}, Material::kMetal,
           Derive(seed, 2), kSides);
  const int screens = width > 1.45 ? 2 : 1;
  for (int i = 0; i < screens; ++i) {
    const double x = width * (i + 0.5) / screens + random.Uniform(-0.06, 0.06);
    const Place at = place.At(x, -0.3, random.Uniform(-0.3, 0.3));
    b.AddPanel(at, {-0.27, 0.27, -0.02, 0.02, height + 0.11, height + 0.45}, Material::kScreen, Material::kMetal,
               Derive(seed, 10 + static_cast<std::uint64_t>(i)), kAllFaces);
    b.AddBox(at, {-0.04, 0.04, 0.0, 0.05, height, height + 0.12}, Material::kMetal, Derive(seed, 14), kSides);
    b.AddBox(at, {-0.22, 0.22, -0.32, -0.18, height, height + 0.025}, Material::kPage, Derive(seed, 15),
             kAllFaces & ~kBottom);
  }
  AddClutter(b, place, 0.02, width - 0.02, -depth + 0.04, -0.36, height, Derive(contents, 20));
  AddClutter(b, place, 0.02, width - 0.02, -0.22, -0.06, height, Derive(contents, 21));
}

void AddShelf(WorldBuilder& b, const Place& place, double width, std::uint64_t seed, std::uint64_t contents) {
  Random random(seed);
  const double depth = random.Uniform(0.28, 0.36), height = random.Uniform(1.7, 2.1), board = 0.025;
  b.AddBox(place, {0.0, board, -depth, 0.0, 0.0, height}, Material::kWood, Derive(seed, 1),
           kFront | kLeft | kRight | kTop);
  b.AddBox(place, {width - board, width, -depth, 0.0, 0.0, height}, Material::kWood, Derive(seed, 2),
           kFront | kLeft | kRight | kTop);
  b.AddBox(place, {board, width - board, -0.02, 0.0, 0.0, height}, Material::kWood, Derive(seed, 3), kFront);
  Random inside = contents == seed ? random : Random(contents);
  const int levels = 5;
  const double pitch = (height - board) / levels;
  for (int i = 0; i <= levels; ++i) {
    const double z = i * pitch;
    const std::uint64_t level = Derive(seed, 10 + static_cast<std::uint64_t>(i));
    b.AddBox(place, {board, width - board, -depth, -0.02, z, z + board}, Material::kWood, level,
             i == 0 ? kFront | kTop : kFront | kTop | kBottom);
    if (i == levels) {
      AddClutter(b, place, 0.05, width - 0.05, -depth + 0.03, -0.03, z + board,
                 Derive(Derive(contents, 10 + static_cast<std::uint64_t>(i)), 1));
      break;
    }
    double x = board + inside.Uniform(0.0, 0.05);
    while (x < width - board - 0.12) {
      const double w = std::min(inside.Uniform(0.14, 0.42), width - board - x);
      const double h = pitch * inside.Uniform(0.55, 0.85), front = -depth + inside.Uniform(0.02, 0.1);
      const bool books = inside.Below(4) != 0;
      b.AddPanel(place, {x, x + w - 0.01, front, -0.025, z + board, z + board + (books ? h : 0.6 * h)},
                 books ? Material::kBooks : Material::kCardboard, books ? Material::kPage : Material::kCardboard,
                 inside.Next(), kFront | kLeft | kRight | kTop);
      x += w + (inside.Below(3) == 0 ? inside.Uniform(0.05, 0.2) : 0.005);
    }
  }
}

void AddCabinet(WorldBuilder& b, const Place& place, double width, std::uint64_t seed, std::uint64_t contents) {
  Random random(seed);
  const double depth = random.Uniform(0.4, 0.5), height = random.Uniform(0.85, 1.3);
  b.AddPanel(place, {0.0, width, -depth, -0.01, 0.0, height}, Material::kMetal,
             random.Below(2) == 0 ? Material::kMetal : Material::kWood, Derive(seed, 1),
             kFront | kLeft | kRight | kTop);
  AddClutter(b, place, 0.03, width - 0.03, -depth + 0.03, -0.05, height, Derive(contents, 2));
}

void AddBoxes(WorldBuilder& b, const Place& place, double width, std::uint64_t seed) {
  Random random(seed);
  double z = 0.0, w = std::min(width, 0.7);
  for (int i = 0; i < 3 && w > 0.25; ++i) {
    const double h = random.Uniform(0.25, 0.42), d = std::min(0.55, w * random.Uniform(0.7, 0.95));
    const Place at = place.At(0.5 * width, -0.38, random.Uniform(-0.25, 0.25));
    b.AddBox(at, {-0.5 * w, 0.5 * w, -0.5 * d, 0.5 * d, z, z + h}, Material::kCardboard, random.Next());
    z += h;
    w *= random.Uniform(0.65, 0.92);
  }
}

void AddDoor(WorldBuilder& b, const Place& place, std::uint64_t seed) {
  b.AddPanel(place, {0.0, 0.95, -0.05, 0.0, 0.0, 2.08}, Material::kDoor, Material::kWood, seed,
             kFront | kLeft | kRight | kTop);
}

void AddWindow(WorldBuilder& b, const Place& place, double width, std::uint64_t seed) {
  b.AddPanel(place, {0.0, width, -0.04, 0.0, 0.95, 2.2}, Material::kWindow, Material::kWood, seed,
             kFront | kLeft | kRight | kTop | kBottom);
}

void AddPoster(WorldBuilder& b, const Place& place, double width, double height, double z, std::uint64_t seed) {
  b.AddPanel(place, {0.0, width, -0.02, 0.0, z, z + height}, Material::kPoster, Material::kWood, seed,
             kFront | kLeft | kRight | kTop | kBottom);
}

void AddChair(WorldBuilder& b, const Place& place, std::uint64_t seed) {
  const WorldBuilder::Extent seat{-0.22, 0.22, -0.22, 0.22, 0.42, 0.48};
  b.AddBox(place, seat, Material::kFabric, Derive(seed, 1), kAllFaces);
  AddLegs(b, place, seat, 0.035, seed);
  b.AddBox(place, {-0.21, 0.21, -0.24, -0.19, 0.5, 0.95}, Material::kFabric, Derive(seed, 2), kAllFaces);
}

}  // namespace cairn::synth
