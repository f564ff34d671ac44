// A short recording of a small synthetic world, for the tests of sessions.
#pragma once

#include <cmath>
#include <vector>

#include "direct/testing_scene.h"
#include "engine/frame_preparation.h"
#include "engine/session_record.h"

namespace cairn::engine::testing {

inline SessionSource SwaySource() {
  SessionSource source;
  source.name = "sway";
  source.camera = Camera::FromPinhole(direct::testing::TestCamera());
  return source;
}

// A handheld sway of `count` frames, at most 40. Rendered once for all tests.
inline std::vector<RawFrame> Sway(int count) {
  static const std::vector<RawFrame> frames = [] {
    const direct::testing::Scene scene;
    std::vector<RawFrame> all;
    for (int i = 0; i < 40; ++i) {
      const direct::Frame frame = scene.Render(direct::testing::TestCamera(), direct::testing::SwayPose(i), i);
      all.push_back({frame.index, frame.time_ns, frame.image, 0.0});
    }
    return all;
  }();
  return {frames.begin(), frames.begin() + count};
}

// A camera that does not move.
inline std::vector<RawFrame> Still(int count) {
  std::vector<RawFrame> frames;
  for (int i = 0; i < count; ++i) frames.push_back({i, i * 33'333'333, Sway(1).front().gray, 0.0});
  return frames;
}

}  // namespace cairn::engine::testing
