// Furnished rooms and corridors made of textured rectangles, to be photographed by a virtual camera (render.h). The
// world frame is metric with z up; the floor is z = 0. A world is a function of its options alone.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/status.h"
#include "geometry/se3.h"
#include "synth/materials.h"
#include "synth/texture.h"

namespace cairn::synth {

enum class WorldKind {
  kRoom,      // one room, x in [0, size.x], y in [0, size.y], furnished along its walls
  kCorridor,  // a closed rectangular corridor; its outer wall spans [0, size.x] x [0, size.y]
  kRooms,  // two rooms of the same size at the ends of a straight passage along x; together [0, size.x] x [0, size.y]
};

struct WorldOptions {
  WorldKind kind = WorldKind::kRoom;
  std::uint64_t seed = 1;
  Vector3d size_m = Vector3d(6.6, 5.2, 2.8);
  double corridor_width_m = 2.2;  // of a corridor, or of the passage between rooms
  double passage_length_m = 4.0;  // between rooms
  // Share of the walls' area that is blank: plain paint, no posters.
  double blank_share = 0.0;
  // Corridor only: the two sides along x look exactly alike, panel by panel and object by object; the other two do not.
  bool aliased_sides = false;
  // Corridor only: everything on the second side, and the wall that is seen from it, is painted with soft-edged
  // stripes: enough gradients to track by, but next to no corners.
  bool soft_side = false;
  // 0: no furniture, bare walls.
  double furniture_density = 1.0;
  // Rooms only: furniture, posters and kinds of walls come from a catalogue of few models, the same for all worlds with
  // this number, so that these look alike; what stands where, what lies on it, books, boxes and stains are each world's
  // own. 0: everything is one of its kind.
  std::uint64_t catalogue = 0;
  double texels_per_m = 260.0;
  // Threads that paint the textures; the result does not depend on it.
  int threads = 2;

  absl::Status Validate() const;
};

// A flat rectangle seen from one side. Texture coordinates run along u and v.
struct Quad {
  Eigen::Vector3f corner;  // where the texture's first texel lies
  Eigen::Vector3f u;       // unit vectors: to the right and down as seen
  Eigen::Vector3f v;
  Eigen::Vector3f normal;  // towards the viewer
  float size_u_m = 0.0f;
  float size_v_m = 0.0f;
  float texels_per_m_u = 0.0f;
  float texels_per_m_v = 0.0f;
  float shade = 1.0f;  // light that falls on it, times the texture's reflectance
  int texture = 0;
};

struct Hit {
  int quad = 0;
  double distance_m = 0.0;  // along the ray, of unit length
  Vector3d point_w = Vector3d::Zero();
};

class World {
 public:
  static absl::StatusOr<World> Create(const WorldOptions& options);

  const WorldOptions& options() const { return options_; }
  const std::vector<Quad>& quads() const { return quads_; }
  const std::vector<Texture>& textures() const { return textures_; }

  // The first surface that a ray meets, tried against every quad; for checks, the renderer has its own way.
  std::optional<Hit> Cast(const Vector3d& origin_w, const Vector3d& direction_w) const;

 private:
  friend class WorldBuilder;

  WorldOptions options_;
  std::vector<Quad> quads_;
  std::vector<Texture> textures_;
};

}  // namespace cairn::synth
