#include "cli/live_pose_file.h"

#include <cerrno>
#include <cstring>

#include "io/trajectory.h"

namespace cairn::cli {

LivePoseFile::LivePoseFile(const std::string& path) : path_(path) {
  if (path_.empty()) return;
  errno = 0;
  file_.open(path_);
  if (!file_) Fail();
}

void LivePoseFile::Write(TimeNs time_ns, const engine::LivePose& pose) {
  if (path_.empty() || !status_.ok()) return;
  const bool in_world = pose.world_from_component.has_value();
  if (pose.component != component_ || in_world != in_world_) {
    file_ << "# component " << pose.component.value() << ", "
          << (in_world ? "world_from_camera, metres" : "map_from_camera, in the frame and unit of the component")
          << ", from here on\n";
    component_ = pose.component;
    in_world_ = in_world;
  }
  file_ << io::FormatTumLine({time_ns, pose.WorldFromCamera()}) << std::flush;
  if (!file_) return Fail();
  ++count_;
}

void LivePoseFile::Fail() {
  status_ = absl::UnavailableError(
      absl::StrCat("the live poses could not all be written to ", path_, ": ", std::strerror(errno)));
}

}  // namespace cairn::cli
