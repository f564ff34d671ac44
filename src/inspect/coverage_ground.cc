#include "inspect/coverage_ground.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace cairn::inspect {
namespace {

constexpr double kCellsPerDepth = 4.0;

using Tests = std::vector<const CoverageTest*>;

double MedianDepthOf(const Tests& tests) {
  std::vector<double> depths;
  for (const CoverageTest* test : tests) depths.push_back(test->depth);
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

// Against gravity as far as cameras tell: the mean of their own "up".
Vector3d MeanUp(const Tests& tests) {
  Vector3d up = Vector3d::Zero();
  for (const CoverageTest* test : tests) up -= test->placed_from_camera.RotationMatrix().col(1);
  return up.norm() > 1e-6 ? up.normalized() : Vector3d::UnitZ();
}

std::string AxisName(const Vector3d& direction) {
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  return absl::StrCat(direction[axis] < 0.0 ? "-" : "", absl::string_view("xyz").substr(axis, 1));
}

// The world's axes, if upwards is nearly one of them.
bool TakeWorldAxes(const Vector3d& up, CoverageGround* ground) {
  constexpr double kNear = 0.94;  // 20 degrees: cameras look down a little more often than up
  Eigen::Index axis = 0;
  if (up.cwiseAbs().maxCoeff(&axis) < kNear) return false;
  ground->right = Vector3d::Unit(axis == 0 ? 1 : 0);
  ground->ahead = Vector3d(std::copysign(1.0, up[axis]) * Vector3d::Unit(axis)).cross(ground->right);
  ground->right_name = AxisName(ground->right);
  ground->ahead_name = AxisName(ground->ahead);
  return true;
}

// The largest extent on the ground runs to the right.
void TakeLargestExtent(const Tests& tests, const Vector3d& up, CoverageGround* ground) {
  Vector3d mean = Vector3d::Zero();
  for (const CoverageTest* test : tests) mean += test->placed_from_camera.translation();
  mean /= static_cast<double>(tests.size());
  Matrix3d spread = Matrix3d::Zero();
  for (const CoverageTest* test : tests) {
    Vector3d offset = test->placed_from_camera.translation() - mean;
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
  ground->right = right;
  ground->ahead = up.cross(right);
}

void FillCells(const Tests& tests, CoverageGround* ground) {
  const Vector3d up = ground->right.cross(ground->ahead);
  std::map<std::tuple<ComponentId, int, int>, CoverageCell> cells;
  for (const CoverageTest* test : tests) {
    const Vector3d& camera = test->placed_from_camera.translation();
    CoverageCell at = ground->CellOf(camera);
    at.component = test->component;
    CoverageCell& cell = cells.try_emplace({test->component, at.y, at.x}, at).first->second;
    const int found = test->result == CoverageResult::kFound ? 1 : 0;
    ++cell.tests;
    cell.found += found;
    cell.center += up * up.dot(camera);
    ++ground->tests;
    ground->found += found;
  }
  for (auto& [key, cell] : cells) {
    cell.center /= cell.tests;
    cell.center += ground->cell_size * ((cell.x + 0.5) * ground->right + (cell.y + 0.5) * ground->ahead);
    ground->cells.push_back(cell);
    if (!ground->Holds(cell.component)) ground->components.push_back(cell.component);
  }
}

CoverageGround GroundOf(const Tests& tests, bool in_world, double cell_size) {
  CoverageGround ground;
  ground.in_world = in_world;
  ground.cell_size = cell_size > 0.0 ? cell_size : MedianDepthOf(tests) / kCellsPerDepth;
  if (!(ground.cell_size > 0.0)) ground.cell_size = 1.0;
  const Vector3d up = MeanUp(tests);
  if (!in_world || !TakeWorldAxes(up, &ground)) TakeLargestExtent(tests, up, &ground);
  FillCells(tests, &ground);
  return ground;
}

}  // namespace

bool CoverageGround::Holds(ComponentId component) const {
  return std::ranges::find(components, component) != components.end();
}

CoverageCell CoverageGround::CellOf(const Vector3d& placed) const {
  CoverageCell cell;
  cell.x = static_cast<int>(std::floor(right.dot(placed) / cell_size));
  cell.y = static_cast<int>(std::floor(ahead.dot(placed) / cell_size));
  return cell;
}

std::vector<CoverageGround> GroundsOf(const map::Snapshot& map, const std::vector<CoverageTest>& tests,
                                      double cell_size) {
  std::map<ComponentId, Tests> frames;  // by component; that without an id: the world's
  for (const CoverageTest& test : tests) {
    frames[map.WorldFrom(test.component) ? ComponentId() : test.component].push_back(&test);
  }
  std::vector<CoverageGround> grounds;
  for (const auto& [component, of_frame] : frames) grounds.push_back(GroundOf(of_frame, !component, cell_size));
  std::ranges::stable_sort(grounds, [](const CoverageGround& a, const CoverageGround& b) {
    return a.in_world != b.in_world ? a.in_world : a.tests > b.tests;
  });
  return grounds;
}

}  // namespace cairn::inspect
