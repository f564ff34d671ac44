// Pictures that look like camera frames, put together from photographs, textures and cut-out objects: the training
// images of the default vocabulary.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/random.h"
#include "base/status.h"

namespace cairn::train {

// A grey picture and, for cut-out objects, its opacity (both CV_8UC1, same size; no opacity: empty).
struct Picture {
  cv::Mat gray;
  cv::Mat opacity;
};

struct Library {
  std::vector<Picture> photographs;
  std::vector<Picture> textures;
  std::vector<Picture> objects;
};

// Reads the pictures (png, jpg, jpeg, webp) under `folder`, in the order of their paths, reduced to at most
// `max_side_px`; those that are smaller than 48 px on a side, (almost) of one shade or unreadable are left out. Of more
// than `max_count`, evenly spaced ones. NotFound if there is none.
absl::StatusOr<std::vector<Picture>> LoadPictures(const std::string& folder, int max_side_px, std::size_t max_count);

// A 640x480 view: a photograph, or a room-like arrangement of textured and plain surfaces and objects; seen at an
// angle, with blur, exposure and noise of a camera. Depends on the library and the random numbers only.
cv::Mat MakeView(const Library& library, Random* random);

}  // namespace cairn::train
