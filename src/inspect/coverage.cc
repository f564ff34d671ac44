#include "inspect/coverage.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <unordered_set>

#include "absl/strings/str_format.h"
#include "inspect/coverage_ground.h"
#include "inspect/measures.h"
#include "map/edit.h"

namespace cairn::inspect {
namespace {

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

void Warn(const CoverageOptions& options, Coverage* coverage) {
  for (const CoverageGround& ground : coverage->grounds) {
    for (const CoverageCell& cell : ground.cells) {
      if (cell.tests < options.min_tests || cell.share() >= options.min_share) continue;
      coverage->warnings.push_back(
          absl::StrFormat("around %.2f %.2f %.2f%s, component %u: %d of %d views are found without their own "
                          "keyframe: map more there",
                          cell.center.x(), cell.center.y(), cell.center.z(), ground.in_world ? " m" : "",
                          cell.component.value(), cell.found, cell.tests));
    }
  }
  const auto wrong = std::ranges::count(coverage->tests, CoverageResult::kWrongPlace, &CoverageTest::result);
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
  const double median_depth = MedianDepth(Measure(map, keyframe));
  test.depth = median_depth * PlacedScale(map, keyframe.component);
  CAIRN_ASSIGN_OR_RETURN(const auto delta, Without(view.snapshot(), keyframe, options.same_view_share, &test.left_out));
  std::vector<CoverageTest> tests;
  if (!delta) return tests;
  CAIRN_ASSIGN_OR_RETURN(const auto rest, view.After(*delta));
  const tracking::Relocalizer relocalizer(options.relocalizer);
  const auto features = keyframe.features.Get();
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
  for (std::size_t i = 0; i < count; ++i) {
    CAIRN_ASSIGN_OR_RETURN(const auto test, AskForKeyframe(view, map, all[i * all.size() / count], options));
    if (test.empty()) continue;
    coverage.tests.push_back(test[0]);
    if (progress && !progress(static_cast<int>(i + 1), static_cast<int>(count))) break;
  }
  coverage.not_tested = static_cast<int>(all.size() - coverage.tests.size());
  coverage.grounds = GroundsOf(map, coverage.tests, options.cell_size);
  int found = 0;
  for (const CoverageGround& ground : coverage.grounds) found += ground.found;
  if (!coverage.tests.empty()) coverage.share = 1.0 * found / static_cast<double>(coverage.tests.size());
  Warn(options, &coverage);
  return coverage;
}

}  // namespace cairn::inspect
