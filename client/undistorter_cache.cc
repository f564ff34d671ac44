#include "client/undistorter_cache.h"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace cairn::client {
namespace {

constexpr std::size_t kKeptUndistorters = 4;
constexpr std::int64_t kKeptPixels = 50'000'000;  // of all of them, 6 bytes each; the last one is kept in any case

}  // namespace

std::shared_ptr<const image::Undistorter> UndistorterCache::Known(const Camera& camera) {
  const std::lock_guard lock(mutex_);
  const auto known = std::find_if(undistorters_.begin(), undistorters_.end(),
                                  [&](const auto& undistorter) { return undistorter->camera() == camera; });
  if (known == undistorters_.end()) return nullptr;
  std::rotate(undistorters_.begin(), known, known + 1);
  return undistorters_.front();
}

// Others are answered meanwhile; two that ask with the same new camera at once make the same twice, and keep one.
absl::StatusOr<std::shared_ptr<const image::Undistorter>> UndistorterCache::For(const Camera& camera) {
  if (auto known = Known(camera)) return known;
  CAIRN_ASSIGN_OR_RETURN(image::Undistorter made, image::Undistorter::Create(camera));
  auto undistorter = std::make_shared<const image::Undistorter>(std::move(made));
  if (auto known = Known(camera)) return known;
  std::vector<std::shared_ptr<const image::Undistorter>> dropped;  // freed without the lock
  const std::lock_guard lock(mutex_);
  undistorters_.insert(undistorters_.begin(), undistorter);
  std::int64_t pixels = 0;
  for (std::size_t i = 0; i < undistorters_.size(); ++i) {
    const Camera& kept = undistorters_[i]->camera();
    pixels += undistorters_[i]->identity() ? 0 : std::int64_t{kept.width_px} * kept.height_px;
    if (i == 0 || (i < kKeptUndistorters && pixels <= kKeptPixels)) continue;
    dropped.assign(undistorters_.begin() + static_cast<std::ptrdiff_t>(i), undistorters_.end());
    undistorters_.resize(i);
  }
  return undistorter;
}

}  // namespace cairn::client
