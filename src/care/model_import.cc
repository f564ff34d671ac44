#include "care/model_import.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

#include "base/guarded.h"
#include "base/median.h"
#include "engine/posed_session.h"
#include "image/undistort.h"
#include "map/camera_identity.h"
#include "map/edit.h"

namespace cairn::care {
namespace {

constexpr TimeNs kBetweenImages_ns = 1'000'000'000;

// With n observations of standard deviation s each, and what else they share left aside, an image is turned by s / (f
// sqrt(n)) at most, and moved by that share of the depth: the square roots of the diagonal of the information that they
// give (Triggs et al., "Bundle adjustment - a modern synthesis", 2000, sec. 9).
mapping::PosedMapperOptions HeldAsTheModelSays(const exchange::Reconstruction& model,
                                               mapping::PosedMapperOptions options) {
  const exchange::ModelErrors errors = exchange::MeasureErrors(model);
  if (options.position_sigma_share == 0.0 || errors.observations == 0) return options;
  std::vector<double> focals_px, counts;
  for (const exchange::ModelImage& image : model.images) {
    const auto camera = model.cameras.find(image.camera);
    if (camera != model.cameras.end()) focals_px.push_back(camera->second.fx_px);
    counts.push_back(
        static_cast<double>(std::ranges::count_if(image.points, [](std::uint32_t point) { return point != 0; })));
  }
  const double per_image = Median(counts);
  if (focals_px.empty() || per_image < 1.0) return options;
  constexpr double kExactest = 1e-5;  // of a model without noise: there is some in every image
  const double sigma_rad = std::max(errors.rms_px / (Median(focals_px) * std::sqrt(per_image)), kExactest);
  options.position_sigma_share = std::min(options.position_sigma_share, sigma_rad);
  options.rotation_sigma_deg = std::min(options.rotation_sigma_deg, sigma_rad * 180.0 / std::numbers::pi);
  return options;
}

// The same calibration under several ids is one.
struct Calibration {
  Camera camera;
  std::int64_t images = 0;
  std::optional<image::Undistorter> to_common;  // where there are several
};

class Import {
 public:
  Import(const exchange::Reconstruction& model, const ModelImportOptions& options) : model_(model), options_(options) {
    for (const exchange::ModelImage& image : model.images) images_.push_back(&image);
    std::ranges::stable_sort(images_, {}, &exchange::ModelImage::name);
  }

  absl::Status Begin(engine::LiveMap* live) {
    if (images_.empty()) return absl::FailedPreconditionError("the model has no images");
    for (const exchange::ModelImage* image : images_) {
      const auto camera = model_.cameras.find(image->camera);
      if (camera == model_.cameras.end()) {
        return absl::InvalidArgumentError(absl::StrCat("image ", image->name, " has no camera in the model"));
      }
      ++CalibrationOf(camera->second).images;
    }
    const auto main = std::ranges::max_element(calibrations_, {}, &Calibration::images);
    engine::SessionSource source;
    source.name = options_.source;
    source.camera = main->camera;
    if (calibrations_.size() > 1) CAIRN_RETURN_IF_ERROR(BringTogether(*main, &source.camera));
    import_.cameras = static_cast<int>(calibrations_.size());
    CAIRN_ASSIGN_OR_RETURN(
        session_, engine::PosedSession::Create(HeldAsTheModelSays(model_, options_.mapper), false, source, live));
    return absl::OkStatus();
  }

  absl::Status AddAll(const std::function<absl::StatusOr<cv::Mat>(const std::string&)>& read,
                      const std::function<bool(int, int)>& progress) {
    for (std::size_t i = 0; i < images_.size(); ++i) {
      const absl::Status added = Guarded([&] { return Add(i, read); });
      if (added.ok()) {
        ++import_.images;
      } else {
        import_.skipped.push_back(absl::StrCat(images_[i]->name, ": ", added.message()));
      }
      if (progress && !progress(static_cast<int>(i + 1), static_cast<int>(images_.size()))) {
        return absl::CancelledError("interrupted");
      }
    }
    if (import_.images > 0) return absl::OkStatus();
    return absl::FailedPreconditionError(
        absl::StrCat("none of the model's ", images_.size(), " images can be used: ", import_.skipped.front()));
  }

  absl::StatusOr<ModelImport> Finish() {
    CAIRN_ASSIGN_OR_RETURN(import_.report, session_->Finish());
    return std::move(import_);
  }

 private:
  Calibration& CalibrationOf(const Camera& camera) {
    const auto same = std::ranges::find_if(
        calibrations_, [&](const Calibration& known) { return map::SameCalibration(known.camera, camera); });
    return same != calibrations_.end() ? *same : calibrations_.emplace_back(Calibration{camera, 0, {}});
  }

  absl::Status BringTogether(const Calibration& main, Camera* common) {
    CAIRN_ASSIGN_OR_RETURN(const image::Undistorter of_main, image::Undistorter::Create(main.camera));
    *common = Camera::FromPinhole(of_main.pinhole());
    for (Calibration& calibration : calibrations_) {
      image::UndistortOptions options;
      options.target = of_main.pinhole();
      CAIRN_ASSIGN_OR_RETURN(calibration.to_common, image::Undistorter::Create(calibration.camera, options));
    }
    return absl::OkStatus();
  }

  absl::Status Add(std::size_t index, const std::function<absl::StatusOr<cv::Mat>(const std::string&)>& read) {
    const exchange::ModelImage& image = *images_[index];
    const Calibration& calibration = CalibrationOf(model_.cameras.at(image.camera));
    engine::RawFrame frame;
    frame.index = static_cast<std::int64_t>(index);
    frame.time_ns = frame.index * kBetweenImages_ns;
    CAIRN_ASSIGN_OR_RETURN(frame.gray, read(image.name));
    if (calibration.to_common) {
      CAIRN_ASSIGN_OR_RETURN(frame.gray, calibration.to_common->Undistort(frame.gray));
    }
    return session_->AddFrame(frame, image.camera_from_world.Inverse());
  }

  const exchange::Reconstruction& model_;
  const ModelImportOptions& options_;
  std::vector<const exchange::ModelImage*> images_;
  std::vector<Calibration> calibrations_;
  std::unique_ptr<engine::PosedSession> session_;
  ModelImport import_;
};

// The mapper puts what it makes into the world; whether a unit is the metre only the user knows.
absl::Status LeaveUnaligned(engine::LiveMap* live) {
  const auto unaligned = [](const map::Snapshot& head) -> absl::StatusOr<std::optional<map::Delta>> {
    map::Delta delta;
    delta.base = head.revision();
    delta.reason = "the unit of the model is not known";
    for (const auto& [id, component] : head.components()) {
      delta.components.push_back(component);
      delta.components.back().world_from_component.reset();
    }
    delta.next_keyframe = head.next_keyframe();
    delta.next_point = head.next_point();
    delta.next_camera = head.next_camera();
    delta.next_session = head.next_session();
    delta.next_component = head.next_component();
    return delta;
  };
  return live->Edit(unaligned).status();
}

}  // namespace

absl::StatusOr<ModelImport> ImportModel(const exchange::Reconstruction& model, const ModelImportOptions& options,
                                        const std::function<absl::StatusOr<cv::Mat>(const std::string&)>& read,
                                        engine::LiveMap* live, const std::function<bool(int, int)>& progress) {
  Import import(model, options);
  CAIRN_RETURN_IF_ERROR(import.Begin(live));
  CAIRN_RETURN_IF_ERROR(import.AddAll(read, progress));
  CAIRN_ASSIGN_OR_RETURN(ModelImport imported, import.Finish());
  if (!options.metric) CAIRN_RETURN_IF_ERROR(LeaveUnaligned(live));
  return imported;
}

}  // namespace cairn::care
