#include "geometry/camera.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "geometry/lens_plausibility.h"

namespace cairn {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix23d = Eigen::Matrix<double, 2, 3>;
using Matrix2Xd = Eigen::Matrix<double, 2, Eigen::Dynamic>;

constexpr double kPi = 3.14159265358979323846;
constexpr double kConvergence = 1e-10;  // of the unit image plane
constexpr int kMaxIterations = 50;
constexpr int kMaxSizePx = 32767;  // OpenCV's fixed-point maps hold 16 bits
// Larger than any sensor that is mapped with; an undistortion map takes 6 bytes per pixel (docs/input.md).
constexpr std::int64_t kMaxPixels = 100'000'000;

constexpr std::array<std::pair<CameraModel, absl::string_view>, 4> kNames = {{
    {CameraModel::kPinhole, "pinhole"},
    {CameraModel::kRadialTangential, "radial_tangential"},
    {CameraModel::kKannalaBrandt, "kannala_brandt"},
    {CameraModel::kFov, "fov"},
}};

// Whether a slope that is 1 at zero stays positive up to `limit`: the distorted radius has not turned back.
template <class Slope>
bool StaysPositive(const Slope& slope, double limit) {
  constexpr int kSamples = 16;
  for (int i = 1; i <= kSamples; ++i) {
    if (!(slope(limit * i / kSamples) > 0.0)) return false;
  }
  return true;
}

// A point of the unit plane after distortion, with derivatives.
struct Distorted {
  Vector2d xy = Vector2d::Zero();
  Matrix2d by_xy = Matrix2d::Identity();
  Matrix2Xd by_coefficients;  // filled on request
};

class RadialTangential {
 public:
  explicit RadialTangential(const std::vector<double>& d) {
    for (std::size_t i = 0; i < d.size() && i < 8; ++i) c_[i] = d[i];
  }

  Distorted Distort(const Vector2d& p, int num_coefficients = 0) const {
    const double x = p.x(), y = p.y(), s = p.squaredNorm();
    const double p1 = c_[2], p2 = c_[3];
    const double n = Numerator(s), d = Denominator(s), g = n / d;
    const double dg_ds = (NumeratorSlope(s) - g * DenominatorSlope(s)) / d;
    Distorted out;
    out.xy << x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y;
    const double cross = 2 * x * y * dg_ds + 2 * p1 * x + 2 * p2 * y;
    out.by_xy << g + 2 * x * x * dg_ds + 2 * p1 * y + 6 * p2 * x, cross, cross,
        g + 2 * y * y * dg_ds + 6 * p1 * y + 2 * p2 * x;
    if (num_coefficients > 0) {
      Eigen::Matrix<double, 2, 8> by;
      by.col(0) = p * (s / d);
      by.col(1) = p * (s * s / d);
      by.col(2) << 2 * x * y, s + 2 * y * y;
      by.col(3) << s + 2 * x * x, 2 * x * y;
      by.col(4) = p * (s * s * s / d);
      by.col(5) = -p * (g * s / d);
      by.col(6) = -p * (g * s * s / d);
      by.col(7) = -p * (g * s * s * s / d);
      out.by_coefficients = by.leftCols(num_coefficients);
    }
    return out;
  }

  // d(r g) / dr along the radius, at s = r^2.
  bool IsBeforeTheFold(double s) const {
    return StaysPositive(
        [this](double t) {
          const double n = Numerator(t), d = Denominator(t);
          if (d <= 0.0) return -1.0;
          return n * d + 2 * t * (NumeratorSlope(t) * d - n * DenominatorSlope(t));
        },
        s);
  }

 private:
  double Numerator(double s) const { return 1 + s * (c_[0] + s * (c_[1] + s * c_[4])); }
  double Denominator(double s) const { return 1 + s * (c_[5] + s * (c_[6] + s * c_[7])); }
  double NumeratorSlope(double s) const { return c_[0] + s * (2 * c_[1] + s * 3 * c_[4]); }
  double DenominatorSlope(double s) const { return c_[5] + s * (2 * c_[6] + s * 3 * c_[7]); }

  std::array<double, 8> c_ = {};
};

class Fov {
 public:
  explicit Fov(double omega) : omega_(omega), t_(std::tan(omega / 2)) {}

  Distorted Distort(const Vector2d& p, int num_coefficients = 0) const {
    const double r2 = p.squaredNorm(), r = std::sqrt(r2);
    double scale, r_slope, by_omega;  // r_d / r, dr_d / dr, d(r_d / r) / d omega
    if (omega_ < kSmall) {
      scale = 1 + omega_ * omega_ * (1.0 / 12 - r2 / 3);
      r_slope = 1 + omega_ * omega_ * (1.0 / 12 - r2);
      by_omega = 2 * omega_ * (1.0 / 12 - r2 / 3);
    } else {
      const double bend = 1 + 4 * r2 * t_ * t_;
      scale = r > 1e-9 ? std::atan(2 * r * t_) / (r * omega_) : 2 * t_ / omega_;
      r_slope = 2 * t_ / (omega_ * bend);
      by_omega = ((1 + t_ * t_) / bend - scale) / omega_;
    }
    Distorted out;
    out.xy = scale * p;
    out.by_xy = scale * Matrix2d::Identity();
    if (r2 > 0.0) out.by_xy += (r_slope - scale) / r2 * p * p.transpose();
    if (num_coefficients > 0) out.by_coefficients = by_omega * p;
    return out;
  }

  std::optional<Vector2d> Undistort(const Vector2d& p) const {
    const double r_d = p.norm();
    if (r_d < 1e-12) return p / Distort(Vector2d::Zero()).by_xy(0, 0);
    if (omega_ < kSmall) return p / (1 + omega_ * omega_ * (1.0 / 12 - r_d * r_d / 3));
    if (r_d * omega_ >= kPi / 2 - 1e-9) return std::nullopt;
    return p * (std::tan(r_d * omega_) / (2 * t_ * r_d));
  }

 private:
  static constexpr double kSmall = 1e-4;

  double omega_;
  double t_;
};

// theta_d and its slope, by theta.
class KannalaBrandt {
 public:
  explicit KannalaBrandt(const std::vector<double>& k) : k_(k) {}

  double Radius(double theta) const {
    const double u = theta * theta;
    return theta * (1 + u * (k_[0] + u * (k_[1] + u * (k_[2] + u * k_[3]))));
  }
  double Slope(double theta) const {
    const double u = theta * theta;
    return 1 + u * (3 * k_[0] + u * (5 * k_[1] + u * (7 * k_[2] + u * 9 * k_[3])));
  }
  bool IsBeforeTheFold(double theta) const {
    return StaysPositive([this](double t) { return Slope(t); }, theta);
  }

  std::optional<double> Angle(double radius) const {
    double theta = std::min(radius, kPi);
    for (int i = 0; i < kMaxIterations; ++i) {
      const double error = Radius(theta) - radius;
      if (std::abs(error) < kConvergence * 0.01) break;
      double step = -error / Slope(theta);
      for (int k = 0; k < 30 && !(theta + step >= 0 && theta + step <= kPi && Slope(theta + step) > 0); ++k) step /= 2;
      theta += step;
    }
    if (!(std::abs(Radius(theta) - radius) < kConvergence) || !IsBeforeTheFold(theta)) return std::nullopt;
    return theta;
  }

 private:
  const std::vector<double>& k_;
};

// Newton's method on the plane; halves a step that would cross the fold.
std::optional<Vector2d> UndistortRadialTangential(const RadialTangential& model, const Vector2d& target) {
  Vector2d p = target;
  for (int k = 0; k < 30 && !model.IsBeforeTheFold(p.squaredNorm()); ++k) p *= 0.7;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Distorted now = model.Distort(p);
    const Vector2d error = now.xy - target;
    if (error.norm() < kConvergence * 0.01) break;
    const double determinant = now.by_xy.determinant();
    if (!(std::abs(determinant) > 1e-12)) return std::nullopt;
    Vector2d step = -now.by_xy.inverse() * error;
    for (int k = 0; k < 30 && !(model.Distort(p + step).by_xy.determinant() > 0); ++k) step /= 2;
    p += step;
  }
  const Distorted end = model.Distort(p);
  if (!((end.xy - target).norm() < kConvergence) || !model.IsBeforeTheFold(p.squaredNorm())) return std::nullopt;
  return p;
}

// The pixel of a distorted unit-plane point, with the chain rule through x = X/Z, y = Y/Z.
Vector2d FinishProjection(const Camera& camera, const Vector2d& xy_d, const Matrix23d& by_point_plane,
                          const Matrix2Xd& by_coefficients, Matrix23d* by_point, Matrix2Xd* by_parameters) {
  const Vector2d focal(camera.fx_px, camera.fy_px);
  if (by_point != nullptr) *by_point = focal.asDiagonal() * by_point_plane;
  if (by_parameters != nullptr) {
    by_parameters->setZero(2, camera.NumParameters());
    (*by_parameters)(0, 0) = xy_d.x();
    (*by_parameters)(1, 1) = xy_d.y();
    (*by_parameters)(0, 2) = 1.0;
    (*by_parameters)(1, 3) = 1.0;
    if (!camera.distortion.empty()) {
      by_parameters->rightCols(camera.distortion.size()) = focal.asDiagonal() * by_coefficients;
    }
  }
  return {camera.fx_px * xy_d.x() + camera.cx_px, camera.fy_px * xy_d.y() + camera.cy_px};
}

std::optional<Vector2d> ProjectKannalaBrandt(const Camera& camera, const Vector3d& point, Matrix23d* by_point,
                                             Matrix2Xd* by_parameters) {
  const KannalaBrandt model(camera.distortion);
  const double x = point.x(), y = point.y(), z = point.z();
  const double rho2 = x * x + y * y, rho = std::sqrt(rho2), norm2 = rho2 + z * z;
  const bool on_axis = rho < 1e-12 * std::abs(z);
  if (!(norm2 > 0.0) || (on_axis && z < 0.0)) return std::nullopt;
  const double theta = std::atan2(rho, z);
  if (!model.IsBeforeTheFold(theta)) return std::nullopt;
  const double radius = model.Radius(theta), slope = model.Slope(theta);
  const double scale = on_axis ? 1.0 / z : radius / rho;
  const Vector2d xy(x, y);
  Matrix23d by = Matrix23d::Zero();
  by.leftCols<2>() = scale * Matrix2d::Identity();
  if (!on_axis) by.leftCols<2>() += (slope * z / norm2 - scale) / rho2 * xy * xy.transpose();
  by.col(2) = -slope / norm2 * xy;
  Matrix2Xd by_coefficients;
  if (by_parameters != nullptr) {
    by_coefficients.resize(2, 4);
    const double u = theta * theta;
    double power = on_axis ? 0.0 : theta * u / rho;
    for (int i = 0; i < 4; ++i, power *= u) by_coefficients.col(i) = power * xy;
  }
  return FinishProjection(camera, scale * xy, by, by_coefficients, by_point, by_parameters);
}

}  // namespace

absl::string_view CameraModelName(CameraModel model) {
  for (const auto& [value, name] : kNames) {
    if (value == model) return name;
  }
  return "unknown";
}

absl::StatusOr<CameraModel> CameraModelFromName(absl::string_view name) {
  for (const auto& [value, known] : kNames) {
    if (known == name) return value;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("unknown camera model \"", name, "\"; use pinhole, radial_tangential, kannala_brandt or fov"));
}

Camera Camera::FromPinhole(const Pinhole& p) {
  return {CameraModel::kPinhole, p.width_px, p.height_px, p.fx_px, p.fy_px, p.cx_px, p.cy_px, {}};
}

absl::Status Camera::Validate() const {
  if (width_px < 1 || height_px < 1 || width_px > kMaxSizePx || height_px > kMaxSizePx) {
    return absl::InvalidArgumentError(
        absl::StrCat("image size ", width_px, "x", height_px, " px is not within 1 to ", kMaxSizePx, " px"));
  }
  if (std::int64_t{width_px} * height_px > kMaxPixels) {
    return absl::InvalidArgumentError(absl::StrCat("image size ", width_px, "x", height_px, " px is more than the ",
                                                   kMaxPixels / 1'000'000, " megapixels that are supported"));
  }
  if (!std::isfinite(fx_px) || !std::isfinite(fy_px) || fx_px <= 0.0 || fy_px <= 0.0) {
    return absl::InvalidArgumentError(
        absl::StrCat("focal lengths ", fx_px, " and ", fy_px, " px must be positive and finite"));
  }
  const auto near_image = [](double c, int size) { return std::isfinite(c) && c > -size && c < 2.0 * size; };
  if (!near_image(cx_px, width_px) || !near_image(cy_px, height_px)) {
    return absl::InvalidArgumentError(absl::StrCat("principal point (", cx_px, ", ", cy_px, ") px is far outside the ",
                                                   width_px, "x", height_px, " image; give it in pixels"));
  }
  const std::size_t n = distortion.size();
  bool fits = false;
  absl::string_view wanted;
  switch (model) {
    case CameraModel::kPinhole:
      fits = n == 0, wanted = "none";
      break;
    case CameraModel::kRadialTangential:
      fits = n == 0 || n == 4 || n == 5 || n == 8, wanted = "0, 4, 5 or 8";
      break;
    case CameraModel::kKannalaBrandt:
      fits = n == 4, wanted = "4";
      break;
    case CameraModel::kFov:
      fits = n == 1, wanted = "1";
      break;
  }
  if (!fits) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera model ", CameraModelName(model), " takes ", wanted, " distortion coefficients, not ", n));
  }
  for (const double k : distortion) {
    if (!std::isfinite(k)) return absl::InvalidArgumentError("a distortion coefficient is not a finite number");
  }
  if (model == CameraModel::kFov && !(distortion[0] >= 0.0 && distortion[0] < kPi)) {
    return absl::InvalidArgumentError(
        absl::StrCat("the fov model's omega is ", distortion[0], " but must be in [0, pi) radians"));
  }
  return CheckLens(*this);
}

bool Camera::IsUndistorted() const {
  if (model == CameraModel::kPinhole) return true;
  if (model == CameraModel::kKannalaBrandt) return false;  // even with zeros: an equidistant lens
  return std::all_of(distortion.begin(), distortion.end(), [](double k) { return k == 0.0; });
}

std::optional<Vector2d> Camera::Project(const Vector3d& point_c, Matrix23d* by_point, Matrix2Xd* by_parameters) const {
  if (!point_c.allFinite()) return std::nullopt;
  if (model == CameraModel::kKannalaBrandt) return ProjectKannalaBrandt(*this, point_c, by_point, by_parameters);
  if (!(point_c.z() > 0.0)) return std::nullopt;
  const double inverse_z = 1.0 / point_c.z();
  const Vector2d xy = point_c.head<2>() * inverse_z;
  const int num_coefficients = by_parameters != nullptr ? static_cast<int>(distortion.size()) : 0;
  Distorted d;
  if (model == CameraModel::kRadialTangential) {
    const RadialTangential lens(distortion);
    if (!lens.IsBeforeTheFold(xy.squaredNorm())) return std::nullopt;
    d = lens.Distort(xy, num_coefficients);
  } else if (model == CameraModel::kFov) {
    d = Fov(distortion[0]).Distort(xy, num_coefficients);
  } else {
    d.xy = xy;
  }
  Matrix23d by;
  by.leftCols<2>() = d.by_xy * inverse_z;
  by.col(2) = -d.by_xy * xy * inverse_z;
  return FinishProjection(*this, d.xy, by, d.by_coefficients, by_point, by_parameters);
}

std::optional<Vector3d> Camera::Unproject(const Vector2d& pixel) const {
  if (!pixel.allFinite()) return std::nullopt;
  const Vector2d target((pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px);
  std::optional<Vector2d> xy = target;
  if (model == CameraModel::kKannalaBrandt) {
    const double radius = target.norm();
    if (radius < 1e-15) return Vector3d::UnitZ();
    const std::optional<double> theta = KannalaBrandt(distortion).Angle(radius);
    if (!theta) return std::nullopt;
    const Vector2d sideways = target * (std::sin(*theta) / radius);
    return Vector3d(sideways.x(), sideways.y(), std::cos(*theta));
  }
  if (model == CameraModel::kRadialTangential) {
    xy = UndistortRadialTangential(RadialTangential(distortion), target);
  } else if (model == CameraModel::kFov) {
    xy = Fov(distortion[0]).Undistort(target);
  }
  if (!xy) return std::nullopt;
  return Vector3d(xy->x(), xy->y(), 1.0).normalized();
}

std::string Camera::Describe() const {
  std::string text = absl::StrFormat("%s %dx%d fx %.6g fy %.6g cx %.6g cy %.6g", CameraModelName(model), width_px,
                                     height_px, fx_px, fy_px, cx_px, cy_px);
  if (!distortion.empty()) absl::StrAppend(&text, " distortion ", absl::StrJoin(distortion, " "));
  return text;
}

}  // namespace cairn
