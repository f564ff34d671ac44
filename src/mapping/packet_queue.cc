#include "mapping/packet_queue.h"

#include <utility>

namespace cairn::mapping {

absl::Status PacketQueue::Push(direct::KeyframePacket packet) {
  const std::int64_t keyframe = packet.keyframe;
  if (keyframe < next_) return absl::OkStatus();
  if (!waiting_.try_emplace(keyframe, std::move(packet)).second) {
    return absl::AlreadyExistsError(absl::StrCat("direct keyframe ", keyframe, " waits in the queue already"));
  }
  return absl::OkStatus();
}

std::optional<direct::KeyframePacket> PacketQueue::Pop() {
  if (waiting_.empty()) return std::nullopt;
  const auto first = waiting_.begin();
  if (first->first != next_ && !flushing_) return std::nullopt;
  std::optional<direct::KeyframePacket> packet(std::move(first->second));
  next_ = first->first + 1;
  waiting_.erase(first);
  return packet;
}

std::optional<std::int64_t> PacketQueue::Wanted() const {
  if (flushing_ || size() <= limit_ || waiting_.begin()->first == next_) return std::nullopt;
  return next_;
}

void PacketQueue::Skip(std::int64_t keyframe) {
  if (keyframe == next_) ++next_;
}

}  // namespace cairn::mapping
