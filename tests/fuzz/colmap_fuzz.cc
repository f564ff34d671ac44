// Sparse models of COLMAP's. The first byte says whether as text; then cameras, images and points follow one another,
// with a line "--" between, or in binary
// files each behind its length in two bytes.
#include <filesystem>

#include "absl/strings/str_split.h"
#include "exchange/colmap.h"
#include "testing_scratch_folder.h"

using namespace cairn;

namespace {

constexpr const char* kFiles[] = {"cameras", "images", "points3D"};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder text_folder, binary_folder;
  if (size == 0) return 0;
  const bool text = data[0] % 2 == 1;
  const ScratchFolder& folder = text ? text_folder : binary_folder;
  absl::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  for (const char* name : kFiles) {
    absl::string_view file = rest;
    if (text) {
      const std::size_t end = rest.find("--\n");
      file = rest.substr(0, end);
      rest.remove_prefix(end == absl::string_view::npos ? rest.size() : end + 3);
    } else if (rest.size() >= 2) {
      const std::size_t length = static_cast<unsigned char>(rest[0]) + 256 * static_cast<unsigned char>(rest[1]);
      file = rest.substr(2, length);
      rest.remove_prefix(2 + file.size());
    }
    folder.Write(std::string(name) + (text ? ".txt" : ".bin"), file);
  }
  const auto model = exchange::ReadColmap(folder.path());
  if (!model.ok()) return 0;
  for (const exchange::ModelImage& image : model->images) {
    if (!model->cameras.contains(image.camera) || image.points.size() != image.keypoints.size()) std::abort();
  }
  return 0;
}
