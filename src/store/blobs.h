// The packed blobs of a keyframe (docs/map-format.md, "Blobs"): features, which never change, and the points they
// observe. All numbers little-endian. Every encoding is lossless to the bit. Decoding checks everything it reads.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/ids.h"
#include "base/status.h"
#include "image/feature.h"
#include "map/entities.h"
#include "store/sqlite.h"

namespace cairn::store {

// How positions of keypoints are written.
enum class KeypointLayout : int {
  kFloat32 = 0,  // as they are
  kFixedPoint =
      1,  // 16-bit multiples of 1/32 px: used if, and only if, that is exact for every keypoint of the keyframe
};
inline constexpr float kFixedPointPerPx = 32.0f;

struct PackedFeatures {
  int count = 0;
  KeypointLayout layout = KeypointLayout::kFloat32;
  int word_bytes = 0;  // 1 to 4 per word; 0: there are none
  std::string keypoints;
  std::string descriptors;
  std::string words;
};

PackedFeatures PackFeatures(const map::KeyframeFeatures& features);

// The features of a keyframe as blobs hold them, to look at some of them without unpacking all.
class FeatureBlobs {
 public:
  // DataLoss (without a fault: the caller knows which row) if lengths and values do not fit. Refers to the blobs.
  static absl::StatusOr<FeatureBlobs> Create(std::int64_t count, std::int64_t layout, std::int64_t word_bytes,
                                             Bytes keypoints, Bytes descriptors, Bytes words);

  std::size_t size() const { return size_; }
  image::Keypoint keypoint(std::size_t i) const;
  std::uint8_t octave(std::size_t i) const { return octaves_[i]; }
  image::Descriptor descriptor(std::size_t i) const;
  std::vector<std::uint32_t> Words() const;
  map::KeyframeFeatures Unpack() const;

 private:
  FeatureBlobs() = default;

  std::size_t size_ = 0;
  KeypointLayout layout_ = KeypointLayout::kFloat32;
  std::size_t word_bytes_ = 0;
  Bytes keypoints_, octaves_, descriptors_, words_;  // octaves are a part of keypoints
};

// FeatureBlobs::Create() and Unpack().
absl::StatusOr<map::KeyframeFeatures> UnpackFeatures(std::int64_t count, std::int64_t layout, std::int64_t word_bytes,
                                                     Bytes keypoints, Bytes descriptors, Bytes words);

// What is wrong with values that are read by number or cast to one later; empty if nothing. `camera`: of the
// undistorted image, null if that is not known.
absl::string_view WrongKeypoints(const FeatureBlobs& features, const Pinhole* camera, int num_levels);
absl::string_view WrongKeypoints(const std::vector<image::Keypoint>& keypoints, const Pinhole* camera, int num_levels);
absl::string_view WrongWords(const std::vector<std::uint32_t>& words, std::uint32_t num_words);

// Per feature one varint: 0 for none, else 1 + zigzag(id - id of the last feature that had one).
std::string PackPointIds(const std::vector<PointId>& ids);
absl::StatusOr<std::vector<PointId>> UnpackPointIds(std::size_t count, Bytes bytes);
// For how many features there are entries.
std::size_t NumPackedPointIds(Bytes bytes);

// Ids in ascending order as runs: per run two varints, how far it begins behind the end of the last one (behind 0 for
// the first), and how many ids it has.
std::string PackIdRuns(const std::vector<std::uint32_t>& ids);
// Appends the ids; DataLoss for what is not ascending, or not below `next`.
absl::Status UnpackIdRuns(Bytes bytes, std::uint32_t next, std::vector<std::uint32_t>* ids);

// Doubles one after another.
std::string PackDoubles(const std::vector<double>& values);
absl::StatusOr<std::vector<double>> UnpackDoubles(Bytes bytes);

}  // namespace cairn::store
