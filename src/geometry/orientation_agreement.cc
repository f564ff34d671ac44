#include "geometry/orientation_agreement.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "base/median.h"
#include "base/random.h"

namespace cairn {
namespace {

// The rotation between two times, as a and as b have it, in the axes of the first time.
struct RelativeRotation {
  Vector3d a_rad;
  Vector3d b_rad;
  Quaterniond a, b;

  // Of a turned by the mount to b.
  double CosHalfDifference(const Quaterniond& camera_from_body) const {
    return std::abs(a.w() * b.w() + (camera_from_body * a.vec()).dot(b.vec()));
  }
  double Difference(const Quaterniond& camera_from_body) const {
    const Vector3d turned = camera_from_body * a.vec();
    return AngleRad(Quaterniond(a.w(), turned.x(), turned.y(), turned.z()).conjugate() * b);
  }
};

// What is written where nothing is known: the identity on every line. A camera whose first pose is the origin and that
// never turns would have it, too, but no orientation that was measured is the identity to the last digit.
bool AreAllIdentity(std::span<const SE3> poses) {
  constexpr double kLastDigit_rad = 1e-9;
  return std::all_of(poses.begin(), poses.end(),
                     [](const SE3& pose) { return AngleRad(pose.rotation()) < kLastDigit_rad; });
}

// All pairs of a few poses; of many, pairs at distances of 1, 2, 4, ... poses, at most 100 of each.
std::vector<RelativeRotation> RelativeRotations(std::span<const SE3> a, std::span<const SE3> b) {
  constexpr std::size_t kAllPairs = 40, kPerDistance = 100;
  const std::size_t n = a.size();
  std::vector<RelativeRotation> rotations;
  const auto add = [&](std::size_t i, std::size_t j) {
    RelativeRotation rotation;
    rotation.a = a[i].rotation().conjugate() * a[j].rotation();
    rotation.b = b[i].rotation().conjugate() * b[j].rotation();
    rotation.a_rad = LogSO3(rotation.a);
    rotation.b_rad = LogSO3(rotation.b);
    rotations.push_back(rotation);
  };
  if (n <= kAllPairs) {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = i + 1; j < n; ++j) add(i, j);
    }
    return rotations;
  }
  for (std::size_t distance = 1; distance < n; distance *= 2) {
    const std::size_t step = std::max<std::size_t>(1, (n - distance) / kPerDistance);
    for (std::size_t i = 0; i + distance < n; i += step) add(i, i + distance);
  }
  return rotations;
}

class Comparison {
 public:
  Comparison(std::vector<RelativeRotation> pairs, const OrientationAgreementOptions& options)
      : pairs_(std::move(pairs)), options_(options) {
    for (const RelativeRotation& pair : pairs_) min_cos_.push_back(std::cos(0.5 * Tolerance(pair)));
  }

  const std::vector<RelativeRotation>& pairs() const { return pairs_; }

  bool Agrees(std::size_t i, const Quaterniond& camera_from_body) const {
    return pairs_[i].CosHalfDifference(camera_from_body) >= min_cos_[i];
  }

  double AgreeingShare(const Quaterniond& camera_from_body) const {
    int count = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) count += Agrees(i, camera_from_body) ? 1 : 0;
    return pairs_.empty() ? 0.0 : static_cast<double>(count) / static_cast<double>(pairs_.size());
  }

  double MedianDifference(const Quaterniond& camera_from_body) const {
    std::vector<double> differences;
    for (const RelativeRotation& pair : pairs_) differences.push_back(pair.Difference(camera_from_body));
    return Median(std::move(differences));
  }

  // Of the pairs that agree with a mount: are they twice as far off without it?
  bool Explains(const Quaterniond& mount) const {
    std::vector<double> with, without;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (!Agrees(i, mount)) continue;
      with.push_back(pairs_[i].Difference(mount));
      without.push_back(pairs_[i].Difference(Quaterniond::Identity()));
    }
    return Median(std::move(without)) > 2.0 * Median(std::move(with));
  }

  // The mount rotation that most pairs agree with: the best of samples of two, then least squares over those.
  Quaterniond Mount() const {
    constexpr int kSamples = 200;
    constexpr double kNearHalfTurn_rad = 2.6;  // where the axis changes its sign
    std::vector<std::size_t> same_angle;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const RelativeRotation& pair = pairs_[i];
      const double angle_a = pair.a_rad.norm(), angle_b = pair.b_rad.norm();
      if (std::max(angle_a, angle_b) > kNearHalfTurn_rad || std::abs(angle_a - angle_b) > Tolerance(pair)) continue;
      same_angle.push_back(i);
    }
    Quaterniond best = Quaterniond::Identity();
    if (same_angle.empty()) return best;
    double best_share = AgreeingShare(best);
    Random random(options_.seed);
    for (int k = 0; k < kSamples; ++k) {
      const Quaterniond mount = FromTwo(pairs_[same_angle[random.Below(same_angle.size())]],
                                        pairs_[same_angle[random.Below(same_angle.size())]]);
      const double share = AgreeingShare(mount);
      if (share > best_share) std::tie(best, best_share) = std::pair(mount, share);
    }
    return Refined(best, same_angle);
  }

 private:
  double Tolerance(const RelativeRotation& pair) const {
    return std::max(options_.tolerance_rad, options_.tolerance_share * pair.b_rad.norm());
  }

  // The rotation that takes both axes of a to those of b; the smallest one if the two are nearly the same axis.
  static Quaterniond FromTwo(const RelativeRotation& first, const RelativeRotation& second) {
    const Quaterniond turn = Quaterniond::FromTwoVectors(first.a_rad, first.b_rad);
    const Vector3d axis = first.b_rad.normalized();
    const Vector3d from = turn * second.a_rad - axis * axis.dot(turn * second.a_rad);
    const Vector3d to = second.b_rad - axis * axis.dot(second.b_rad);
    constexpr double kMinAcross = 0.3;
    if (std::min(from.norm(), to.norm()) < kMinAcross * second.b_rad.norm()) return turn;
    return ExpSO3(axis * std::atan2(axis.dot(from.cross(to)), from.dot(to))) * turn;
  }

  Quaterniond Refined(Quaterniond mount, const std::vector<std::size_t>& pairs) const {
    constexpr int kRounds = 5;
    for (int round = 0; round < kRounds; ++round) {
      Matrix3d cross = Matrix3d::Zero();
      for (const std::size_t i : pairs) {
        if (Agrees(i, mount)) cross += pairs_[i].b_rad * (mount * pairs_[i].a_rad).transpose();
      }
      const Eigen::JacobiSVD<Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
      // About one axis only: what a turn about it would change is not known and stays.
      constexpr double kMinSecondAxis = 1e-3;
      if (svd.singularValues()[1] <= kMinSecondAxis * svd.singularValues()[0]) break;
      Vector3d sign(1.0, 1.0, 1.0);
      if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0) sign[2] = -1.0;
      mount = Quaterniond(Matrix3d(svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose())) * mount;
    }
    return mount.normalized();
  }

  std::vector<RelativeRotation> pairs_;
  std::vector<double> min_cos_;  // of half of what each may differ by
  const OrientationAgreementOptions& options_;
};

OrientationAgreement Compare(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                             const OrientationAgreementOptions& options) {
  OrientationAgreement result;
  if (poses_a.size() != poses_b.size() || poses_a.size() < 3) return result;
  std::vector<RelativeRotation> all = RelativeRotations(poses_a, poses_b);
  double most_a_rad = 0.0;
  std::vector<double> angles_b;
  std::vector<RelativeRotation> telling;
  for (const RelativeRotation& pair : all) {
    most_a_rad = std::max(most_a_rad, pair.a_rad.norm());
    angles_b.push_back(pair.b_rad.norm());
    if (pair.b_rad.norm() >= options.min_turn_rad) telling.push_back(pair);
  }
  constexpr double kMinTellingShare = 0.05;
  const double median_turn_rad = Median(std::move(angles_b));
  result.turns =
      telling.size() >= 3 && static_cast<double>(telling.size()) >= kMinTellingShare * static_cast<double>(all.size());
  const Comparison comparison(result.turns ? std::move(telling) : std::move(all), options);
  std::vector<double> turned;
  for (const RelativeRotation& pair : comparison.pairs()) turned.push_back(pair.b_rad.norm());
  result.turned_rad = Median(std::move(turned));

  const Quaterniond identity = Quaterniond::Identity();
  const Quaterniond mount = result.turns ? comparison.Mount() : identity;
  result.difference_rad = comparison.MedianDifference(identity);
  result.agreeing_share = comparison.AgreeingShare(identity);
  result.mounted_difference_rad = comparison.MedianDifference(mount);
  result.mounted_agreeing_share = comparison.AgreeingShare(mount);

  // No camera that is carried keeps its orientation to the last digit.
  constexpr double kSame_rad = 1e-4, kTurnsAtAll_rad = 0.0175;
  if (most_a_rad < kSame_rad && (result.turns || median_turn_rad > kTurnsAtAll_rad || AreAllIdentity(poses_a))) {
    result.kind = OrientationKind::kConstant;
    return result;
  }
  const bool as_camera = result.agreeing_share >= options.min_agreeing_share;
  const bool as_body =
      result.mounted_agreeing_share >= options.min_agreeing_share && AngleRad(mount) > options.min_mount_rad;
  // Small rotations agree with small mounts, too: the mount must explain what is left without it.
  if (as_body && (!as_camera || comparison.Explains(mount))) {
    result.kind = OrientationKind::kBody;
    result.camera_from_body = mount;
  } else {
    result.kind = as_camera ? OrientationKind::kCamera : OrientationKind::kUnrelated;
  }
  return result;
}

}  // namespace

OrientationAgreement CompareOrientations(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                         const OrientationAgreementOptions& options) {
  OrientationAgreement result = Compare(poses_a, poses_b, options);
  if (result.kind != OrientationKind::kUnrelated && result.kind != OrientationKind::kBody) return result;
  std::vector<SE3> inverse_a;
  for (const SE3& pose : poses_a) inverse_a.push_back(pose.Inverse());
  const OrientationAgreement inverse = Compare(inverse_a, poses_b, options);
  // A mount that half explains them is no match for an inversion that does.
  constexpr double kClearlyLess = 0.5;
  const double share = std::max(inverse.agreeing_share, inverse.mounted_agreeing_share);
  const double difference_rad = std::min(inverse.difference_rad, inverse.mounted_difference_rad);
  result.inverted = share >= std::max(options.min_agreeing_share, result.mounted_agreeing_share) &&
                    difference_rad < kClearlyLess * result.mounted_difference_rad;
  if (result.inverted) {
    result.kind = OrientationKind::kUnrelated;
    result.camera_from_body = Quaterniond::Identity();
  }
  return result;
}

const char* Describe(OrientationKind kind) {
  switch (kind) {
    case OrientationKind::kCamera:
      return "the camera's";
    case OrientationKind::kBody:
      return "those of a body that the camera is fixed to";
    case OrientationKind::kConstant:
      return "the same everywhere and mean nothing";
    case OrientationKind::kUnrelated:
      return "not those of the camera, nor of a body that it is fixed to";
    case OrientationKind::kOtherFrame:
      return "in another frame than its positions";
    case OrientationKind::kIgnored:
      return "not used";
  }
  return "";
}

}  // namespace cairn
