// How far the camera has turned between two views, from thumbnails alone: a coarse guess to align a lost frame with. As
// the small blurry images of Klein and Murray, "Improving the Agility of Keyframe-Based SLAM" (ECCV 2008), but searched
// over all shifts of up to half an image instead of by gradients.
#pragma once

#include <vector>

#include "direct/image_pyramid.h"
#include "geometry/se3.h"

namespace cairn::direct {

// One level of a pyramid, about 40 px wide; intensities only.
struct Thumbnail {
  int level = 0;
  int width = 0;
  int height = 0;
  std::vector<float> gray;  // row-major
};

struct ViewShift {
  double correlation = -1.0;  // of the overlap at the best shift, -1 to 1
  Quaterniond new_from_reference = Quaterniond::Identity();
};

Thumbnail MakeThumbnail(const ImagePyramid& image, const PyramidGeometry& geometry);

// The shift with the best correlation over at least half of the thumbnail in each direction, as a rotation of the
// camera. Both of the same geometry; correlation -1 if either is empty or blank.
ViewShift FindShift(const Thumbnail& reference, const Thumbnail& view, const PyramidGeometry& geometry);

}  // namespace cairn::direct
