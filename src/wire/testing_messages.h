// What the tests of conversions share: a pose of odd numbers, and the way of a message through its bytes.
#pragma once

#include <gtest/gtest.h>

#include "geometry/se3.h"

namespace cairn::wire {

inline const SE3 kPose(Quaterniond(0.5, 0.1, -0.3, 0.7), Vector3d(1.0 / 3.0, -2.0, 1e-9));

template <class Message>
Message OverTheWire(const Message& message) {
  Message back;
  EXPECT_TRUE(back.ParseFromString(message.SerializeAsString()));
  return back;
}

}  // namespace cairn::wire
