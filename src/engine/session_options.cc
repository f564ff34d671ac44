#include "engine/session_options.h"

namespace cairn::engine {

absl::Status SessionOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(odometry.Validate());
  CAIRN_RETURN_IF_ERROR(mapping.Validate());
  CAIRN_RETURN_IF_ERROR(loops.Validate());
  CAIRN_RETURN_IF_ERROR(joins.Validate());
  CAIRN_RETURN_IF_ERROR(collinearity.Validate());
  CAIRN_RETURN_IF_ERROR(memory.Validate());
  if (threads < 1) return absl::InvalidArgumentError("threads must be at least 1");
  if (packet_queue_limit < 1) return absl::InvalidArgumentError("packet_queue_limit must be at least 1");
  if (seek_after_frames < 0) return absl::InvalidArgumentError("seek_after_frames must not be negative");
  if (mapping_backlog < 1) return absl::InvalidArgumentError("mapping_backlog must be at least 1");
  return absl::OkStatus();
}

}  // namespace cairn::engine
