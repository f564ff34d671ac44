#include "exchange/model_images.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <string>

#include "base/files.h"
#include "io/image_codecs.h"

namespace cairn::exchange {
namespace {

constexpr TimeNs kTolerance_ns = 1'000'000;
constexpr int kPngCompression = 4;

}  // namespace

absl::StatusOr<ModelImages> ModelImages::Create(const map::Snapshot& map, const Reconstruction& model,
                                                const std::string& sequence, const std::string& folder,
                                                bool overwrite) {
  ModelImages images;
  images.cameras_ = std::make_shared<const std::map<CameraId, map::MapCamera>>(map.cameras());
  images.folder_ = folder;
  images.overwrite_ = overwrite;
  for (const ModelImage& image : model.images) {
    const SessionId session = map.keyframe(KeyframeId(image.id)).session;
    if (map.sessions().at(session).source == sequence) images.images_.emplace(image.time_ns, &image);
  }
  if (images.images_.empty()) {
    std::string sources;
    std::set<std::string> names;
    for (const ModelImage& image : model.images) {
      names.insert(map.sessions().at(map.keyframe(KeyframeId(image.id)).session).source);
    }
    for (const std::string& name : names) absl::StrAppend(&sources, sources.empty() ? "" : ", ", "\"", name, "\"");
    return absl::NotFoundError(absl::StrCat("no keyframe that is exported comes from the sequence \"", sequence,
                                            "\"; they come from ", sources,
                                            " (others may be in another component: --component)"));
  }
  std::error_code error;
  if (!folder.empty()) std::filesystem::create_directories(folder, error);
  if (error) return absl::NotFoundError(absl::StrCat(folder, ": ", error.message()));
  return images;
}

absl::StatusOr<const ModelImages::Lens*> ModelImages::LensOf(std::uint32_t camera) {
  if (const auto known = lenses_.find(camera); known != lenses_.end()) return &known->second;
  const map::MapCamera& of_map = cameras_->at(CameraId(camera));
  Lens lens;
  image::UndistortOptions to_pinhole;
  to_pinhole.target = of_map.pinhole;
  CAIRN_ASSIGN_OR_RETURN(image::Undistorter usual, image::Undistorter::Create(of_map.model));
  if (usual.pinhole() == of_map.pinhole) {
    lens.raw = std::move(usual);
  } else {
    CAIRN_ASSIGN_OR_RETURN(lens.raw, image::Undistorter::Create(of_map.model, to_pinhole));
  }
  if (of_map.lens) {
    CAIRN_ASSIGN_OR_RETURN(lens.ideal, image::Undistorter::Create(of_map.lens->CameraOf(of_map.pinhole), to_pinhole));
  }
  return &lenses_.emplace(camera, std::move(lens)).first->second;
}

absl::StatusOr<bool> ModelImages::Add(TimeNs time_ns, const cv::Mat& raw) {
  const auto at = images_.lower_bound(time_ns - kTolerance_ns);
  if (at == images_.end() || at->first > time_ns + kTolerance_ns) return false;
  const ModelImage& image = *at->second;
  CAIRN_ASSIGN_OR_RETURN(const Lens* lens, LensOf(image.camera));
  CAIRN_ASSIGN_OR_RETURN(cv::Mat undistorted, lens->raw->Undistort(raw));
  if (lens->ideal) {
    CAIRN_ASSIGN_OR_RETURN(undistorted, lens->ideal->Undistort(undistorted));
  }
  for (std::size_t i = 0; i < image.keypoints.size(); ++i) {
    if (image.points[i] == 0) continue;
    const int x = static_cast<int>(std::lround(image.keypoints[i].x()));
    const int y = static_cast<int>(std::lround(image.keypoints[i].y()));
    if (x < 0 || y < 0 || x >= undistorted.cols || y >= undistorted.rows) continue;
    Sum& sum = gray_[image.points[i]];
    sum.value += undistorted.at<std::uint8_t>(y, x);
    ++sum.count;
  }
  if (!folder_.empty()) {
    CAIRN_ASSIGN_OR_RETURN(const std::string png, io::EncodePng(undistorted, kPngCompression));
    CAIRN_RETURN_IF_ERROR(WriteFileAtomically(absl::StrCat(folder_, "/", image.name), png, overwrite_));
  }
  ++num_written_;
  return true;
}

std::size_t ModelImages::ColorPoints(Reconstruction* model) const {
  std::size_t colored = 0;
  for (ModelPoint& point : model->points) {
    const auto sum = gray_.find(point.id);
    if (sum == gray_.end()) continue;
    point.red = point.green = point.blue =
        static_cast<std::uint8_t>(std::lround(sum->second.value / sum->second.count));
    ++colored;
  }
  return colored;
}

}  // namespace cairn::exchange
