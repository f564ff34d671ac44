#include "engine/packet_hand_over.h"

#include <cstdint>
#include <optional>

namespace cairn::engine {

absl::Status PacketHandOver::Take(direct::Odometry& odometry) {
  for (direct::KeyframePacket& packet : odometry.TakePackets()) {
    CAIRN_RETURN_IF_ERROR(queue_.Push(std::move(packet)));
  }
  for (;;) {
    CAIRN_RETURN_IF_ERROR(GiveOnAll());
    const std::optional<std::int64_t> wanted = queue_.Wanted();
    if (!wanted) return absl::OkStatus();
    absl::StatusOr<direct::KeyframePacket> active = odometry.PacketOf(*wanted);
    if (active.ok()) {
      CAIRN_RETURN_IF_ERROR(queue_.Push(*std::move(active)));
    } else {
      queue_.Skip(*wanted);
    }
  }
}

absl::Status PacketHandOver::Finish() {
  queue_.Flush();
  return GiveOnAll();
}

absl::Status PacketHandOver::GiveOnAll() {
  while (std::optional<direct::KeyframePacket> packet = queue_.Pop()) {
    CAIRN_RETURN_IF_ERROR(give_on_(*std::move(packet)));
  }
  return absl::OkStatus();
}

}  // namespace cairn::engine
