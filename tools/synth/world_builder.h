// Puts rectangles and boxes together and has their textures painted at the end. Used by rooms and corridors.
#pragma once

#include <cstdint>
#include <numbers>
#include <vector>

#include "base/random.h"
#include "synth/world.h"

namespace cairn::synth {

// A place on the floor: x to the right, y away from the viewer, z up, as one stands facing a wall.
struct Place {
  Vector3d origin = Vector3d::Zero();
  double yaw_rad = 0.0;

  Vector3d ToWorld(const Vector3d& local) const;
  Place At(double x, double y, double extra_yaw_rad = 0.0) const;
};

inline constexpr double kHalfTurn = std::numbers::pi;

// Faces of a box to build, as bits; those never seen are left out.
enum Face : unsigned {
  kFront = 1,
  kBack = 2,
  kLeft = 4,
  kRight = 8,
  kTop = 16,
  kBottom = 32,
  kSides = 15,
  kAllFaces = 63
};

class WorldBuilder {
 public:
  explicit WorldBuilder(const WorldOptions& options) { world_.options_ = options; }

  // `corner` at the upper left as seen, `right` and `down` unit vectors. `shadows`: darkened towards its edges, and
  // where things stand on it if it is the floor.
  void AddRectangle(const Vector3d& corner, const Vector3d& right, const Vector3d& down, double width_m,
                    double height_m, Material material, std::uint64_t seed, bool edges_shaded = false,
                    bool is_floor = false);

  // A box in the frame of `place`: x from, to; y from, to (away from the viewer); z from, to. The front faces -y.
  struct Extent {
    double x0, x1, y0, y1, z0, z1;
  };
  void AddBox(const Place& place, const Extent& extent, Material material, std::uint64_t seed,
              unsigned faces = kAllFaces & ~kBottom);
  // As AddBox, with another material on the front (a screen, a poster, a door).
  void AddPanel(const Place& place, const Extent& extent, Material front, Material rest, std::uint64_t seed,
                unsigned faces = kAllFaces & ~(kBottom | kBack));

  World Finish();

 private:
  struct Paint {
    Material material = Material::kBlank;
    double width_m = 0.0;
    double height_m = 0.0;
    std::uint64_t seed = 0;
    bool edges_shaded = false;
    bool is_floor = false;
  };
  cv::Mat PaintTexture(const Paint& paint, const Quad& quad) const;

  World world_;
  std::vector<Paint> paints_;
  std::vector<std::vector<cv::Point2d>> footprints_;  // of what stands on the floor, in world x, y
};

// Independent seeds for the parts of a thing.
std::uint64_t Derive(std::uint64_t seed, std::uint64_t index);

// What rooms and corridors are filled with (furniture.cc); `width` along the wall, the wall is at y = 0 of the place
// and the room at y < 0. `seed`: of the model; `contents`: of what lies on it or stands in it.
void AddDesk(WorldBuilder& builder, const Place& place, double width, std::uint64_t seed, std::uint64_t contents);
void AddShelf(WorldBuilder& builder, const Place& place, double width, std::uint64_t seed, std::uint64_t contents);
void AddCabinet(WorldBuilder& builder, const Place& place, double width, std::uint64_t seed, std::uint64_t contents);
void AddBoxes(WorldBuilder& builder, const Place& place, double width, std::uint64_t seed);
void AddDoor(WorldBuilder& builder, const Place& place, std::uint64_t seed);
void AddWindow(WorldBuilder& builder, const Place& place, double width, std::uint64_t seed);
void AddPoster(WorldBuilder& builder, const Place& place, double width, double height, double z, std::uint64_t seed);
void AddChair(WorldBuilder& builder, const Place& place, std::uint64_t seed);

// Walls (walls.cc).
Material RichWall(Random& random);
// A stretch of wall as one stands facing it: its left end on the floor, and the direction to the right.
void AddWall(WorldBuilder& builder, const Place& place, double width, double height, Material material,
             std::uint64_t seed);
// Posters over the free part of a wall, above `z`.
void AddPosters(WorldBuilder& builder, const Place& wall, double x0, double x1, double z, double z_max,
                std::uint64_t catalogue, Random& random);
// Things side by side along a wall between x0 and x1. `catalogue`, `density`: as in WorldOptions.
struct Furnishing {
  double height_m = 0.0;  // of the wall
  double density = 1.0;
  bool blank = false;  // nothing but the wall
  std::uint64_t catalogue = 0;
};
void FurnishWall(WorldBuilder& builder, const Place& wall, double x0, double x1, const Furnishing& furnishing,
                 Random& random);

void BuildRoom(WorldBuilder& builder, const WorldOptions& options);
void BuildCorridor(WorldBuilder& builder, const WorldOptions& options);
void BuildRooms(WorldBuilder& builder, const WorldOptions& options);

}  // namespace cairn::synth
