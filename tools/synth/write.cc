#include "synth/write.h"

#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <numbers>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "base/guarded.h"
#include "io/atomic_file.h"
#include "io/image_codecs.h"
#include "io/trajectory.h"
#include "synth/overlap.h"

namespace cairn::synth {
namespace {

namespace fs = std::filesystem;

// The body of the EuRoC vehicle has its own frame, x forward and z up, a hand's breadth behind the camera.
SE3 BodyFromCamera() {
  Matrix3d rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return SE3(rotation, Vector3d(0.05, 0.02, -0.01));
}

absl::Status WritePng(const std::string& path, const cv::Mat& image) {
  CAIRN_ASSIGN_OR_RETURN(const std::string png, io::EncodePng(image, 1));
  std::ofstream file(path, std::ios::binary);
  file << png;
  file.close();
  return file ? absl::OkStatus()
              : absl::UnavailableError(absl::StrCat("cannot write ", path, "; the disk may be full"));
}

absl::Status MakeFolder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  return error ? absl::UnavailableError(absl::StrCat("cannot create ", path.string(), ": ", error.message()))
               : absl::OkStatus();
}

absl::Status PrepareFolder(const fs::path& root, bool overwrite) {
  std::error_code error;
  if (fs::exists(root, error) && !fs::is_directory(root, error)) {
    return absl::AlreadyExistsError(absl::StrCat(root.string(), " is there and is not a folder"));
  }
  if (fs::exists(root, error) && !fs::is_empty(root, error)) {
    if (!overwrite) {
      return absl::AlreadyExistsError(
          absl::StrCat(root.string(), " is not empty; choose another folder, or overwrite"));
    }
    // Only what a data set consists of.
    for (const char* part : {"mav0", "images", "groundtruth_cam0.txt", "groundtruth.txt", "camera.txt", "times.txt",
                             "pcalib.txt", "vignette.png", "overlap.txt"}) {
      fs::remove_all(root / part, error);
      if (error) {
        return absl::UnavailableError(absl::StrCat("cannot remove ", (root / part).string(), ": ", error.message()));
      }
    }
  }
  return MakeFolder(root);
}

std::string ImageName(const Sequence& sequence, DatasetFormat format, int frame) {
  return format == DatasetFormat::kEuroc ? absl::StrFormat("%d.png", sequence.TimeNsOf(frame))
                                         : absl::StrFormat("%05d.png", frame);
}

absl::Status RenderAll(const Sequence& sequence, const DatasetOptions& options, const fs::path& folder,
                       const std::function<bool(int, int)>& progress) {
  std::atomic<int> next = 0;
  std::mutex mutex;
  int done = 0;
  absl::Status failure;
  std::atomic<bool> stop = false;
  const auto work = [&] {
    for (int i = next++; i < sequence.size() && !stop; i = next++) {
      absl::Status status = WritePng((folder / ImageName(sequence, options.format, i)).string(), sequence.Render(i));
      std::lock_guard lock(mutex);
      ++done;
      if (status.ok() && progress && !progress(done, sequence.size())) status = absl::CancelledError("stopped");
      if (status.ok()) continue;
      failure.Update(status);
      stop = true;
    }
  };
  RunInThreads(options.threads, work);
  return failure;
}

std::vector<io::StampedPose> CameraPoses(const Sequence& sequence) {
  std::vector<io::StampedPose> poses;
  for (int i = 0; i < sequence.size(); ++i) poses.push_back({sequence.TimeNsOf(i), sequence.WorldFromCamera(i)});
  return poses;
}

std::string Matrix44(const SE3& pose) {
  const Matrix34d m = pose.Matrix();
  std::vector<std::string> rows;
  for (int r = 0; r < 3; ++r)
    rows.push_back(absl::StrFormat("%.12g, %.12g, %.12g, %.12g", m(r, 0), m(r, 1), m(r, 2), m(r, 3)));
  return absl::StrCat(absl::StrJoin(rows, ",\n         "), ",\n         0.0, 0.0, 0.0, 1.0");
}

std::string EurocSensor(const SequenceOptions& o) {
  const Camera& c = o.camera;
  std::string model = "radial-tangential";
  std::vector<double> coefficients = c.distortion;
  if (c.model == CameraModel::kKannalaBrandt) model = "equidistant";
  if (c.model == CameraModel::kFov) model = "fov";
  if (coefficients.empty()) coefficients.assign(4, 0.0);
  const auto number = [](std::string* out, double value) { absl::StrAppendFormat(out, "%.12g", value); };
  return absl::StrFormat(
      "sensor_type: camera\ncomment: synthetic\nT_BS:\n  cols: 4\n  rows: 4\n  data: [%s]\nrate_hz: %.12g\n"
      "resolution: [%d, %d]\ncamera_model: pinhole\nintrinsics: [%.12g, %.12g, %.12g, %.12g]\n"
      "distortion_model: %s\ndistortion_coefficients: [%s]\n",
      Matrix44(BodyFromCamera()), o.rate_hz, c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px, model,
      absl::StrJoin(coefficients, ", ", number));
}

std::string EurocGroundtruth(const Sequence& sequence) {
  std::string text =
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
      "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
      "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n";
  const SE3 camera_from_body = BodyFromCamera().Inverse();
  const double step_s = 0.005, end_s = sequence.SecondsOf(sequence.size() - 1);
  const int samples = static_cast<int>(std::floor(end_s / step_s + 0.5)) + 1;
  for (int k = 0; k < samples; ++k) {
    const double t = k * step_s, h = 1e-4;
    const SE3 body = sequence.WorldFromCameraAt(t) * camera_from_body;
    const Vector3d velocity = ((sequence.WorldFromCameraAt(t + h) * camera_from_body).translation() -
                               (sequence.WorldFromCameraAt(t - h) * camera_from_body).translation()) /
                              (2.0 * h);
    const Vector3d& p = body.translation();
    const Quaterniond& q = body.rotation();
    absl::StrAppendFormat(&text, "%d,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.6f,%.6f,%.6f,0,0,0,0,0,0\n",
                          sequence.TimeNsOf(0) + FromSeconds(t), p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z(),
                          velocity.x(), velocity.y(), velocity.z());
  }
  return text;
}

absl::Status WriteEuroc(const Sequence& sequence, const DatasetOptions& options, const fs::path& root,
                        const std::function<bool(int, int)>& progress) {
  const fs::path camera = root / "mav0" / "cam0", state = root / "mav0" / "state_groundtruth_estimate0";
  CAIRN_RETURN_IF_ERROR(MakeFolder(camera / "data"));
  CAIRN_RETURN_IF_ERROR(MakeFolder(state));
  CAIRN_RETURN_IF_ERROR(RenderAll(sequence, options, camera / "data", progress));
  std::string list = "#timestamp [ns],filename\n";
  for (int i = 0; i < sequence.size(); ++i) {
    absl::StrAppendFormat(&list, "%d,%s\n", sequence.TimeNsOf(i), ImageName(sequence, options.format, i));
  }
  CAIRN_RETURN_IF_ERROR(io::WriteFileAtomically((camera / "data.csv").string(), list, true));
  CAIRN_RETURN_IF_ERROR(
      io::WriteFileAtomically((camera / "sensor.yaml").string(), EurocSensor(options.sequence), true));
  CAIRN_RETURN_IF_ERROR(io::WriteFileAtomically((state / "data.csv").string(), EurocGroundtruth(sequence), true));
  return io::WriteTumTrajectory((root / "groundtruth_cam0.txt").string(), CameraPoses(sequence),
                                {.overwrite = true, .comment = "world_from_cam0, synthetic"});
}

std::string TumMonoCamera(const Camera& c) {
  std::string line;
  switch (c.model) {
    case CameraModel::kPinhole:
      line = "Pinhole";
      break;
    case CameraModel::kRadialTangential:
      line = "RadTan";
      break;
    case CameraModel::kKannalaBrandt:
      line = "EquiDistant";
      break;
    case CameraModel::kFov:
      line = "FOV";
      break;
  }
  absl::StrAppendFormat(&line, " %.12g %.12g %.12g %.12g", c.fx_px, c.fy_px, c.cx_px, c.cy_px);
  std::vector<double> coefficients = c.distortion;
  if (c.model == CameraModel::kPinhole) coefficients = {0.0};
  if (c.model == CameraModel::kRadialTangential) coefficients.resize(4, 0.0);
  for (const double k : coefficients) absl::StrAppendFormat(&line, " %.12g", k);
  return absl::StrFormat("%s\n%d %d\ncrop\n%d %d\n", line, c.width_px, c.height_px, c.width_px, c.height_px);
}

absl::Status WriteTumMono(const Sequence& sequence, const DatasetOptions& options, const fs::path& root,
                          const std::function<bool(int, int)>& progress) {
  CAIRN_RETURN_IF_ERROR(MakeFolder(root / "images"));
  CAIRN_RETURN_IF_ERROR(RenderAll(sequence, options, root / "images", progress));
  std::string times, response;
  for (int i = 0; i < sequence.size(); ++i) {
    absl::StrAppendFormat(&times, "%05d %s %.9g\n", i, io::FormatSeconds(sequence.TimeNsOf(i)),
                          1e3 * sequence.ExposureS(i));
  }
  for (const double value : sequence.renderer().InverseResponse()) absl::StrAppendFormat(&response, "%.9g ", value);
  response.back() = '\n';
  cv::Mat vignette;
  sequence.renderer().vignette().convertTo(vignette, CV_16UC1, 65535.0);
  CAIRN_RETURN_IF_ERROR(WritePng((root / "vignette.png").string(), vignette));
  CAIRN_RETURN_IF_ERROR(io::WriteFileAtomically((root / "times.txt").string(), times, true));
  CAIRN_RETURN_IF_ERROR(io::WriteFileAtomically((root / "pcalib.txt").string(), response, true));
  CAIRN_RETURN_IF_ERROR(
      io::WriteFileAtomically((root / "camera.txt").string(), TumMonoCamera(options.sequence.camera), true));
  return io::WriteTumTrajectory((root / "groundtruth.txt").string(), CameraPoses(sequence),
                                {.overwrite = true, .comment = "world_from_camera, synthetic"});
}

absl::Status WriteOverlap(const Sequence& sequence, int with_session, const fs::path& path) {
  SequenceOptions other = sequence.options();
  other.trajectory.session = with_session;
  other.max_duration_s = 0.0;
  const OverlapOptions options;
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> shares, SharedViews(sequence, other, options));
  std::string text = absl::StrFormat(
      "# time and the largest share of the surface in view that one image of session %d shows too, from within %.0f "
      "deg "
      "and %.1f times the distance\n",
      with_session + 1, options.max_angle_rad * 180.0 / std::numbers::pi, options.max_distance_ratio);
  for (int i = 0; i < sequence.size(); ++i) {
    absl::StrAppendFormat(&text, "%s %.3f\n", io::FormatSeconds(sequence.TimeNsOf(i)),
                          shares[static_cast<std::size_t>(i)]);
  }
  return io::WriteFileAtomically(path.string(), text, true);
}

}  // namespace

absl::string_view DatasetFormatName(DatasetFormat format) {
  return format == DatasetFormat::kEuroc ? "euroc" : "tum_mono";
}

absl::StatusOr<DatasetFormat> DatasetFormatFromName(absl::string_view name) {
  if (name == "euroc") return DatasetFormat::kEuroc;
  if (name == "tum_mono") return DatasetFormat::kTumMono;
  return absl::NotFoundError(absl::StrCat("no format \"", name, "\"; there are euroc, tum_mono"));
}

absl::Status DatasetOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(sequence.Validate());
  if (threads < 1 || threads > 256) return absl::InvalidArgumentError("threads must be in [1, 256]");
  if (format == DatasetFormat::kTumMono && sequence.camera.distortion.size() > 4) {
    return absl::InvalidArgumentError("camera.txt of tum_mono has room for 4 distortion coefficients; write euroc");
  }
  return absl::OkStatus();
}

absl::Status GenerateDataset(const DatasetOptions& options, const std::string& out_dir,
                             const std::function<bool(int done, int total)>& progress) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (out_dir.empty()) return absl::InvalidArgumentError("the name of the folder to write is empty");
  CAIRN_RETURN_IF_ERROR(PrepareFolder(out_dir, options.overwrite));
  CAIRN_ASSIGN_OR_RETURN(const Sequence sequence, Sequence::Create(options.sequence));
  if (options.overlap_with_session) {
    CAIRN_RETURN_IF_ERROR(WriteOverlap(sequence, *options.overlap_with_session, fs::path(out_dir) / "overlap.txt"));
  }
  return options.format == DatasetFormat::kEuroc ? WriteEuroc(sequence, options, out_dir, progress)
                                                 : WriteTumMono(sequence, options, out_dir, progress);
}

}  // namespace cairn::synth
