// How likely an image is to be found in a map, by where it was taken: each keyframe is taken out of the map, together
// with those that share nearly everything with it, and its own features are looked for in what is left. Where that
// fails, the map hangs on single views: a camera that comes by a little aside will not be found.
//
// A map with a keyframe less is made by map::Edit, and its place index from the change between (tracking::MapView), so
// that a test costs what a localization does, whatever the size of the map.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "tracking/map_view.h"
#include "tracking/relocalizer.h"

namespace cairn::inspect {

struct CoverageOptions {
  int max_tests = 1000;  // keyframes tried, spread evenly over all
  // A neighbour that shares so much of the keyframe's points is taken out with it.
  double same_view_share = 0.7;
  // A pose so near to the keyframe's is right: share of the median depth of its points, degrees.
  double max_shift_share = 0.1;
  double max_turn_deg = 5.0;
  // Side of the cells of a ground plane, in the unit of Placed(); 0: the median depth of its tested keyframes over 4.
  double cell_size = 0.0;
  double min_share = 0.5;  // cells below are warned of ...
  int min_tests = 2;       // ... if so many keyframes were tried there
  tracking::RelocalizerOptions relocalizer;

  absl::Status Validate() const;
};

enum class CoverageResult { kFound, kWrongPlace, kMissed };

struct CoverageTest {
  KeyframeId keyframe;
  ComponentId component;
  SE3 placed_from_camera;  // PlacedPose (measures.h)
  double depth = 0.0;      // median of the keyframe's points, in the unit of Placed()
  int left_out = 0;        // other keyframes taken out with it
  CoverageResult result = CoverageResult::kMissed;
  tracking::RelocalizationStage stage = tracking::RelocalizationStage::kFeatures;  // of a miss
  int inliers = 0;
};

struct CoverageCell {
  ComponentId component;
  int x = 0, y = 0;  // [x, x + 1) times cell_size along the ground's axes
  int tests = 0;
  int found = 0;
  Vector3d center = Vector3d::Zero();  // in the frame of Placed(), as high as its tests on average
  double share() const { return tests > 0 ? 1.0 * found / tests : 0.0; }
};

// What lies in one frame: all aligned components, in the world and in metres, or one that is not, in its map units.
struct CoverageGround {
  std::vector<ComponentId> components;  // of which there are tests, ascending
  bool in_world = false;
  std::vector<CoverageCell> cells;  // ascending by component, y, x
  double cell_size = 0.0;           // in the unit of Placed()
  // Directions of the ground plane. In the world, if upwards is about one of its axes, those are the other two, and
  // named so; else two of the axes in which the cameras spread most.
  Vector3d right = Vector3d::UnitX(), ahead = Vector3d::UnitY();
  std::string right_name, ahead_name;  // "x", "-z"; empty if it is none of the world's axes
  int tests = 0;
  int found = 0;

  bool Holds(ComponentId component) const;
  // The cell of a position, without what is known of it.
  CoverageCell CellOf(const Vector3d& placed) const;
};

struct Coverage {
  std::vector<CoverageTest> tests;      // ascending by keyframe
  std::vector<CoverageGround> grounds;  // the world's first, then those with most tests
  int not_tested = 0;  // roots of spanning trees, which cannot be taken out, and what max_tests leaves out
  double share = 0.0;  // of the tests: found
  std::vector<std::string> warnings;
};

// A part of an image, in shares of its width and height: what a camera with a narrower view would have seen.
struct ViewPart {
  double left = 0.0, top = 0.0, right = 1.0, bottom = 1.0;
};

// Whether these parts of the image of keyframe `asked` of `map` are found in `view`, a later state of that map or the
// map itself, each by itself and without the keyframe and those that see the same; what is far, near and right is as it
// stands in `map`. None if the keyframe is the root of a tree in `view`, and so cannot be taken out.
// FailedPrecondition: the map has no vocabulary.
absl::StatusOr<std::vector<CoverageTest>> AskForKeyframe(const tracking::MapView& view, const map::Snapshot& map,
                                                         KeyframeId asked, const CoverageOptions& options,
                                                         const std::vector<ViewPart>& parts = {ViewPart()});

// `progress` is told after each test how many are done, of how many; false ends it early with what there is. May be
// empty. FailedPrecondition: the map has no vocabulary.
absl::StatusOr<Coverage> MeasureCoverage(const tracking::MapView& view, const CoverageOptions& options = {},
                                         const std::function<bool(int, int)>& progress = {});

}  // namespace cairn::inspect
