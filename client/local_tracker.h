// Tracking a camera in this process, in a map that is only read: a file, or one of a server that is followed
// (api/tracker.h, client/view_source.h).
//
// Semi-direct: the first image is found in the map by relocalization, and the direct odometry begins there at once,
// with the depths that the map gives to the points in view. From then on it gives the motion of every frame. Beside it,
// in a thread of its own, a frame is matched against the local map every so often; its result reaches the next call as
// a message and becomes the anchor from which poses are carried on (client/anchor.h). What the paper does with the
// keyframes that leave the odometry's window (Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019,
// Sec. V) is done with plain frames here, as the map gets nothing from them.
//
// Where the map does not reach, the odometry carries on: state carried, with the covariance growing. Matching goes on,
// and, ever more rarely, the whole map is searched. A finding that contradicts what was carried on has to be made
// twice. Where the odometry is lost, too, frames are looked for around the last pose and then in the whole map, and
// believed as a single image is.
//
// A writer is followed beside the calls: the thread that matches reads what has changed and hands over the next view. A
// pose moves with the keyframe it was matched with, also when its component is joined to another one; if that keyframe
// was removed, the camera is lost until it is matched again (which is the next message, as a rule).
//
// Memory: what is kept of the past is bounded (direct::OdometryOptions::keep_history). Odometry and matching see
// undistorted images; the odometry's are photometrically corrected where the calibration is known.
#pragma once

#include <memory>
#include <string>

#include "api/tracker.h"
#include "base/frame_times.h"
#include "client/frame_tracker.h"
#include "client/local_tracker_options.h"
#include "client/view_source.h"
#include "geometry/camera.h"
#include "image/undistort.h"

namespace cairn::client {

class LocalTracker : public api::Tracker {
 public:
  // `camera`: of the raw images; its size, focal length and lens need not be those of the map's. Errors as
  // MapReader::Open; InvalidArgument for a camera or options that make no sense.
  static absl::StatusOr<std::unique_ptr<LocalTracker>> Open(const std::string& path, const Camera& camera,
                                                            const LocalTrackerOptions& options = {});

  // In a map that is open already, and may be shared with others; it need not be a file.
  static absl::StatusOr<std::unique_ptr<LocalTracker>> Open(std::unique_ptr<ViewSource> source, const Camera& camera,
                                                            const LocalTrackerOptions& options = {});

  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override;

  // The map as the last answer saw it.
  const map::Snapshot& snapshot() const { return context_->view->map(); }

 private:
  static absl::Status Check(const Camera& camera, const LocalTrackerOptions& options);
  LocalTracker(image::Undistorter undistorter, std::unique_ptr<TrackerContext> context,
               std::unique_ptr<FrameTracker> tracker)
      : undistorter_(std::move(undistorter)), context_(std::move(context)), tracker_(std::move(tracker)) {}

  absl::StatusOr<api::TrackAnswer> Follow(const api::TrackFrame& frame);
  void Fill(const TrackStep& step, api::TrackAnswer* answer) const;

  const image::Undistorter undistorter_;
  std::unique_ptr<TrackerContext> context_;
  std::unique_ptr<FrameTracker> tracker_;
  FrameTimes times_;
  std::int64_t next_index_ = 0;
};

}  // namespace cairn::client
