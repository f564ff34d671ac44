// Joins components of a map that turn out to overlap: a session that began without knowing where it was, and now sees
// what an earlier one has mapped. Each new keyframe is looked for in the other components; when several of them are
// found there, agree on one similarity, and the neighbours of both sides come to it by themselves - as strict as a loop
// (mapping/loop_verification.h) -, the younger component is moved into the frame of the older, points of both sides
// become one, and the seam is adjusted: one change. What contradicts that is no join: a camera that is not as it was
// calibrated, or two components whose places in the world are known, and are not the same.
//
// Owns no threads; call it from the mapping thread, while the head is the caller's. Deterministic.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "mapping/lens_refinement.h"
#include "mapping/loop_options.h"
#include "mapping/loop_verification.h"
#include "mapping/map_head.h"
#include "tracking/relocalizer.h"

namespace cairn::mapping {

struct JoinOptions {
  LoopOptions overlap;         // of the similarity between two keyframes and of its neighbours
  LensRefinementOptions lens;  // how far a camera may be from its calibration ...
  // ... as points tell that others have mapped: they leave less open than a session's own, the prior holds little.
  double log_focal_sigma = 0.05;

  int remembered = 8;       // keyframes looked for lately, whose findings count
  int min_sightings = 3;    // of these, found in the other component where the similarity puts them ...
  double min_share = 0.75;  // ... and of all that were found there
  // Sightings in a third component that are as many as this share of those in the best: which place it is, is open.
  double max_rival_share = 0.5;

  // The seam: keyframes of the component that moves, nearest the seam along the graph, that are adjusted to the
  // other's.
  int max_seam_keyframes = 60;
  int seam_iterations = 10;
  int max_verified = 3;  // of what is remembered: a keyframe that was found earlier may have the better matches by now

  absl::Status Validate() const;
};

// Between two alignments of what is one place.
struct WorldGap {
  double shift = 0.0;
  double turn_deg = 0.0;
};

// JoinReport::rejected where the camera of the keyframes does not fit what they see in the other component.
inline constexpr char kCalibrationRefused[] = "the camera does not see there what its calibration says: calibrate it";

struct JoinReport {
  KeyframeId current;
  bool searched = false;  // false: there is no other component
  bool seen = false;      // the keyframe was found in another component
  ComponentId seen_in;    // if seen
  bool joined = false;
  ComponentId component;             // if joined: that is gone ...
  ComponentId into;                  // ... and that it is part of now
  std::string rejected;              // if seen, but not joined: what was missing
  bool calibration_doubted = false;  // the keyframe fits the other component with another calibration than its own
  LoopEvidence evidence;             // if verified
  int sightings_agreeing = 0;
  int sightings_checked = 0;
  int fused_points = 0;
  double scale = 1.0;  // by which lengths of the component that moved have grown
  // If both were aligned to the world: how far apart their alignments put the camera, in the unit of the world. The one
  // of `into` stays, the other gives way.
  std::optional<WorldGap> gap;
  double search_ms = 0.0;
  double verify_ms = 0.0;
  double join_ms = 0.0;
};

class ComponentJoiner {
 public:
  // InvalidArgument for bad options.
  static absl::StatusOr<ComponentJoiner> Create(const JoinOptions& options = {});

  // To be called for each keyframe inserted, newest last; what it was found at is remembered. `wall_clock_ns`: 0 in
  // deterministic runs. FailedPrecondition without a vocabulary, NotFound if the map does not have the keyframe.
  absl::StatusOr<JoinReport> Process(KeyframeId keyframe, std::int64_t wall_clock_ns, MapHead& head);

 private:
  // Where a keyframe was found.
  struct Sighting {
    bool calibration_doubted = false;  // JoinReport::calibration_doubted
    KeyframeId keyframe;
    ComponentId own, other;     // none: it was not found
    SE3 camera_from_other;      // frame of the other component
    KeyframeId reference;       // of the other component, that sees most of the same
    double median_depth = 1.0;  // of what it sees, frame of the other component
    std::vector<LoopMatch> matches;
  };
  class Join;

  explicit ComponentJoiner(const JoinOptions& options);

  std::vector<const Sighting*> BestSightings(const map::Snapshot& map, const Sighting& newest) const;
  absl::StatusOr<Sighting> Look(const tracking::MapView& view, const map::Keyframe& keyframe) const;
  bool AlignmentsAgree(const map::Snapshot& map, const Loop& overlap, JoinReport* report) const;
  bool CameraFits(const map::Snapshot& map, const Sighting& newest, JoinReport* report) const;
  bool IsRivalled(const Sighting& sighting) const;
  bool SightingsAgree(const map::Snapshot& map, const Sighting& sighting, const Loop& overlap,
                      JoinReport* report) const;

  JoinOptions options_;
  tracking::Relocalizer relocalizer_;
  std::deque<Sighting> sightings_;
};

}  // namespace cairn::mapping
