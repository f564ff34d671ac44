// Walls, and what stands along them and hangs on them.
#include <algorithm>
#include <array>
#include <cmath>

#include "synth/world_builder.h"

namespace cairn::synth {
namespace {

constexpr std::uint64_t kModels = 2;  // of each kind of furniture in a catalogue
constexpr std::uint64_t kPrints = 5;  // posters in it

// A piece of furniture: the model's seed, and that of what lies on it.
struct Piece {
  std::uint64_t model = 0;
  std::uint64_t contents = 0;
};

Piece Choose(std::uint64_t catalogue, std::uint64_t choice, std::uint64_t seed) {
  if (catalogue == 0) return {seed, seed};
  return {Derive(Derive(catalogue, 1000 + choice), seed % kModels), seed};
}

}  // namespace

Material RichWall(Random& random) {
  constexpr std::array<Material, 5> kWalls = {Material::kPlaster, Material::kWallpaper, Material::kBrick,
                                              Material::kPaneling, Material::kConcrete};
  return kWalls[random.Below(kWalls.size())];
}

void AddWall(WorldBuilder& b, const Place& place, double width, double height, Material material, std::uint64_t seed) {
  const Vector3d right = Place{Vector3d::Zero(), place.yaw_rad}.ToWorld({1, 0, 0});
  b.AddRectangle(place.ToWorld({0, 0, height}), right, Vector3d(0, 0, -1), width, height, material, seed,
                 material != Material::kBlank);
}

void AddPosters(WorldBuilder& b, const Place& wall, double x0, double x1, double z, double z_max,
                std::uint64_t catalogue, Random& random) {
  double x = x0 + random.Uniform(0.03, 0.15);
  while (x < x1 - 0.25) {
    const std::uint64_t print = catalogue == 0 ? 0 : Derive(Derive(catalogue, 500), random.Below(kPrints));
    Random of_print(print);
    Random& shape = catalogue == 0 ? random : of_print;
    const double w = std::min(shape.Uniform(0.3, 0.75), x1 - x - 0.03);
    const double h = std::clamp(w * shape.Uniform(0.7, 1.45), 0.2, std::max(0.2, z_max - z - 0.05));
    if (z + h < z_max) {
      AddPoster(b, wall.At(x, 0), w, h, random.Uniform(z, z_max - h), catalogue == 0 ? random.Next() : print);
    }
    x += w + random.Uniform(0.08, 0.4);
  }
}

void FurnishWall(WorldBuilder& b, const Place& wall, double x0, double x1, const Furnishing& f, Random& random) {
  double x = x0;
  while (x < x1 - 0.5) {
    const double left = x1 - x;
    const std::uint64_t seed = random.Next(), choice = random.Below(12);
    const bool skip = random.Uniform() >= f.density;
    const auto [model, contents] = Choose(f.catalogue, choice, seed);
    Random of_model(model);
    Random& shape = f.catalogue == 0 ? random : of_model;
    double w = random.Uniform(0.5, 0.9), clear_above = 0.4;
    if (skip || f.blank) {
      clear_above = f.blank ? f.height_m : 0.9;
    } else if (choice < 4 && left > 1.25) {
      w = std::min(shape.Uniform(1.3, 1.75), left);
      AddDesk(b, wall.At(x, 0), w, model, contents);
      if (random.Below(2) == 0) {
        AddChair(b, wall.At(x + 0.5 * w + random.Uniform(-0.2, 0.2), -1.0, random.Uniform(-0.6, 0.6)),
                 Derive(model, 99));
      }
      clear_above = 1.35;
    } else if (choice < 7 && left > 0.85) {
      w = std::min(shape.Uniform(0.85, 1.25), left);
      AddShelf(b, wall.At(x, 0), w, model, contents);
      clear_above = f.height_m;
    } else if (choice < 9 && left > 0.6) {
      w = std::min(shape.Uniform(0.6, 1.0), left);
      AddCabinet(b, wall.At(x, 0), w, model, contents);
      clear_above = 1.65;
    } else if (choice == 9 && left > 1.05) {
      w = 1.05;
      AddDoor(b, wall.At(x + 0.05, 0), model);
      clear_above = f.height_m;
    } else if (choice == 10 && left > 1.2) {
      w = std::min(shape.Uniform(1.2, 1.8), left);
      AddWindow(b, wall.At(x + 0.05, 0), w - 0.1, model);
      AddBoxes(b, wall.At(x + 0.1, 0), 0.6, Derive(contents, 98));
      clear_above = f.height_m;
    } else {
      w = std::min(0.8, left);
      AddBoxes(b, wall.At(x, 0), w, contents);
      clear_above = 1.4;
    }
    if (clear_above < f.height_m - 0.5) {
      AddPosters(b, wall, x, x + w, clear_above, std::min(f.height_m - 0.2, 2.35), f.catalogue, random);
    }
    x += w + random.Uniform(0.03, 0.25);
  }
}

}  // namespace cairn::synth
