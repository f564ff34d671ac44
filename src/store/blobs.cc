#include "store/blobs.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace cairn::store {
namespace {

using image::Keypoint;

template <class T>
void Append(std::string* out, T value) {
  out->append(reinterpret_cast<const char*>(&value), sizeof(value));
}

// The i-th number of an array of T that starts `offset` bytes into a blob.
template <class T>
T At(Bytes bytes, std::size_t offset, std::size_t i) {
  T value;
  std::memcpy(&value, bytes.data() + offset + i * sizeof(T), sizeof(T));
  return value;
}

bool IsFixedPoint(float px) {
  const float scaled = px * kFixedPointPerPx;
  return scaled >= 0.0f && scaled <= 65535.0f && std::trunc(scaled) == scaled && !std::signbit(px);
}

int BytesPerWord(const std::vector<std::uint32_t>& words) {
  if (words.empty()) return 0;
  const std::uint32_t largest = *std::max_element(words.begin(), words.end());
  return largest < (1u << 8) ? 1 : largest < (1u << 16) ? 2 : largest < (1u << 24) ? 3 : 4;
}

std::size_t BytesPerKeypoint(KeypointLayout layout) { return layout == KeypointLayout::kFixedPoint ? 9 : 13; }

void AppendVarint(std::string* out, std::uint64_t value) {
  while (value >= 0x80) {
    out->push_back(static_cast<char>(value | 0x80));
    value >>= 7;
  }
  out->push_back(static_cast<char>(value));
}

// False if the bytes end within the number or it has more than 63 bits.
bool ReadVarint(Bytes bytes, std::size_t* at, std::uint64_t* value) {
  *value = 0;
  for (int shift = 0; shift < 63; shift += 7) {
    if (*at >= bytes.size()) return false;
    const std::uint8_t byte = bytes[(*at)++];
    *value |= static_cast<std::uint64_t>(byte & 0x7f) << shift;
    if ((byte & 0x80) == 0) return true;
  }
  return false;
}

}  // namespace

PackedFeatures PackFeatures(const map::KeyframeFeatures& features) {
  const std::vector<Keypoint>& keypoints = features.features.keypoints;
  PackedFeatures packed;
  packed.count = static_cast<int>(keypoints.size());
  const bool fixed_point = std::all_of(keypoints.begin(), keypoints.end(), [](const Keypoint& keypoint) {
    return IsFixedPoint(keypoint.x_px) && IsFixedPoint(keypoint.y_px);
  });
  packed.layout = fixed_point ? KeypointLayout::kFixedPoint : KeypointLayout::kFloat32;
  packed.keypoints.reserve(keypoints.size() * BytesPerKeypoint(packed.layout));
  const auto append_px = [&packed, fixed_point](float px) {
    if (fixed_point) {
      Append(&packed.keypoints, static_cast<std::uint16_t>(px * kFixedPointPerPx));
    } else {
      Append(&packed.keypoints, px);
    }
  };
  for (const Keypoint& keypoint : keypoints) append_px(keypoint.x_px);
  for (const Keypoint& keypoint : keypoints) append_px(keypoint.y_px);
  for (const Keypoint& keypoint : keypoints) Append(&packed.keypoints, keypoint.angle_rad);
  for (const Keypoint& keypoint : keypoints) Append(&packed.keypoints, keypoint.octave);

  const auto& descriptors = features.features.descriptors;
  packed.descriptors.assign(reinterpret_cast<const char*>(descriptors.data()),
                            descriptors.size() * sizeof(image::Descriptor));

  packed.word_bytes = BytesPerWord(features.words);
  packed.words.reserve(features.words.size() * static_cast<std::size_t>(packed.word_bytes));
  for (const std::uint32_t word : features.words) {
    packed.words.append(reinterpret_cast<const char*>(&word), static_cast<std::size_t>(packed.word_bytes));
  }
  return packed;
}

absl::StatusOr<FeatureBlobs> FeatureBlobs::Create(std::int64_t count, std::int64_t layout, std::int64_t word_bytes,
                                                  Bytes keypoints, Bytes descriptors, Bytes words) {
  FeatureBlobs blobs;
  blobs.layout_ = static_cast<KeypointLayout>(layout);
  if (blobs.layout_ != KeypointLayout::kFloat32 && blobs.layout_ != KeypointLayout::kFixedPoint) {
    return absl::DataLossError(absl::StrCat("keypoint layout ", layout, " is unknown"));
  }
  const std::size_t n = descriptors.size() / sizeof(image::Descriptor);
  if (count < 0 || n != static_cast<std::uint64_t>(count) || descriptors.size() % sizeof(image::Descriptor) != 0 ||
      keypoints.size() != n * BytesPerKeypoint(blobs.layout_)) {
    return absl::DataLossError(absl::StrCat("the blobs do not hold ", count, " keypoints and descriptors"));
  }
  if (word_bytes < 0 || word_bytes > 4 || words.size() != n * static_cast<std::uint64_t>(word_bytes)) {
    return absl::DataLossError(absl::StrCat("the blob of words does not hold ", count, " of ", word_bytes, " bytes"));
  }
  blobs.size_ = n;
  blobs.word_bytes_ = static_cast<std::size_t>(word_bytes);
  blobs.keypoints_ = keypoints;
  blobs.octaves_ = keypoints.last(n);
  blobs.descriptors_ = descriptors;
  blobs.words_ = words;
  return blobs;
}

Keypoint FeatureBlobs::keypoint(std::size_t i) const {
  const bool fixed_point = layout_ == KeypointLayout::kFixedPoint;
  const std::size_t px_bytes = fixed_point ? 2 : 4;
  const auto px_at = [&](std::size_t offset) {
    return fixed_point ? static_cast<float>(At<std::uint16_t>(keypoints_, offset, i)) / kFixedPointPerPx
                       : At<float>(keypoints_, offset, i);
  };
  Keypoint keypoint;
  keypoint.x_px = px_at(0);
  keypoint.y_px = px_at(px_bytes * size_);
  keypoint.angle_rad = At<float>(keypoints_, 2 * px_bytes * size_, i);
  keypoint.octave = octave(i);
  return keypoint;
}

image::Descriptor FeatureBlobs::descriptor(std::size_t i) const { return At<image::Descriptor>(descriptors_, 0, i); }

std::vector<std::uint32_t> FeatureBlobs::Words() const {
  std::vector<std::uint32_t> words;
  if (word_bytes_ == 0) return words;
  words.assign(size_, 0);
  // Whole numbers as long as there are bytes for them: copies of a known size are many times faster.
  const std::uint32_t mask = 0xffffffffu >> (8 * (sizeof(std::uint32_t) - word_bytes_));
  std::size_t i = 0;
  for (; i * word_bytes_ + sizeof(std::uint32_t) <= words_.size(); ++i) {
    std::memcpy(&words[i], words_.data() + i * word_bytes_, sizeof(std::uint32_t));
    words[i] &= mask;
  }
  for (; i < size_; ++i) std::memcpy(&words[i], words_.data() + i * word_bytes_, word_bytes_);
  return words;
}

map::KeyframeFeatures FeatureBlobs::Unpack() const {
  map::KeyframeFeatures features;
  features.features.keypoints.reserve(size_);
  for (std::size_t i = 0; i < size_; ++i) features.features.keypoints.push_back(keypoint(i));
  features.features.descriptors.resize(size_);
  if (size_ > 0) std::memcpy(features.features.descriptors.data(), descriptors_.data(), descriptors_.size());
  features.words = Words();
  return features;
}

absl::StatusOr<map::KeyframeFeatures> UnpackFeatures(std::int64_t count, std::int64_t layout, std::int64_t word_bytes,
                                                     Bytes keypoints, Bytes descriptors, Bytes words) {
  CAIRN_ASSIGN_OR_RETURN(const auto blobs,
                         FeatureBlobs::Create(count, layout, word_bytes, keypoints, descriptors, words));
  return blobs.Unpack();
}

namespace {

template <class KeypointAt>
absl::string_view WrongAmong(std::size_t count, KeypointAt at, const Pinhole* camera, int num_levels) {
  // A lens that is corrected moves keypoints beyond the edge of the image, by far less than the image.
  const float unknown = std::numeric_limits<float>::max() / 4;
  const auto width = camera == nullptr ? unknown : static_cast<float>(camera->width_px);
  const auto height = camera == nullptr ? unknown : static_cast<float>(camera->height_px);
  const auto within = [](float px, float size) { return px >= -size && px <= 2.0f * size; };
  for (std::size_t i = 0; i < count; ++i) {
    const Keypoint keypoint = at(i);
    if (keypoint.octave >= num_levels) return "keypoints: an octave is out of range";
    if (!within(keypoint.x_px, width) || !within(keypoint.y_px, height))
      return "keypoints: one is outside of the image";
    if (!(std::abs(keypoint.angle_rad) <= 7.0f)) return "keypoints: an angle is out of range";
  }
  return {};
}

}  // namespace

absl::string_view WrongKeypoints(const FeatureBlobs& features, const Pinhole* camera, int num_levels) {
  return WrongAmong(
      features.size(), [&](std::size_t i) { return features.keypoint(i); }, camera, num_levels);
}

absl::string_view WrongKeypoints(const std::vector<Keypoint>& keypoints, const Pinhole* camera, int num_levels) {
  return WrongAmong(
      keypoints.size(), [&](std::size_t i) { return keypoints[i]; }, camera, num_levels);
}

absl::string_view WrongWords(const std::vector<std::uint32_t>& words, std::uint32_t num_words) {
  for (const std::uint32_t word : words) {
    if (word >= num_words) return "words: the vocabulary has none of that number";
  }
  return {};
}

std::string PackPointIds(const std::vector<PointId>& ids) {
  std::string out;
  out.reserve(2 * ids.size());
  std::int64_t last = 0;
  for (const PointId id : ids) {
    if (!id) {
      out.push_back('\0');
      continue;
    }
    const std::int64_t step = static_cast<std::int64_t>(id.value()) - last;
    const auto zigzag = static_cast<std::uint64_t>(step >= 0 ? 2 * step : -2 * step - 1);
    AppendVarint(&out, zigzag + 1);
    last = id.value();
  }
  return out;
}

absl::StatusOr<std::vector<PointId>> UnpackPointIds(std::size_t count, Bytes bytes) {
  if (bytes.size() < count) return absl::DataLossError(absl::StrCat("the blob is too short for ", count, " features"));
  std::vector<PointId> ids(count);
  std::size_t at = 0;
  std::int64_t last = 0;
  for (std::size_t i = 0; i < count; ++i) {
    // Most features observe no point: eight at a time.
    std::uint64_t eight = 0;
    while (i + sizeof(eight) <= count && at + sizeof(eight) <= bytes.size()) {
      std::memcpy(&eight, bytes.data() + at, sizeof(eight));
      const auto zeros = static_cast<std::size_t>(std::countr_zero(eight)) / 8;
      i += zeros, at += zeros;
      if (zeros < sizeof(eight)) break;
    }
    if (i == count) break;
    std::uint64_t value = 0;
    if (!ReadVarint(bytes, &at, &value)) return absl::DataLossError("a number in the blob is cut off");
    if (value == 0) continue;
    const std::uint64_t zigzag = value - 1;
    if (zigzag > (std::uint64_t{1} << 34)) return absl::DataLossError("a number in the blob is too large");
    const auto half = static_cast<std::int64_t>(zigzag >> 1);
    last += (zigzag & 1) != 0 ? -half - 1 : half;
    if (last < 1 || last > 0xffffffffll) return absl::DataLossError("an id in the blob is out of range");
    ids[i] = PointId(static_cast<PointId::Value>(last));
  }
  if (at != bytes.size()) return absl::DataLossError(absl::StrCat("the blob holds more than ", count, " features"));
  return ids;
}

std::size_t NumPackedPointIds(Bytes bytes) {
  return static_cast<std::size_t>(std::ranges::count_if(bytes, [](std::uint8_t byte) { return (byte & 0x80) == 0; }));
}

std::string PackIdRuns(const std::vector<std::uint32_t>& ids) {
  std::string out;
  std::uint32_t end = 0;
  for (std::size_t i = 0; i < ids.size();) {
    std::size_t run = 1;
    while (i + run < ids.size() && ids[i + run] == ids[i] + run) ++run;
    AppendVarint(&out, ids[i] - end);
    AppendVarint(&out, run);
    i += run;
    end = ids[i - 1] + 1;
  }
  return out;
}

absl::Status UnpackIdRuns(Bytes bytes, std::uint32_t next, std::vector<std::uint32_t>* ids) {
  // More than any map has; a blob of a few bytes must not fill the memory.
  constexpr std::uint64_t kMaxIds = 100000000;
  std::size_t at = 0;
  std::uint64_t end = 0, count = 0;
  while (at < bytes.size()) {
    std::uint64_t gap = 0, run = 0;
    if (!ReadVarint(bytes, &at, &gap) || !ReadVarint(bytes, &at, &run)) {
      return absl::DataLossError("a number in the blob is cut off");
    }
    if (gap > next || run > next || end + gap + run > next || run == 0 || end + gap == 0 || count + run > kMaxIds) {
      return absl::DataLossError("an id in the blob is out of range");
    }
    for (std::uint64_t i = 0; i < run; ++i) ids->push_back(static_cast<std::uint32_t>(end + gap + i));
    end += gap + run;
    count += run;
  }
  return absl::OkStatus();
}

std::string PackDoubles(const std::vector<double>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double));
}

absl::StatusOr<std::vector<double>> UnpackDoubles(Bytes bytes) {
  if (bytes.size() % sizeof(double) != 0) return absl::DataLossError("the blob does not hold whole numbers");
  std::vector<double> values(bytes.size() / sizeof(double));
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

}  // namespace cairn::store
