// Choice of candidate pixels with enough gradient, spread over the image (DSO Sec. 3.2): per 32 x 32 block a threshold
// of the median gradient magnitude plus an offset, smoothed over neighbouring blocks; the best pixel per d x d cell
// above it; where a larger cell found none, another pass with a lower threshold (0.75, 0.5). d adapts to reach the
// wanted number.
#pragma once

#include <cstdint>
#include <vector>

#include "direct/image_pyramid.h"

namespace cairn::direct {

struct SelectedPixel {
  std::int16_t x = 0;
  std::int16_t y = 0;
  std::uint8_t pass = 0;  // 0: cells of d, full threshold; 1: cells of 2d, 0.75; 2: cells of 4d, 0.5
};

class PixelSelector {
 public:
  // About `wanted` pixels of level 0, in row order of their cells, at least `border_px` from the border.
  void Select(const ImagePyramid& pyramid, int wanted, double gradient_offset_gray, int border_px,
              std::vector<SelectedPixel>* selected);

 private:
  void ComputeThresholds(const ImagePyramid& pyramid, float offset);
  void SelectWithCell(const ImagePyramid& pyramid, int cell_px, int border_px, std::vector<SelectedPixel>* selected);

  int cell_px_ = 4;  // carried from image to image
  int blocks_x_ = 0;
  int blocks_y_ = 0;
  std::vector<float> block_threshold_;  // squared gradient, smoothed
  std::vector<float> block_raw_;
};

}  // namespace cairn::direct
