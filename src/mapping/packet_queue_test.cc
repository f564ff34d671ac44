#include "mapping/packet_queue.h"

#include <gtest/gtest.h>

#include <vector>

namespace cairn::mapping {
namespace {

direct::KeyframePacket Packet(std::int64_t keyframe, bool active = false) {
  direct::KeyframePacket packet;
  packet.keyframe = keyframe;
  packet.still_active = active;
  return packet;
}

std::vector<std::int64_t> Drain(PacketQueue& queue) {
  std::vector<std::int64_t> order;
  while (auto packet = queue.Pop()) order.push_back(packet->keyframe);
  return order;
}

TEST(PacketQueue, WaitsForTheNextInTime) {
  PacketQueue queue;
  ASSERT_TRUE(queue.Push(Packet(1)).ok());
  ASSERT_TRUE(queue.Push(Packet(2)).ok());
  EXPECT_TRUE(Drain(queue).empty());
  EXPECT_FALSE(queue.Wanted());
  ASSERT_TRUE(queue.Push(Packet(0)).ok());
  EXPECT_EQ(Drain(queue), (std::vector<std::int64_t>{0, 1, 2}));
}

TEST(PacketQueue, AsksForTheActiveKeyframePastTheLimit) {
  PacketQueue queue(5);
  ASSERT_TRUE(queue.Push(Packet(0)).ok());
  EXPECT_EQ(Drain(queue).size(), 1u);
  for (int k = 2; k <= 6; ++k) ASSERT_TRUE(queue.Push(Packet(k)).ok());
  EXPECT_FALSE(queue.Wanted()) << "five may wait";
  ASSERT_TRUE(queue.Push(Packet(7)).ok());
  ASSERT_TRUE(queue.Wanted());
  EXPECT_EQ(*queue.Wanted(), 1);
  ASSERT_TRUE(queue.Push(Packet(1, true)).ok());
  EXPECT_FALSE(queue.Wanted());
  EXPECT_EQ(Drain(queue), (std::vector<std::int64_t>{1, 2, 3, 4, 5, 6, 7}));
  ASSERT_TRUE(queue.Push(Packet(1)).ok()) << "its final packet comes late and is dropped";
  EXPECT_EQ(queue.size(), 0);
}

TEST(PacketQueue, SkipsWhatTheDirectModuleDoesNotHave) {
  PacketQueue queue(1);
  ASSERT_TRUE(queue.Push(Packet(1)).ok());
  ASSERT_TRUE(queue.Push(Packet(2)).ok());
  ASSERT_EQ(queue.Wanted(), std::int64_t{0});
  queue.Skip(5);
  EXPECT_EQ(queue.next(), 0) << "only the next one can be skipped";
  queue.Skip(0);
  EXPECT_EQ(Drain(queue), (std::vector<std::int64_t>{1, 2}));
}

TEST(PacketQueue, FlushLetsEverythingGo) {
  PacketQueue queue;
  for (const int k : {3, 1, 7}) ASSERT_TRUE(queue.Push(Packet(k)).ok());
  EXPECT_EQ(queue.Push(Packet(3)).code(), absl::StatusCode::kAlreadyExists);
  queue.Flush();
  EXPECT_EQ(Drain(queue), (std::vector<std::int64_t>{1, 3, 7}));
}

}  // namespace
}  // namespace cairn::mapping
