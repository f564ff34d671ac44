// From the odometry to the feature module: gives on every keyframe in temporal order, as soon as its turn has come,
// also one that is still active while younger ones have left the window (mapping/packet_queue.h).
#pragma once

#include <functional>
#include <utility>

#include "base/status.h"
#include "direct/odometry.h"
#include "mapping/packet_queue.h"

namespace cairn::engine {

// In the thread that maps for the odometry.
class PacketHandOver {
 public:
  using GiveOn = std::function<absl::Status(direct::KeyframePacket)>;

  // `limit`: keyframes waiting for an older one. `give_on` may wait while the feature module is too far behind.
  PacketHandOver(int limit, GiveOn give_on) : queue_(limit), give_on_(std::move(give_on)) {}

  // After each mapped frame.
  absl::Status Take(direct::Odometry& odometry);
  // At the end of the stream: all that is left.
  absl::Status Finish();

 private:
  absl::Status GiveOnAll();

  mapping::PacketQueue queue_;
  const GiveOn give_on_;
};

}  // namespace cairn::engine
