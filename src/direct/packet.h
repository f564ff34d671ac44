// What passes between the direct module and others. What leaves it: the pose of every frame, and a packet for every
// keyframe that has left its window. Frame "direct" is the odometry's own world: metric up to one unknown, slowly
// drifting scale.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/time.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct {

// One undistorted image, as both modules see it.
struct Frame {
  std::int64_t index = 0;  // position in the sequence
  TimeNs time_ns = 0;
  cv::Mat image;  // CV_8UC1, undistorted, photometrically uncorrected, full resolution
  // CV_32FC1, same size, free of response and vignette (image/photometric.h), in gray levels; empty: no calibration,
  // `image` is used.
  cv::Mat corrected;
  // Of `corrected`: the factor that this frame's exposure time put on it, up to one common to all frames. 0: unknown.
  double exposure_gain = 0.0;
};

// A point of the direct map as seen in the packet's keyframe.
struct PacketPoint {
  float x_px = 0.0f;  // full-resolution pixels
  float y_px = 0.0f;
  float inverse_depth = 0.0f;  // 1 / z in the keyframe, in units of the direct world
  float variance = 0.0f;       // of inverse_depth
};

// A keyframe whose pose the direct module no longer changes (or, if `still_active`, its best estimate so far).
struct KeyframePacket {
  std::int64_t keyframe = 0;  // counts the direct keyframes from 0, in temporal order
  std::int64_t segment = 0;   // counts the starts of the odometry; poses of two segments share no frame
  Frame frame;
  SE3 direct_from_camera;
  std::vector<PacketPoint> points;  // active and marginalized points inside the image
  double keyframe_rate_hz = 0.0;    // how often keyframes were made lately
  bool still_active = false;
};

// A frame that somebody else knows: where a lost odometry goes on (Odometry::GoOnFrom).
struct KnownView {
  std::int64_t frame_index = 0;
  std::vector<PacketPoint> points;  // in that frame; inverse depths in any one unit, variances are not used
};

enum class TrackingState { kInitializing, kGood, kPoor, kLost };

// The answer to one frame. The pose is relative to a keyframe so that it follows every later correction of it.
struct FrameResult {
  std::int64_t index = 0;
  TimeNs time_ns = 0;
  TrackingState state = TrackingState::kInitializing;
  std::int64_t keyframe = -1;  // the reference keyframe; -1 while there is none
  std::int64_t segment = -1;   // likewise: of direct_from_camera
  SE3 keyframe_from_camera;
  SE3 direct_from_camera;  // the live estimate
  // 0 (lost) to 1: share of the reference's points that match well, over 1 + s^2, where s is the uncertainty in pixels
  // that the image leaves in the weakest direction of the motion.
  double quality = 0.0;
  std::string message;  // while not tracking: what it waits for
};

}  // namespace cairn::direct
