// The images of a model's keyframes, from the sequence that they were mapped from: as the model's cameras would have
// taken them, without the lens's distortion and what the map found that the calibration left over.
#pragma once

#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <unordered_map>

#include "base/status.h"
#include "exchange/reconstruction.h"
#include "image/undistort.h"
#include "map/snapshot.h"

namespace cairn::exchange {

class ModelImages {
 public:
  // For the keyframes of those sessions whose source is `sequence`. They are written into `folder`, which is made if it
  // does not exist; empty: only the points are coloured. NotFound if the model has no keyframe of that sequence.
  static absl::StatusOr<ModelImages> Create(const map::Snapshot& map, const Reconstruction& model,
                                            const std::string& sequence, const std::string& folder, bool overwrite);

  // One image of the sequence, raw, CV_8UC1. False if no keyframe was taken at that time. InvalidArgument if it does
  // not fit the camera.
  absl::StatusOr<bool> Add(TimeNs time_ns, const cv::Mat& raw);

  std::size_t num_images() const { return images_.size(); }
  std::size_t num_written() const { return num_written_; }

  // Gives each point the mean of the gray values where it was observed; returns how many points were seen in an image.
  std::size_t ColorPoints(Reconstruction* model) const;

 private:
  struct Lens {
    std::optional<image::Undistorter> raw;    // from the raw image to the undistorted one
    std::optional<image::Undistorter> ideal;  // from there to what the pinhole sees; none: that is the same
  };
  absl::StatusOr<const Lens*> LensOf(std::uint32_t camera);

  std::shared_ptr<const std::map<CameraId, map::MapCamera>> cameras_;
  std::map<TimeNs, const ModelImage*> images_;  // by time; of the model, which must live as long
  std::map<std::uint32_t, Lens> lenses_;
  std::string folder_;
  bool overwrite_ = false;
  std::size_t num_written_ = 0;
  struct Sum {
    double value = 0.0;
    int count = 0;
  };
  std::unordered_map<std::uint32_t, Sum> gray_;  // per point
};

}  // namespace cairn::exchange
