// What other programs call a reconstruction or a model: pinhole cameras, posed images with the points they see, points.
// The neutral form between a map and the files of those programs. One frame, "world": that of the map's world if its
// components are aligned, in metres, else that of one component. Pixel centres are at integers, as everywhere in Cairn.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "base/status.h"
#include "geometry/camera.h"
#include "inspect/measures.h"
#include "map/snapshot.h"

namespace cairn::exchange {

struct ModelImage {
  std::uint32_t id = 0;
  std::uint32_t camera = 0;
  std::string name;  // of its file, below the folder of the images
  TimeNs time_ns = 0;
  SE3 camera_from_world;
  std::vector<Vector2d> keypoints;
  std::vector<std::uint32_t> points;  // per keypoint: the point it observes, or 0
};

struct ModelObservation {
  std::uint32_t image = 0;
  std::uint32_t keypoint = 0;
};

struct ModelPoint {
  std::uint32_t id = 0;
  Vector3d position = Vector3d::Zero();
  std::uint8_t red = 128, green = 128, blue = 128;
  double error_rms_px = 0.0;   // of the distances of its keypoints from where it should be seen
  double error_mean_px = 0.0;  // of these distances: what COLMAP calls the error of a point
  std::vector<ModelObservation> track;
};

struct Reconstruction {
  std::map<std::uint32_t, Camera> cameras;
  std::vector<ModelImage> images;  // ascending by id, as the points
  std::vector<ModelPoint> points;
  bool metric = false;        // the world's lengths are metres
  inspect::LeftOut left_out;  // of the map, but not here
};

// Which components: the given one, or without any all that are aligned, or else the one with most keyframes.
// NotFound if the map has none of that id, or no keyframe. Images are named "s<session>_<frame index>.png".
absl::StatusOr<Reconstruction> FromMap(const map::Snapshot& map, ComponentId component = {});

struct ModelErrors {
  std::int64_t observations = 0;
  double rms_px = 0.0;             // of the distances of keypoints from where their points should be seen
  double mean_px = 0.0;            // of these distances
  double mean_of_points_px = 0.0;  // mean over the points of ModelPoint::error_mean_px: what COLMAP tells
};
ModelErrors MeasureErrors(const Reconstruction& model);

}  // namespace cairn::exchange
