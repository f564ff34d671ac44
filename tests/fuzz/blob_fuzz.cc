// The packed blobs of keyframes in a map file: the first byte says which, then come its numbers, two bytes each.
#include "store/blobs.h"

using namespace cairn;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 7) return 0;
  const auto number = [&](std::size_t at) { return static_cast<std::int64_t>(data[at] + 256 * data[at + 1]); };
  const std::int64_t first = number(1), second = number(3), third = number(5);
  const store::Bytes bytes(data + 7, size - 7);
  switch (data[0] % 4) {
    case 0: {
      // The keypoints, the descriptors and the words stand one behind the other.
      const std::size_t keypoints = std::min<std::size_t>(bytes.size(), static_cast<std::size_t>(second));
      const std::size_t descriptors = std::min<std::size_t>(bytes.size() - keypoints, static_cast<std::size_t>(third));
      const auto features =
          store::FeatureBlobs::Create(first, data[0] / 4 % 4, data[0] / 16, bytes.subspan(0, keypoints),
                                      bytes.subspan(keypoints, descriptors), bytes.subspan(keypoints + descriptors));
      const Pinhole camera{640, 480, 300.0, 300.0, 320.0, 240.0};
      if (!features.ok()) break;
      (void)store::WrongKeypoints(*features, &camera, 8);
      (void)store::WrongWords(features->Words(), 1000);
      const map::KeyframeFeatures unpacked = features->Unpack();
      (void)store::WrongKeypoints(unpacked.features.keypoints, &camera, 8);
      break;
    }
    case 1:
      (void)store::UnpackPointIds(static_cast<std::size_t>(first), bytes);
      break;
    case 2: {
      std::vector<std::uint32_t> ids;
      (void)store::UnpackIdRuns(bytes, static_cast<std::uint32_t>(first), &ids);
      break;
    }
    default:
      (void)store::UnpackDoubles(bytes);
  }
  return 0;
}
