// Typed ids: a KeyframeId cannot be passed where a PointId is meant. Ids are dense positive integers given out by the
// map; 0 is "none". They are stable for the life of a map file and never reused.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <ostream>

namespace cairn {

template <class Tag>
class Id {
 public:
  using Value = std::uint32_t;

  constexpr Id() = default;
  constexpr explicit Id(Value value) : value_(value) {}

  constexpr Value value() const { return value_; }
  constexpr bool valid() const { return value_ != 0; }
  constexpr explicit operator bool() const { return valid(); }

  constexpr auto operator<=>(const Id&) const = default;

  friend std::ostream& operator<<(std::ostream& out, Id id) { return out << id.value_; }

 private:
  Value value_ = 0;
};

using KeyframeId = Id<struct KeyframeTag>;
using PointId = Id<struct PointTag>;
using CameraId = Id<struct CameraTag>;
using SessionId = Id<struct SessionTag>;
using ComponentId = Id<struct ComponentTag>;

// The number of a map version: every committed Delta adds one. 0 is the empty map.
using Revision = std::uint64_t;

}  // namespace cairn

template <class Tag>
struct std::hash<cairn::Id<Tag>> {
  std::size_t operator()(cairn::Id<Tag> id) const noexcept {
    // Fibonacci hashing: neighbouring ids land in different buckets.
    return static_cast<std::size_t>(id.value()) * 0x9E3779B97F4A7C15ull;
  }
};
