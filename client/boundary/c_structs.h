// The versioned structs of cairn.h. The caller's may be shorter than ours, from a version before, or longer, from a
// later one; both begin with the same members.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "cairn.h"
#include "cairn/answers.h"
#include "cairn/call_options.h"
#include "cairn/camera.h"
#include "cairn/image_view.h"
#include "cairn/map.h"

namespace cairn::client {

// Bytes of each struct in the first version: what every caller has. They never change, and hold no padding that a
// member of a later version could fall into.
template <class Struct>
inline constexpr std::size_t kFirstSize = 0;
template <>
inline constexpr std::size_t kFirstSize<cairn_error> = 1024;
template <>
inline constexpr std::size_t kFirstSize<cairn_call_options> = 24;
template <>
inline constexpr std::size_t kFirstSize<cairn_map_options> = 16;
template <>
inline constexpr std::size_t kFirstSize<cairn_map_info> = 344;
template <>
inline constexpr std::size_t kFirstSize<cairn_camera> = 120;
template <>
inline constexpr std::size_t kFirstSize<cairn_image> = 40;
template <>
inline constexpr std::size_t kFirstSize<cairn_component> = 88;
template <>
inline constexpr std::size_t kFirstSize<cairn_localize_query> = 40;
template <>
inline constexpr std::size_t kFirstSize<cairn_prior> = 88;
template <>
inline constexpr std::size_t kFirstSize<cairn_localize_answer> = 1400;
template <>
inline constexpr std::size_t kFirstSize<cairn_tracker_options> = 24;
template <>
inline constexpr std::size_t kFirstSize<cairn_track_answer> = 1032;

// As much of `from` as we know. `name` is for messages. InvalidArgument if it is null, shorter than a struct of the
// first version (kFirstSize), or asks in members of a later version for what we cannot do.
template <class Struct>
absl::StatusOr<Struct> ReadStruct(const Struct* from, absl::string_view name) {
  if (from == nullptr) return absl::InvalidArgumentError(absl::StrCat(name, " must not be NULL"));
  std::size_t size = 0;
  std::memcpy(&size, from, sizeof(size));
  if (size < kFirstSize<Struct>) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": struct_size is ", size, ", at least ", kFirstSize<Struct>,
                                                   " is needed: set it to sizeof"));
  }
  const auto* bytes = reinterpret_cast<const unsigned char*>(from);
  if (size > sizeof(Struct) && std::any_of(bytes + sizeof(Struct), bytes + size, [](auto byte) { return byte != 0; })) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": uses members that this version of the library (", CAIRN_VERSION, ") does not know"));
  }
  Struct result{};
  std::memcpy(&result, from, std::min(size, sizeof(Struct)));
  return result;
}

// InvalidArgument as above. Asked before the work is done, so that it is not done for nothing.
template <class Struct>
absl::Status CheckOutput(const Struct* to, absl::string_view name) {
  if (to == nullptr) return absl::InvalidArgumentError(absl::StrCat(name, " must not be NULL"));
  if (to->struct_size >= kFirstSize<Struct>) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(name, ": struct_size is ", to->struct_size, ", at least ",
                                                 kFirstSize<Struct>, " is needed: set it to sizeof"));
}

// As much of `from` as `to` has room for, and zeros after it. struct_size stays the caller's.
template <class Struct>
void WriteStruct(const Struct& from, Struct* to) {
  const std::size_t size = to->struct_size;
  auto* bytes = reinterpret_cast<unsigned char*>(to);
  const std::size_t known = std::min(size, sizeof(Struct));
  constexpr std::size_t kFirst = sizeof(size);
  std::memcpy(bytes + kFirst, reinterpret_cast<const unsigned char*>(&from) + kFirst, known - kFirst);
  std::memset(bytes + known, 0, size - known);
}

// Cut where it does not fit, not within a character.
void WriteString(absl::string_view from, char* to, std::size_t size);

absl::StatusOr<v0::CallOptions> ReadCall(const cairn_call_options* call);
absl::StatusOr<v0::MapOptions> ReadMapOptions(const cairn_map_options* options);
absl::StatusOr<v0::TrackerOptions> ReadTrackerOptions(const cairn_tracker_options* options);
absl::StatusOr<v0::Camera> ReadCamera(const cairn_camera* camera);
absl::StatusOr<v0::ImageView> ReadImage(const cairn_image* image);
absl::StatusOr<v0::LocalizeQuery> ReadQuery(const cairn_localize_query* query);

cairn_camera ToC(const v0::Camera& camera);
cairn_component ToC(const v0::MapComponent& component);
cairn_map_info ToC(const v0::MapInfo& info);
cairn_localize_answer ToC(const v0::LocalizeAnswer& answer);
cairn_track_answer ToC(const v0::TrackAnswer& answer);

}  // namespace cairn::client
