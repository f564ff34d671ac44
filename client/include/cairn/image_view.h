/// \file
/// Pixels that belong to somebody else.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cairn/export.h"
#include "cairn/status.h"

CAIRN_BEGIN_NAMESPACE

/// How the bytes of a pixel follow each other.
enum class PixelFormat {
  kGray8,  ///< one byte: brightness
  kRgb8,   ///< three bytes: red, green, blue
  kBgr8,   ///< three bytes: blue, green, red, as OpenCV has them
};

/// An image as the camera gives it, not undistorted, 8 bits per channel. The pixels must stay as they are until the
/// call that they are given to returns, and not longer: nothing keeps them.
struct ImageView {
  const std::uint8_t* data = nullptr;  ///< the first byte of the upper left pixel
  int width_px = 0;                    ///< pixels in a row
  int height_px = 0;                   ///< rows
  std::ptrdiff_t stride_bytes = 0;     ///< from the start of a row to that of the next one; 0: no gap between rows
  PixelFormat format = PixelFormat::kGray8;  ///< colours are made grey as ITU-R BT.601 says

  /// kInvalidArgument if there are no pixels, or the stride is shorter than a row.
  CAIRN_API absl::Status Validate() const noexcept;
};

CAIRN_END_NAMESPACE
