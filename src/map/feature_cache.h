// The features of keyframes: by far the largest part of a map, and of a map that is only read only those of few
// keyframes are asked for. They are in memory, or come from where the map is kept when somebody looks at them; those
// that were looked at last are kept, up to a budget.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "image/feature.h"

namespace cairn::map {

// The unchanging part of a keyframe, shared by all its versions.
struct KeyframeFeatures {
  image::Features features;
  std::vector<std::uint32_t> words;  // vocabulary word of each feature; empty if the map has no vocabulary
  bool operator==(const KeyframeFeatures&) const = default;
};

// Reads them from where the map is kept; one call at a time.
class FeatureReader {
 public:
  virtual ~FeatureReader() = default;
  // Without an object if the keyframe has left the map since.
  virtual absl::StatusOr<std::shared_ptr<const KeyframeFeatures>> Read(KeyframeId keyframe) = 0;
};

class FeatureCache;

// The features of one keyframe, in memory or to be read when somebody looks at them.
class FeatureHandle {
 public:
  FeatureHandle() = default;
  FeatureHandle(std::nullptr_t) {}                                                               // NOLINT
  FeatureHandle(std::shared_ptr<const KeyframeFeatures> loaded) : loaded_(std::move(loaded)) {}  // NOLINT
  FeatureHandle(std::shared_ptr<KeyframeFeatures> loaded) : loaded_(std::move(loaded)) {}        // NOLINT

  explicit operator bool() const { return loaded_ != nullptr || slot_ != nullptr; }
  // How many, without a look at them.
  std::size_t size() const;
  bool in_memory() const { return slot_ == nullptr; }
  // For whoever may meet features that are not in memory: held, they stay.
  std::shared_ptr<const KeyframeFeatures> Get() const;

  // For whoever has loaded the map with them. Of others they stay in memory for good from then on.
  const KeyframeFeatures& operator*() const { return loaded_ ? *loaded_ : Pin(); }
  const KeyframeFeatures* operator->() const { return &**this; }

  // The same object, or the same place to read it from; not the same content.
  bool operator==(const FeatureHandle&) const = default;

 private:
  friend class FeatureCache;
  friend class FeatureLook;
  struct Slot;
  const KeyframeFeatures& Pin() const;

  std::shared_ptr<const KeyframeFeatures> loaded_;
  std::shared_ptr<Slot> slot_;  // of those that come when they are needed
};

// Holds what it has looked at: for a task that looks at the same keyframes again and again.
class FeatureLook {
 public:
  const KeyframeFeatures& Of(const FeatureHandle& features) {
    if (features.in_memory()) return *features;
    auto& held = held_[features.slot_.get()];
    if (held == nullptr) held = features.Get();
    return *held;
  }

 private:
  std::unordered_map<const void*, std::shared_ptr<const KeyframeFeatures>> held_;
};

// Of one map that is only read: those of its keyframes that were looked at last. Thread-safe.
class FeatureCache : public std::enable_shared_from_this<FeatureCache> {
 public:
  static std::shared_ptr<FeatureCache> Create(std::unique_ptr<FeatureReader> reader, std::size_t budget_bytes);

  // Those of a keyframe with `count` features, to be read when they are looked at.
  FeatureHandle OnDemand(KeyframeId keyframe, std::size_t count);
  // The same, that were read just now.
  FeatureHandle OnDemand(KeyframeId keyframe, std::shared_ptr<const KeyframeFeatures> loaded);

  // The first error of a look, for good: it got features that are all zero instead. (So does a look at a keyframe that
  // has left the map, and that is no error.)
  absl::Status status() const;

  // Notes such an error of who reads the rest of the same map when it is looked at.
  void Note(const absl::Status& error);

  std::size_t bytes() const;   // that are kept
  std::size_t pinned() const;  // keyframes whose features stay for good

 private:
  friend class FeatureHandle;
  using Pointer = std::shared_ptr<const KeyframeFeatures>;
  using Slots = std::list<FeatureHandle::Slot*>;  // each takes itself out at its end

  FeatureCache(std::unique_ptr<FeatureReader> reader, std::size_t budget_bytes);
  Pointer Get(FeatureHandle::Slot* slot, bool pin);
  // Use while `mutex_` is held.
  Pointer ReadOrStandIn(const FeatureHandle::Slot& slot);
  void Keep(FeatureHandle::Slot* slot, Pointer features);
  void Drop(FeatureHandle::Slot* slot);

  const std::size_t budget_bytes_;
  const std::unique_ptr<FeatureReader> reader_;

  mutable std::mutex mutex_;  // guards what follows, the reader, and what slots keep
  Slots kept_;                // the last one looked at first
  std::size_t bytes_ = 0;
  std::size_t pinned_ = 0;
  absl::Status status_;
};

}  // namespace cairn::map
