#include "io/photometric_files.h"

#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "absl/strings/numbers.h"
#include "io/atomic_file.h"
#include "io/text_lines.h"

namespace cairn::io {
namespace {

absl::StatusOr<std::vector<double>> ReadResponse(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(path));
  std::vector<double> values;
  for (const TextLine& line : lines) {
    for (const absl::string_view field : SplitFields(line.text)) {
      double value = 0.0;
      if (!absl::SimpleAtod(field, &value)) {
        return LineError(path, line.number, absl::StrCat("\"", field, "\" is not a number"));
      }
      values.push_back(value);
    }
  }
  if (values.size() != 256) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, " holds ", values.size(), " numbers instead of 256, the inverse response per intensity"));
  }
  return values;
}

absl::StatusOr<cv::Mat> ReadVignette(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::string bytes, ReadWholeFile(path));
  cv::Mat vignette;
  try {
    const std::vector<std::uint8_t> buffer(bytes.begin(), bytes.end());
    if (!buffer.empty()) {
      vignette = cv::imdecode(buffer, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
    }
  } catch (const std::exception&) {
    vignette.release();
  }
  if (vignette.empty()) return absl::DataLossError(absl::StrCat(path, " is not a readable image"));
  return vignette;
}

}  // namespace

absl::StatusOr<image::PhotometricCalibration> LoadPhotometricCalibration(const std::string& response_path,
                                                                         const std::string& vignette_path) {
  std::vector<double> response;
  cv::Mat vignette;
  if (!response_path.empty()) {
    CAIRN_ASSIGN_OR_RETURN(response, ReadResponse(response_path));
    CAIRN_RETURN_IF_ERROR(Annotate(image::PhotometricCalibration::Create(response, {}).status(), response_path));
  }
  if (!vignette_path.empty()) {
    CAIRN_ASSIGN_OR_RETURN(vignette, ReadVignette(vignette_path));
    CAIRN_RETURN_IF_ERROR(Annotate(image::PhotometricCalibration::Create({}, vignette).status(), vignette_path));
  }
  return image::PhotometricCalibration::Create(response, vignette);
}

}  // namespace cairn::io
