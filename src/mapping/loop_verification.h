// Whether a candidate really is a loop: the similarity between the two keyframes from their points, checked against the
// neighbours of both and against what odometry can have drifted (Mur-Artal, Montiel, Tardos, "ORB-SLAM", T-RO 2015,
// Sec. VII-B). Everything before anything moves.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "map/snapshot.h"
#include "mapping/loop_options.h"

namespace cairn::mapping {

struct LoopMatch {
  std::uint32_t feature = 0;  // of the current keyframe
  PointId point;              // of the loop's side
};

struct Loop {
  KeyframeId current;
  KeyframeId loop;
  // From the loop keyframe's camera frame, in the unit of the map there, to the current one's, in the unit of the map
  // here: its scale is the drift.
  Sim3 current_from_loop;
  std::vector<LoopMatch> matches;
  std::vector<KeyframeId> loop_side;  // the loop keyframe and those covisible with it
};

// What was found of a candidate, up to where it failed.
struct LoopEvidence {
  KeyframeId candidate;
  std::string rejected;        // why; empty: it is a loop
  int descriptor_matches = 0;  // with points on both sides
  int sim3_inliers = 0;
  int guided_matches = 0;
  int cells = 0;
  double share_here = 0.0;     // of what the current side should see of the loop's; only where nothing links them ...
  double share_there = 0.0;    // ... and the other way round
  int neighbours_checked = 0;  // both sides together
  int neighbours_agreeing = 0;
  double scale = 1.0;
  double shift = 0.0;        // of the current camera by the correction, map units
  double path_length = 0.0;  // along the spanning tree, map units; 0 if it crosses a restart
  double turn_rad = 0.0;
};

// Whether keyframes of two components see the same place: as strict, but for the drift, which says nothing there. The
// similarity is sought in `matches`, features of the current keyframe that see points of the candidate's component.
std::optional<Loop> VerifyOverlap(const map::Snapshot& map, KeyframeId current, KeyframeId candidate,
                                  const std::vector<LoopMatch>& matches, const LoopOptions& options,
                                  LoopEvidence* evidence);

std::optional<Loop> VerifyLoop(const map::Snapshot& map, KeyframeId current, KeyframeId candidate,
                               const LoopOptions& options, LoopEvidence* evidence);

// Length of the way from camera to camera along the spanning tree. Nothing if the keyframes are of different trees, or
// the way crosses a link without shared points: a restart after a loss, where nothing is known.
std::optional<double> PathLength(const map::Snapshot& map, KeyframeId a, KeyframeId b);

}  // namespace cairn::mapping
