// A reconstruction of another program, with its images, as a map: features are extracted anew (those of the other
// program are not ORB), matched between the images that its poses say see the same, and triangulated; the poses are
// kept and refined (mapping/posed_mapper.h). Its own points are not taken.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/status.h"
#include "engine/live_map.h"
#include "exchange/reconstruction.h"
#include "mapping/posed_mapper.h"

namespace cairn::care {

struct ModelImportOptions {
  // Poses are held as firmly as the model's own observations determine them, if it has any and these are not 0: ORB
  // features that are matched anew say no more than those that it was adjusted with.
  mapping::PosedMapperOptions mapper;
  // The model's lengths are metres: its frame becomes the world. Otherwise the map is not aligned, and its one
  // component lies in the model's frame, with the model's unit.
  bool metric = false;
  std::string source;  // how the session is called
};

struct ModelImport {
  std::int64_t images = 0;
  std::vector<std::string> skipped;  // what could not be used, and why
  int cameras = 0;                   // calibrations in the model
  mapping::PosedMapperReport report;
};

// `read` gives an image by its name in the model, CV_8UC1, raw. Images are taken in the order of their names; COLMAP
// knows no times, so that the k-th is given k seconds. Images of several cameras are brought to the pinhole of the one
// with most images, black where they do not reach. `progress` is told after each image; false ends the import
// (Cancelled). The map must be empty. FailedPrecondition if the model has no images, or its poses do not fit them.
absl::StatusOr<ModelImport> ImportModel(const exchange::Reconstruction& model, const ModelImportOptions& options,
                                        const std::function<absl::StatusOr<cv::Mat>(const std::string&)>& read,
                                        engine::LiveMap* live, const std::function<bool(int, int)>& progress = {});

}  // namespace cairn::care
