// Files of camera poses. A pose is world_from_camera: the camera's position and orientation in the world.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/time.h"
#include "geometry/stamped_pose.h"
#include "io/time_text.h"

namespace cairn::io {

using cairn::StampedPose;

enum class TrajectoryFormat : std::uint8_t { kTum, kEuroc, kKitti };

// What a file holds: poses in the order of the file, which need not be that of time. Rows that hold NaN (no ground
// truth at that time) carry no pose but are counted, because protocols split files by row.
struct Trajectory {
  std::vector<StampedPose> poses;
  std::vector<std::int64_t> rows;  // of each pose: its place among all data rows, from 0
  std::int64_t num_rows = 0;       // with and without a pose
  TrajectoryFormat format = TrajectoryFormat::kTum;
  TimeUnit time_unit = TimeUnit::kSeconds;  // of the file
  bool counts_frames = false;  // perhaps: the times are whole numbers one apart, and were taken for seconds
  // What was understood that is not as usual, for people, each with the file's name: "x.csv: the times are ...".
  std::vector<std::string> notes;

  std::int64_t num_nan_rows() const { return num_rows - static_cast<std::int64_t>(poses.size()); }
};

// TUM format `t tx ty tz qx qy qz qw` in seconds and metres; further columns are ignored, `#` starts a comment line,
// columns are separated by blanks, commas or semicolons. Errors name file and line.
//
// EuRoC ground truth `ns, x, y, z, qw, qx, qy, qz, ...`. The pose is that of the body, not of a camera.
//
// KITTI poses, 12 numbers a line: the upper three rows of world_from_camera; or 16, all of it; times from times.txt
// beside the file, one a line, or from a first column.
//
// Any of these is told from the others by all that the file says (trajectory_layout.h). A file without any pose is an
// error unless it `may_be_empty`.
absl::StatusOr<Trajectory> ReadTrajectory(const std::string& path, bool may_be_empty = false);

struct TrajectoryWriteOptions {
  bool overwrite = false;  // AlreadyExists otherwise
  std::string comment;     // a first line, written behind "# "; empty: none
};

// TUM format, nine decimals. Written beside and renamed: readers never see half a file.
absl::Status WriteTumTrajectory(const std::string& path, const std::vector<StampedPose>& poses,
                                const TrajectoryWriteOptions& options = {});

// A coordinate, or a part of a quaternion, as files of poses have it: nine digits, and no zero with a sign.
std::string FormatPoseNumber(double number);

// One line of it, with its end.
std::string FormatTumLine(const StampedPose& pose);

// The same text, without a file.
std::string FormatTumTrajectory(const std::vector<StampedPose>& poses, const std::string& comment = "");

}  // namespace cairn::io
