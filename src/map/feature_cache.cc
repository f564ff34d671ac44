#include "map/feature_cache.h"

namespace cairn::map {
namespace {

std::size_t BytesOf(const KeyframeFeatures& features) {
  return sizeof(features) + features.features.keypoints.capacity() * sizeof(image::Keypoint) +
         features.features.descriptors.capacity() * sizeof(image::Descriptor) +
         features.words.capacity() * sizeof(std::uint32_t);
}

}  // namespace

struct FeatureHandle::Slot {
  Slot(std::shared_ptr<FeatureCache> owner, KeyframeId id, std::size_t num)
      : cache(std::move(owner)), keyframe(id), count(num) {}
  ~Slot() {
    const std::lock_guard lock(cache->mutex_);
    if (kept != nullptr) cache->Drop(this);
  }

  const std::shared_ptr<FeatureCache> cache;
  const KeyframeId keyframe;
  const std::size_t count;
  // Guarded by the cache's mutex.
  std::shared_ptr<const KeyframeFeatures> kept;  // null: not there
  bool pinned = false;                           // there for good
  FeatureCache::Slots::iterator place;           // else, among those that are kept
};

std::size_t FeatureHandle::size() const {
  if (loaded_) return loaded_->features.size();
  return slot_ ? slot_->count : 0;
}

std::shared_ptr<const KeyframeFeatures> FeatureHandle::Get() const {
  return slot_ ? slot_->cache->Get(slot_.get(), /*pin=*/false) : loaded_;
}

const KeyframeFeatures& FeatureHandle::Pin() const { return *slot_->cache->Get(slot_.get(), /*pin=*/true); }

std::shared_ptr<FeatureCache> FeatureCache::Create(std::unique_ptr<FeatureReader> reader, std::size_t budget_bytes) {
  return std::shared_ptr<FeatureCache>(new FeatureCache(std::move(reader), budget_bytes));
}

FeatureCache::FeatureCache(std::unique_ptr<FeatureReader> reader, std::size_t budget_bytes)
    : budget_bytes_(budget_bytes), reader_(std::move(reader)) {}

FeatureHandle FeatureCache::OnDemand(KeyframeId keyframe, std::size_t count) {
  FeatureHandle features;
  features.slot_ = std::make_shared<FeatureHandle::Slot>(shared_from_this(), keyframe, count);
  return features;
}

FeatureHandle FeatureCache::OnDemand(KeyframeId keyframe, Pointer loaded) {
  FeatureHandle features = OnDemand(keyframe, loaded->features.size());
  const std::lock_guard lock(mutex_);
  Keep(features.slot_.get(), std::move(loaded));
  return features;
}

absl::Status FeatureCache::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

void FeatureCache::Note(const absl::Status& error) {
  const std::lock_guard lock(mutex_);
  status_.Update(error);
}

std::size_t FeatureCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

std::size_t FeatureCache::pinned() const {
  const std::lock_guard lock(mutex_);
  return pinned_;
}

FeatureCache::Pointer FeatureCache::Get(FeatureHandle::Slot* slot, bool pin) {
  const std::lock_guard lock(mutex_);
  if (slot->kept == nullptr) {
    Keep(slot, ReadOrStandIn(*slot));
  } else if (!slot->pinned) {
    kept_.splice(kept_.begin(), kept_, slot->place);
  }
  if (pin && !slot->pinned) {
    kept_.erase(slot->place);
    slot->pinned = true;
    ++pinned_;
  }
  return slot->kept;
}

FeatureCache::Pointer FeatureCache::ReadOrStandIn(const FeatureHandle::Slot& slot) {
  absl::StatusOr<Pointer> read = reader_->Read(slot.keyframe);
  if (read.ok() && *read != nullptr) {
    if ((*read)->features.size() == slot.count) return *std::move(read);
    read = absl::DataLossError(absl::StrCat("keyframe ", slot.keyframe.value(), " has ", (*read)->features.size(),
                                            " features instead of ", slot.count));
  }
  if (!read.ok() && status_.ok()) status_ = read.status();
  auto none = std::make_shared<KeyframeFeatures>();
  none->features.keypoints.resize(slot.count);
  none->features.descriptors.resize(slot.count);
  none->words.resize(slot.count);
  return none;
}

void FeatureCache::Keep(FeatureHandle::Slot* slot, Pointer features) {
  bytes_ += BytesOf(*features);
  slot->kept = std::move(features);
  kept_.push_front(slot);
  slot->place = kept_.begin();
  while (bytes_ > budget_bytes_ && kept_.size() > 1) Drop(kept_.back());
}

void FeatureCache::Drop(FeatureHandle::Slot* slot) {
  bytes_ -= BytesOf(*slot->kept);
  if (slot->pinned) {
    --pinned_;
  } else {
    kept_.erase(slot->place);
  }
  slot->kept = nullptr;
}

}  // namespace cairn::map
