// The file of `cairn run --live-poses`: the pose of each frame as soon as it is tracked, in TUM format, with a comment
// line wherever the frame of the poses changes. What cannot be written ends these poses, not the run.
#pragma once

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>

#include "base/status.h"
#include "base/time.h"
#include "engine/live_poses.h"

namespace cairn::cli {

class LivePoseFile {
 public:
  // Nothing is written if `path` is empty.
  explicit LivePoseFile(const std::string& path);

  void Write(TimeNs time_ns, const engine::LivePose& pose);
  // Poses written; none without a file.
  std::optional<std::int64_t> count() const { return path_.empty() ? std::nullopt : std::optional(count_); }
  const absl::Status& status() const { return status_; }

 private:
  void Fail();

  const std::string path_;
  std::ofstream file_;
  std::int64_t count_ = 0;
  ComponentId component_;
  bool in_world_ = false;
  absl::Status status_;
};

}  // namespace cairn::cli
