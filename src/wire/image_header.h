// What a PNG or JPEG file says of its size, read without decoding it: so that nobody allocates what a stranger claims.
#pragma once

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::wire {

struct ImageSize {
  int width_px = 0;
  int height_px = 0;
  bool operator==(const ImageSize&) const = default;
};

// InvalidArgument for what is neither, or ends before it says.
absl::StatusOr<ImageSize> EncodedImageSize(absl::string_view file);

}  // namespace cairn::wire
