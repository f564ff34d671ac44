#include "direct/pixel_selector.h"

#include <algorithm>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr int kBlockPx = 32;
constexpr int kHistogramBins = 128;                   // of one gray level per pixel
constexpr float kPassShare[3] = {1.0f, 0.75f, 0.5f};  // of the threshold on the gradient magnitude

}  // namespace

void PixelSelector::ComputeThresholds(const ImagePyramid& pyramid, float offset) {
  const int width = pyramid.Width(0), height = pyramid.Height(0);
  blocks_x_ = std::max(1, width / kBlockPx);
  blocks_y_ = std::max(1, height / kBlockPx);
  block_raw_.assign(static_cast<std::size_t>(blocks_x_) * blocks_y_, 0.0f);
  block_threshold_.resize(block_raw_.size());
  for (int by = 0; by < blocks_y_; ++by) {
    for (int bx = 0; bx < blocks_x_; ++bx) {
      int histogram[kHistogramBins] = {};
      int count = 0;
      const int x_end = bx + 1 == blocks_x_ ? width : (bx + 1) * kBlockPx;
      const int y_end = by + 1 == blocks_y_ ? height : (by + 1) * kBlockPx;
      for (int y = std::max(1, by * kBlockPx); y < std::min(y_end, height - 1); ++y) {
        for (int x = std::max(1, bx * kBlockPx); x < std::min(x_end, width - 1); ++x) {
          const float magnitude = std::sqrt(pyramid.At(0, x, y)[3]);
          ++histogram[std::min(static_cast<int>(magnitude), kHistogramBins - 1)];
          ++count;
        }
      }
      int rest = count / 2, bin = 0;
      while (bin < kHistogramBins - 1 && rest >= histogram[bin]) rest -= histogram[bin++];
      block_raw_[static_cast<std::size_t>(by) * blocks_x_ + bx] = static_cast<float>(bin) + offset;
    }
  }
  for (int by = 0; by < blocks_y_; ++by) {
    for (int bx = 0; bx < blocks_x_; ++bx) {
      float sum = 0.0f;
      int count = 0;
      for (int y = std::max(0, by - 1); y <= std::min(blocks_y_ - 1, by + 1); ++y) {
        for (int x = std::max(0, bx - 1); x <= std::min(blocks_x_ - 1, bx + 1); ++x) {
          sum += block_raw_[static_cast<std::size_t>(y) * blocks_x_ + x];
          ++count;
        }
      }
      const float mean = sum / static_cast<float>(count);
      block_threshold_[static_cast<std::size_t>(by) * blocks_x_ + bx] = mean * mean;
    }
  }
}

void PixelSelector::SelectWithCell(const ImagePyramid& pyramid, int cell_px, int border_px,
                                   std::vector<SelectedPixel>* selected) {
  selected->clear();
  const int width = pyramid.Width(0), height = pyramid.Height(0);
  const int large = 4 * cell_px;
  for (int y4 = border_px; y4 < height - border_px; y4 += large) {
    for (int x4 = border_px; x4 < width - border_px; x4 += large) {
      float best4 = 0.0f;
      SelectedPixel pixel4;
      bool any4 = false;
      for (int y2 = y4; y2 < std::min(y4 + large, height - border_px); y2 += 2 * cell_px) {
        for (int x2 = x4; x2 < std::min(x4 + large, width - border_px); x2 += 2 * cell_px) {
          float best2 = 0.0f;
          SelectedPixel pixel2;
          bool any2 = false;
          for (int y1 = y2; y1 < std::min(y2 + 2 * cell_px, height - border_px); y1 += cell_px) {
            for (int x1 = x2; x1 < std::min(x2 + 2 * cell_px, width - border_px); x1 += cell_px) {
              float best1 = 0.0f;
              SelectedPixel pixel1;
              for (int y = y1; y < std::min(y1 + cell_px, height - border_px); ++y) {
                const float* pixel = pyramid.At(0, x1, y);
                const std::size_t row = static_cast<std::size_t>(std::min(y / kBlockPx, blocks_y_ - 1)) * blocks_x_;
                for (int x = x1; x < std::min(x1 + cell_px, width - border_px); ++x, pixel += ImagePyramid::kChannels) {
                  const float g2 = pixel[3];
                  const float threshold = block_threshold_[row + std::min(x / kBlockPx, blocks_x_ - 1)];
                  const SelectedPixel here{static_cast<std::int16_t>(x), static_cast<std::int16_t>(y), 0};
                  if (g2 > threshold && g2 > best1) best1 = g2, pixel1 = here;
                  if (g2 > threshold * kPassShare[1] * kPassShare[1] && g2 > best2) best2 = g2, pixel2 = here;
                  if (g2 > threshold * kPassShare[2] * kPassShare[2] && g2 > best4) best4 = g2, pixel4 = here;
                }
              }
              if (best1 > 0.0f) {
                selected->push_back(pixel1);
                any2 = any4 = true;
              }
            }
          }
          if (!any2 && best2 > 0.0f) {
            pixel2.pass = 1;
            selected->push_back(pixel2);
            any4 = true;
          }
        }
      }
      if (!any4 && best4 > 0.0f) {
        pixel4.pass = 2;
        selected->push_back(pixel4);
      }
    }
  }
}

void PixelSelector::Select(const ImagePyramid& pyramid, int wanted, double gradient_offset_gray, int border_px,
                           std::vector<SelectedPixel>* selected) {
  ComputeThresholds(pyramid, static_cast<float>(gradient_offset_gray));
  // The count falls with the square of the cell: two corrections are enough.
  for (int attempt = 0; attempt < 3; ++attempt) {
    SelectWithCell(pyramid, cell_px_, border_px, selected);
    const double ratio = static_cast<double>(selected->size()) / wanted;
    if (attempt == 2 || (ratio > 0.8 && ratio < 1.25)) break;
    const int better = std::clamp(static_cast<int>(std::lround((cell_px_ + 1) * std::sqrt(ratio))) - 1, 1, 32);
    if (better == cell_px_) break;
    cell_px_ = better;
  }
  // Too many: every k-th is left out, evenly.
  const std::size_t limit = static_cast<std::size_t>(wanted);
  if (selected->size() > limit + limit / 10) {
    const std::size_t have = selected->size();
    std::size_t kept = 0;
    for (std::size_t i = 0; i < have; ++i) {
      if ((i * limit) / have != ((i + 1) * limit) / have) (*selected)[kept++] = (*selected)[i];
    }
    selected->resize(kept);
  }
}

}  // namespace cairn::direct
