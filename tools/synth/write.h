// Writes a virtual recording as a data set that any reader of that format takes.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "synth/sequence.h"

namespace cairn::synth {

enum class DatasetFormat {
  kEuroc,   // mav0/cam0/{data.csv, sensor.yaml, data/*.png}, mav0/state_groundtruth_estimate0/data.csv: the body at 200
            // Hz, groundtruth_cam0.txt: the camera at each image, TUM format
  kTumMono  // camera.txt, times.txt with exposures, pcalib.txt, vignette.png, images/*.png, groundtruth.txt: the camera
            // at each image, TUM format
};

// "euroc", "tum_mono".
absl::string_view DatasetFormatName(DatasetFormat format);
absl::StatusOr<DatasetFormat> DatasetFormatFromName(absl::string_view name);

struct DatasetOptions {
  SequenceOptions sequence;
  DatasetFormat format = DatasetFormat::kEuroc;
  // overlap.txt says of each image how much of what it shows this session of the same world shows too (overlap.h).
  std::optional<int> overlap_with_session;
  // Images rendered at a time; the files do not depend on it.
  int threads = 2;
  // False: AlreadyExists if the folder is there and not empty. True: a data set in it is replaced.
  bool overwrite = false;

  absl::Status Validate() const;
};

// `progress` (may be null) hears how many of how many images are done, from any of the threads, one at a time; false
// stops with Cancelled.
absl::Status GenerateDataset(const DatasetOptions& options, const std::string& out_dir,
                             const std::function<bool(int done, int total)>& progress = nullptr);

}  // namespace cairn::synth
