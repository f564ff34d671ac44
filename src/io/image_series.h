// The image files of a folder as the recordings that they are: in natural order (9.png before 10.png), and without what
// lies beside the camera's images: depth, masks, labels, stray pictures. Two cameras in one folder are an error.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::io {

// Numbers in names by their value, everything else by its bytes.
bool NaturalLess(absl::string_view a, absl::string_view b);

struct ImageSeries {
  std::vector<std::string> names;
  std::vector<std::string> notes;  // for people: what was left out, and in which order they are
};

// The camera's images among those in a folder, of which `size` are the camera's (empty: not known). InvalidArgument
// names the series where several could be the camera's, and what to do.
absl::StatusOr<ImageSeries> FindImageSeries(const std::filesystem::path& folder, cv::Size size);

}  // namespace cairn::io
