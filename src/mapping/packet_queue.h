// Puts the keyframes of the direct module in temporal order. It does not always marginalize its oldest keyframe, so
// packets wait until the next one in time has come; when more than `limit` wait, the next one is asked for although it
// is still active (Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec. V).
//
//   queue.Push(packet);
//   for (;;) {
//     auto next = queue.Pop();
//     if (next) { Process(*next); continue; }
//     if (auto wanted = queue.Wanted()) { ask the odometry; PushActive(packet) or Skip(*wanted); continue; }
//     break;
//   }
#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "base/status.h"
#include "direct/packet.h"

namespace cairn::mapping {

class PacketQueue {
 public:
  explicit PacketQueue(int limit = 5) : limit_(limit) {}

  // A keyframe that has left the window (or is handed over while still active, for the one that is wanted). A keyframe
  // that went out already - it was taken while active - is dropped. AlreadyExists if the same keyframe waits already.
  absl::Status Push(direct::KeyframePacket packet);

  // The next keyframe in time, if it is here.
  std::optional<direct::KeyframePacket> Pop();

  // The keyframe to ask the direct module for: nothing unless more than the limit wait behind it.
  std::optional<std::int64_t> Wanted() const;

  // Gives up waiting for a keyframe (the direct module does not have it: it was dropped with a lost segment).
  void Skip(std::int64_t keyframe);

  // No more will come: what waits goes out in order, whatever is missing between.
  void Flush() { flushing_ = true; }

  int size() const { return static_cast<int>(waiting_.size()); }
  std::int64_t next() const { return next_; }

 private:
  int limit_;
  bool flushing_ = false;
  std::int64_t next_ = 0;
  std::map<std::int64_t, direct::KeyframePacket> waiting_;
};

}  // namespace cairn::mapping
