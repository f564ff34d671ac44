// Another calibration with which the matches of an image agree better than with the one that it came with.
//
// With a focal length that is far off only those matches agree on a pose that lie near each other, in the image or in
// depth, and these say little of it: they are what a wrong calibration fits. So all matches are asked, from several
// focal lengths on.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/pose_refinement.h"
#include "tracking/pnp_ransac.h"

namespace cairn::tracking {

struct OtherCalibration {
  Pinhole pinhole;
  SE3 camera_from_map;
  std::vector<std::uint8_t> inlier;  // per match
  int num_inliers = 0;
};

// How many matches agree with a pose, as PnpOptions counts.
int CountInliers(const Pinhole& pinhole, const SE3& camera_from_map,
                 std::span<const optimization::PoseObservation> matches, std::vector<std::uint8_t>* inlier = nullptr);

// From a pose that was found with the calibration as it is: the one with most inliers, if there is one.
std::optional<OtherCalibration> SearchCalibration(const Pinhole& pinhole, const SE3& camera_from_map,
                                                  std::span<const optimization::PoseObservation> matches);

// Where no pose was found with it. The focal lengths that are tried are those of lenses that are taken for one another,
// from less than half to more than twice.
std::optional<OtherCalibration> SearchCalibration(const Pinhole& pinhole,
                                                  std::span<const optimization::PoseObservation> matches,
                                                  const PnpOptions& options);

// Whether so many more agree that it is no chance: of three more parameters, and of some starts.
bool ManyMore(int with_another, int as_calibrated);

}  // namespace cairn::tracking
