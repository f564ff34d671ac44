// Files that other programs read, but for COLMAP's (colmap.h), as text.
#pragma once

#include <string>

#include "exchange/reconstruction.h"
#include "io/trajectory.h"
#include "map/snapshot.h"

namespace cairn::exchange {

// world_from_camera of the images, in the order of their times.
std::vector<io::StampedPose> Trajectory(const Reconstruction& model);

// KITTI: the upper three rows of world_from_camera, a line each; times are in a file of their own.
std::string KittiText(const std::vector<io::StampedPose>& poses);
std::string KittiTimesText(const std::vector<io::StampedPose>& poses);
// EuRoC: "ns, x, y, z, qw, qx, qy, qz" of the camera (not of a body), with a comment that says so.
std::string EurocText(const std::vector<io::StampedPose>& poses);

// nerfstudio's transforms.json: world_from_camera with the camera's y up and z backwards (OpenGL), file names below
// "images/". Pixel centres at halves, as there.
std::string TransformsJson(const Reconstruction& model);

// g2o's VERTEX_SE3:QUAT (world_from_camera) and EDGE_SE3:QUAT between covisible keyframes with at least
// map::kMinEssentialPoints points in common or one above the other in the spanning tree; the information of an edge is
// the identity times the number of points in common.
std::string G2oText(const Reconstruction& model, const map::Snapshot& map);

// Everything of the model, with what the map knows of it: sessions, components and how they are aligned, cameras,
// images with poses and observations, points.
std::string ModelJson(const Reconstruction& model, const map::Snapshot& map);

}  // namespace cairn::exchange
