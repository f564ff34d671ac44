#include "inspect/coverage.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numbers>
#include <optional>
#include <tuple>
#include <unordered_set>

#include "absl/strings/str_format.h"
#include "inspect/measures.h"
#include "map/edit.h"

namespace cairn::inspect {
namespace {

constexpr double kCellsPerDepth = 4.0;

double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Against gravity as far as cameras tell: the mean of their own "up".
Vector3d MeanUp(const std::vector<CoverageTest>& tests) {
  Vector3d up = Vector3d::Zero();
  for (const CoverageTest& test : tests) up -= test.placed_from_camera.RotationMatrix().col(1);
  return up.norm() > 1e-6 ? up.normalized() : Vector3d::UnitZ();
}

// Those that see points of these keyframes, and what these are linked to: all of it is looked at.
std::unordered_set<KeyframeId> Around(const map::Snapshot& map, const std::unordered_set<KeyframeId>& keyframes) {
  std::unordered_set<KeyframeId> around;
  for (const KeyframeId id : keyframes) {
    const map::Keyframe* keyframe = map.keyframes().Find(id);
    if (keyframe == nullptr) continue;
    for (const PointId point_id : keyframe->points) {
      const map::MapPoint* point = point_id ? map.points().Find(point_id) : nullptr;
      if (point == nullptr) continue;
      for (const map::Observation& observation : point->observations) around.insert(observation.keyframe);
    }
    for (const map::CovisibilityEdge& edge : keyframe->covisible) around.insert(edge.keyframe);
    around.insert(keyframe->children.begin(), keyframe->children.end());
    around.insert(keyframe->parent);
  }
  return around;
}

// Whether all that an edit without these keyframes touches can be read: what cannot has no content that fits the rest.
absl::Status CheckAround(const map::Snapshot& map, const std::vector<KeyframeId>& erased) {
  for (const KeyframeId id : Around(map, Around(map, {erased.begin(), erased.end()}))) map.keyframes().Find(id);
  return StatusOfRead(map);
}

// The map without a keyframe and those that see the same, as far as it has them; nothing if the keyframe cannot be
// taken out.
absl::StatusOr<std::optional<map::Delta>> Without(const std::shared_ptr<const map::Snapshot>& map,
                                                  const map::Keyframe& keyframe, double same_view_share,
                                                  int* left_out) {
  const int points = NumPoints(keyframe);
  std::vector<KeyframeId> erased;
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    if (edge.shared_points < same_view_share * points) break;  // most shared points first
    erased.push_back(edge.keyframe);
  }
  erased.push_back(keyframe.id);
  CAIRN_RETURN_IF_ERROR(CheckAround(*map, erased));
  map::Edit edit(map);
  for (const KeyframeId id : erased) {
    if (edit.FindKeyframe(id) == nullptr) continue;
    const bool gone = edit.EraseKeyframe(id);
    if (id != keyframe.id) {
      *left_out += gone ? 1 : 0;
    } else if (!gone) {
      return std::nullopt;
    }
  }
  return edit.Finish("coverage");
}

// What of an image lies in a part of it, and the pinhole of that part.
image::Features SeenIn(const ViewPart& part, const image::Features& all, Pinhole* pinhole) {
  const double x0 = std::floor(part.left * pinhole->width_px), y0 = std::floor(part.top * pinhole->height_px);
  pinhole->width_px = static_cast<int>(std::floor(part.right * pinhole->width_px) - x0);
  pinhole->height_px = static_cast<int>(std::floor(part.bottom * pinhole->height_px) - y0);
  pinhole->cx_px -= x0;
  pinhole->cy_px -= y0;
  image::Features seen;
  for (std::size_t i = 0; i < all.size(); ++i) {
    image::Keypoint keypoint = all.keypoints[i];
    keypoint.x_px -= static_cast<float>(x0);
    keypoint.y_px -= static_cast<float>(y0);
    if (!pinhole->Contains({keypoint.x_px, keypoint.y_px})) continue;
    seen.keypoints.push_back(keypoint);
    seen.descriptors.push_back(all.descriptors[i]);
  }
  return seen;
}

CoverageResult Judge(const map::Snapshot& map, const map::Keyframe& keyframe, const tracking::Relocalization& found,
                     double median_depth, const CoverageOptions& options) {
  if (!found.localized) return CoverageResult::kMissed;
  if (map.keyframe(found.place.reference_keyframe).component != keyframe.component) return CoverageResult::kWrongPlace;
  const SE3 change = found.place.camera_from_map * keyframe.camera_from_map.Inverse();
  const double shift =
      (found.place.camera_from_map.Inverse().translation() - keyframe.camera_from_map.Inverse().translation()).norm();
  const bool right = shift <= options.max_shift_share * median_depth &&
                     AngleRad(change.rotation()) * 180.0 / std::numbers::pi <= options.max_turn_deg;
  return right ? CoverageResult::kFound : CoverageResult::kWrongPlace;
}

std::string AxisName(const Vector3d& direction) {
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  return absl::StrCat(direction[axis] < 0.0 ? "-" : "", absl::string_view("xyz").substr(axis, 1));
}

// The world's axes, if upwards is nearly one of them.
bool TakeWorldAxes(const Vector3d& up, Coverage* coverage) {
  constexpr double kNear = 0.94;  // 20 degrees: cameras look down a little more often than up
  Eigen::Index axis = 0;
  if (up.cwiseAbs().maxCoeff(&axis) < kNear) return false;
  coverage->right = Vector3d::Unit(axis == 0 ? 1 : 0);
  coverage->ahead = Vector3d(std::copysign(1.0, up[axis]) * Vector3d::Unit(axis)).cross(coverage->right);
  coverage->right_name = AxisName(coverage->right);
  coverage->ahead_name = AxisName(coverage->ahead);
  return true;
}

// The largest extent on the ground runs to the right.
void TakeLargestExtent(const std::vector<CoverageTest>& tests, const Vector3d& up, Coverage* coverage) {
  Vector3d mean = Vector3d::Zero();
  for (const CoverageTest& test : tests) mean += test.placed_from_camera.translation();
  mean /= std::max<double>(1.0, static_cast<double>(tests.size()));
  Matrix3d spread = Matrix3d::Zero();
  for (const CoverageTest& test : tests) {
    Vector3d offset = test.placed_from_camera.translation() - mean;
    offset -= up * up.dot(offset);
    spread += offset * offset.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(spread);
  Vector3d right = eigen.eigenvectors().col(2);
  right -= up * up.dot(right);
  if (!(right.norm() > 1e-9)) right = up.unitOrthogonal();
  right.normalize();
  // The same picture each time, whatever the solver's signs.
  Eigen::Index largest;
  right.cwiseAbs().maxCoeff(&largest);
  if (right[largest] < 0.0) right = -right;
  coverage->right = right;
  coverage->ahead = up.cross(right);
}

// By the components that share the world's frame, if there are any.
void ChooseAxes(const map::Snapshot& map, Coverage* coverage) {
  std::vector<CoverageTest> aligned;
  std::ranges::copy_if(coverage->tests, std::back_inserter(aligned),
                       [&](const CoverageTest& test) { return map.WorldFrom(test.component).has_value(); });
  const std::vector<CoverageTest>& tests = aligned.empty() ? coverage->tests : aligned;
  const Vector3d up = MeanUp(tests);
  if (aligned.empty() || !TakeWorldAxes(up, coverage)) TakeLargestExtent(tests, up, coverage);
}

void WarnOfCells(const map::Snapshot& map, const CoverageOptions& options, Coverage* coverage) {
  for (const CoverageCell& cell : coverage->cells) {
    if (cell.tests < options.min_tests || cell.share() >= options.min_share) continue;
    coverage->warnings.push_back(absl::StrFormat(
        "around %.2f %.2f %.2f%s, component %u: %d of %d views are found without their own keyframe: map more there",
        cell.center.x(), cell.center.y(), cell.center.z(), map.WorldFrom(cell.component) ? " m" : "",
        cell.component.value(), cell.found, cell.tests));
  }
}

void FillCells(const map::Snapshot& map, const CoverageOptions& options, Coverage* coverage) {
  ChooseAxes(map, coverage);
  const Vector3d up = coverage->right.cross(coverage->ahead);
  std::map<std::tuple<ComponentId, int, int>, CoverageCell> cells;
  for (const CoverageTest& test : coverage->tests) {
    CoverageCell at = CellOf(*coverage, test.placed_from_camera.translation());
    at.component = test.component;
    CoverageCell& cell = cells.try_emplace({test.component, at.y, at.x}, at).first->second;
    ++cell.tests;
    cell.found += test.result == CoverageResult::kFound ? 1 : 0;
    cell.center += up * up.dot(test.placed_from_camera.translation());
  }
  for (auto& [key, cell] : cells) {
    cell.center /= cell.tests;
    cell.center += coverage->cell_size * ((cell.x + 0.5) * coverage->right + (cell.y + 0.5) * coverage->ahead);
    coverage->cells.push_back(cell);
  }
  int found = 0, wrong = 0;
  for (const CoverageTest& test : coverage->tests) {
    found += test.result == CoverageResult::kFound ? 1 : 0;
    wrong += test.result == CoverageResult::kWrongPlace ? 1 : 0;
  }
  if (!coverage->tests.empty()) coverage->share = 1.0 * found / static_cast<double>(coverage->tests.size());
  WarnOfCells(map, options, coverage);
  if (wrong > 0) {
    coverage->warnings.push_back(absl::StrFormat(
        "%d views are found at a wrong place without their own keyframe: parts of the map look alike", wrong));
  }
}

}  // namespace

absl::Status CoverageOptions::Validate() const {
  if (max_tests < 1 || !(same_view_share > 0.0) || !(max_shift_share > 0.0) || !(max_turn_deg > 0.0) ||
      !(cell_size >= 0.0)) {
    return absl::InvalidArgumentError("coverage: counts, shares and angles must be positive, cells not negative");
  }
  return relocalizer.Validate();
}

CoverageCell CellOf(const Coverage& coverage, const Vector3d& placed) {
  CoverageCell cell;
  cell.x = static_cast<int>(std::floor(coverage.right.dot(placed) / coverage.cell_size));
  cell.y = static_cast<int>(std::floor(coverage.ahead.dot(placed) / coverage.cell_size));
  return cell;
}

absl::StatusOr<std::vector<CoverageTest>> AskForKeyframe(const tracking::MapView& view, const map::Snapshot& map,
                                                         KeyframeId asked, const CoverageOptions& options,
                                                         const std::vector<ViewPart>& parts) {
  if (view.places() == nullptr) {
    return absl::FailedPreconditionError("the map has no vocabulary, so that no place can be found in it");
  }
  const map::Keyframe& keyframe = map.keyframe(asked);
  CoverageTest test;
  test.keyframe = keyframe.id;
  test.component = keyframe.component;
  test.placed_from_camera = PlacedPose(map, keyframe);
  CAIRN_ASSIGN_OR_RETURN(const auto delta, Without(view.snapshot(), keyframe, options.same_view_share, &test.left_out));
  std::vector<CoverageTest> tests;
  if (!delta) return tests;
  CAIRN_ASSIGN_OR_RETURN(const auto rest, view.After(*delta));
  const tracking::Relocalizer relocalizer(options.relocalizer);
  const auto features = keyframe.features.Get();
  const double median_depth = MedianDepth(Measure(map, keyframe));
  for (const ViewPart& part : parts) {
    Pinhole pinhole = map.pinhole(keyframe.camera);
    const image::Features seen = SeenIn(part, features->features, &pinhole);
    CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                           relocalizer.Relocalize(rest->map(), *rest->places(), pinhole, seen));
    test.result = Judge(rest->map(), keyframe, found, median_depth, options);
    test.stage = found.stage;
    test.inliers = found.counts.inliers;
    tests.push_back(test);
  }
  CAIRN_RETURN_IF_ERROR(StatusOfRead(map));
  return tests;
}

absl::StatusOr<Coverage> MeasureCoverage(const tracking::MapView& view, const CoverageOptions& options,
                                         const std::function<bool(int, int)>& progress) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (view.places() == nullptr) {
    return absl::FailedPreconditionError("the map has no vocabulary, so that no place can be found in it");
  }
  const map::Snapshot& map = view.map();
  std::vector<KeyframeId> all;
  map.keyframes().ForEach([&](const auto& keyframe) { all.push_back(keyframe->id); });
  const std::size_t count = std::min(all.size(), static_cast<std::size_t>(options.max_tests));
  Coverage coverage;
  std::vector<double> depths;
  for (std::size_t i = 0; i < count; ++i) {
    const map::Keyframe& keyframe = map.keyframe(all[i * all.size() / count]);
    CAIRN_ASSIGN_OR_RETURN(const auto test, AskForKeyframe(view, map, keyframe.id, options));
    if (test.empty()) continue;
    coverage.tests.push_back(test[0]);
    depths.push_back(MedianDepth(Measure(map, keyframe)) * PlacedScale(map, keyframe.component));
    if (progress && !progress(static_cast<int>(i + 1), static_cast<int>(count))) break;
  }
  coverage.not_tested = static_cast<int>(all.size() - coverage.tests.size());
  coverage.cell_size = options.cell_size > 0.0 ? options.cell_size : Median(depths) / kCellsPerDepth;
  if (!(coverage.cell_size > 0.0)) coverage.cell_size = 1.0;
  FillCells(map, options, &coverage);
  return coverage;
}

}  // namespace cairn::inspect
