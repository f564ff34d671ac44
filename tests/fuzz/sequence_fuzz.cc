// The lists and calibrations of image sequences: the first byte says in which format, then its text files follow one
// another with a line "--" between. The images are there.
#include <array>

#include "absl/strings/str_cat.h"
#include "io/frame_source.h"
#include "testing_scratch_folder.h"

using namespace cairn;

namespace {

struct Format {
  io::SequenceFormat format;
  std::array<const char*, 4> files;   // null: no more
  std::array<const char*, 2> images;  // that its lists may name
};
constexpr std::array<Format, 6> kFormats = {{
    {io::SequenceFormat::kEuroc,
     {"mav0/cam0/sensor.yaml", "mav0/cam0/data.csv"},
     {"mav0/cam0/data/1.png", "mav0/cam0/data/2.png"}},
    {io::SequenceFormat::kTumRgbd, {"camera.yaml", "rgb.txt"}, {"rgb/1.png", "rgb/2.png"}},
    {io::SequenceFormat::kTumMono,
     {"camera.txt", "times.txt", "pcalib.txt", "camera.yaml"},
     {"images/00000.png", "images/00001.png"}},
    {io::SequenceFormat::kKitti, {"calib.txt", "times.txt"}, {"image_0/000000.png", "image_0/000001.png"}},
    {io::SequenceFormat::kTimes, {"camera.yaml", "times.txt"}, {"1.png", "2.png"}},
    {io::SequenceFormat::kImages, {"camera.yaml"}, {"images/1.png", "images/2.png"}},
}};

// 8 x 6 pixels, gray.
constexpr absl::string_view kImage = "P5\n8 6\n255\nabcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUV";

struct Folders {
  std::array<ScratchFolder, kFormats.size()> of;
  Folders() {
    for (std::size_t i = 0; i < kFormats.size(); ++i) {
      for (const char* image : kFormats[i].images) of[i].Write(image, kImage);
    }
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Folders folders;
  if (size == 0) return 0;
  const Format& format = kFormats[data[0] % kFormats.size()];
  const ScratchFolder& folder = folders.of[data[0] % kFormats.size()];
  absl::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  for (const char* file : format.files) {
    if (file == nullptr) break;
    const std::size_t end = rest.find("--\n");
    folder.Write(file, rest.substr(0, end));
    rest.remove_prefix(end == absl::string_view::npos ? rest.size() : end + 3);
  }
  io::OpenOptions options;
  options.format = format.format;
  options.prefetch = 0;
  options.mask_path = "none";
  const auto source = io::FrameSource::Open(folder.path(), options);
  if (!source.ok()) return 0;
  if (!(*source)->info().camera.Validate().ok()) std::abort();
  for (int i = 0; i < 3; ++i) {
    const auto frame = (*source)->Next();
    if (!frame.ok() || !frame->has_value()) break;
  }
  return 0;
}
