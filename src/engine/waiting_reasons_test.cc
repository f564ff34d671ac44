#include "engine/waiting_reasons.h"

#include <gtest/gtest.h>

namespace cairn::engine {
namespace {

TEST(WaitingReasons, TheMostFrequentOnesInTheirLastWords) {
  WaitingReasons reasons;
  EXPECT_TRUE(reasons.empty());
  EXPECT_EQ(reasons.Describe(), "");
  reasons.Add("");
  EXPECT_TRUE(reasons.empty());
  for (int i = 0; i < 5; ++i) reasons.Add("lost the corners: " + std::to_string(i) + " of 50 are left");
  EXPECT_EQ(reasons.Describe(), "lost the corners: 4 of 50 are left");
  reasons.Add("not moved enough: 0.25 deg");
  EXPECT_EQ(reasons.Describe(),
            "lost the corners: 4 of 50 are left (5 frames); also not moved enough: 0.25 deg (1 frame)");
  for (int i = 0; i < 100; ++i) reasons.Add(std::string(static_cast<std::size_t>(i + 1), 'x'));
  EXPECT_EQ(reasons.Describe().substr(0, 16), "lost the corners");
}

}  // namespace
}  // namespace cairn::engine
