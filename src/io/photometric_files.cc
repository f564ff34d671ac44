#include "io/photometric_files.h"

#include <cmath>
#include <filesystem>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "io/atomic_file.h"
#include "io/image_codecs.h"
#include "io/text_lines.h"
#include "io/time_text.h"

namespace cairn::io {
namespace {

namespace fs = std::filesystem;

constexpr char kResponseName[] = "pcalib.txt", kVignetteName[] = "vignette.png", kTimesName[] = "times.txt";

bool Exists(const fs::path& path) {
  std::error_code error;
  return fs::exists(path, error);
}

absl::StatusOr<Exposures> ReadExposures(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(path));
  Exposures exposures;
  TimeOrder order;
  for (const TextLine& line : lines) {
    const std::vector<absl::string_view> fields = SplitFields(line.text);
    if (fields.size() < 3) return LineError(path, line.number, "expected `id seconds exposure_ms`");
    CAIRN_RETURN_IF_ERROR(CheckNoMoreFields(path, line, fields.size(), 3, "id seconds exposure_ms"));
    const absl::StatusOr<TimeNs> time_ns = ParseSeconds(fields[1]);
    if (!time_ns.ok()) return LineError(path, line.number, time_ns.status().message());
    CAIRN_RETURN_IF_ERROR(order.Add(*time_ns, path, line.number));
    double exposure_ms = 0.0;
    if (!absl::SimpleAtod(fields[2], &exposure_ms) || !(exposure_ms >= 0.0 && exposure_ms < 1e6)) {
      return LineError(path, line.number, absl::StrCat("\"", fields[2], "\" is not an exposure time in milliseconds"));
    }
    exposures.emplace_back(*time_ns, exposure_ms * 1e-3);
  }
  return exposures;
}

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
  absl::StatusOr<cv::Mat> vignette = DecodeGray(bytes);
  if (!vignette.ok()) return absl::DataLossError(absl::StrCat(path, " ", vignette.status().message()));
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

std::vector<std::string> PhotometricFileNames() { return {kResponseName, kVignetteName, kTimesName}; }

absl::StatusOr<PhotometricFolder> LoadPhotometricFolder(const std::string& folder) {
  const fs::path root(folder);
  const bool response = Exists(root / kResponseName), vignette = Exists(root / kVignetteName);
  if (!response && !vignette) {
    return absl::NotFoundError(
        absl::StrCat(folder, " holds no photometric calibration: neither ", kResponseName, " nor ", kVignetteName));
  }
  PhotometricFolder out;
  CAIRN_ASSIGN_OR_RETURN(out.calibration, LoadPhotometricCalibration(response ? (root / kResponseName).string() : "",
                                                                     vignette ? (root / kVignetteName).string() : ""));
  if (Exists(root / kTimesName)) {
    CAIRN_ASSIGN_OR_RETURN(Exposures exposures, ReadExposures((root / kTimesName).string()));
    out.exposures = std::move(exposures);
  }
  return out;
}

absl::Status SavePhotometricFolder(const std::string& folder, const std::array<double, 256>& inverse_response,
                                   const cv::Mat& vignette, const Exposures& exposures, bool overwrite) {
  const fs::path root(folder);
  for (const std::string& name : PhotometricFileNames()) {
    if (overwrite || !Exists(root / name)) continue;
    return absl::AlreadyExistsError(absl::StrCat((root / name).string(), " exists already"));
  }
  std::string response, times = "# id seconds exposure_ms, of an arbitrary unit\n";
  for (const double value : inverse_response) absl::StrAppendFormat(&response, "%.9g ", value);
  response.back() = '\n';
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    absl::StrAppendFormat(&times, "%05d %s %.6g\n", i, FormatSeconds(exposures[i].first), 1e3 * exposures[i].second);
  }
  cv::Mat levels;
  vignette.convertTo(levels, CV_16UC1, 65535.0);
  CAIRN_ASSIGN_OR_RETURN(const std::string png, EncodePng(levels, 6));
  CAIRN_RETURN_IF_ERROR(WriteFileAtomically((root / kResponseName).string(), response, true));
  CAIRN_RETURN_IF_ERROR(WriteFileAtomically((root / kVignetteName).string(), png, true));
  if (!exposures.empty()) return WriteFileAtomically((root / kTimesName).string(), times, true);
  std::error_code error;
  fs::remove(root / kTimesName, error);
  return absl::OkStatus();
}

}  // namespace cairn::io
