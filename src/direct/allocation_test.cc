// What the odometry allocates per frame once it runs. Counts every call of malloc of this program (operator new, Eigen
// and OpenCV end there or in the aligned variants) while asked to.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>

#include "direct/odometry.h"
#include "direct/testing_scene.h"

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CAIRN_COUNTS_ALLOCATIONS 1

namespace {
std::atomic<bool> counting = false;
std::atomic<int> allocations = 0;
void Count() {
  if (counting.load(std::memory_order_relaxed)) allocations.fetch_add(1, std::memory_order_relaxed);
}
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t size);                       // NOLINT: glibc's own
void* __libc_memalign(std::size_t align, std::size_t size);  // NOLINT
void* malloc(std::size_t size) noexcept {
  Count();
  return __libc_malloc(size);
}
void* aligned_alloc(std::size_t align, std::size_t size) noexcept {
  Count();
  return __libc_memalign(align, size);
}
int posix_memalign(void** result, std::size_t align, std::size_t size) noexcept {
  Count();
  *result = __libc_memalign(align, size);
  return *result == nullptr ? 12 : 0;  // ENOMEM
}
}
#endif

namespace cairn::direct {
namespace {

TEST(Allocation, FramesAllocateNothingAndKeyframesLittle) {
#ifndef CAIRN_COUNTS_ALLOCATIONS
  GTEST_SKIP() << "allocations cannot be counted under this sanitizer or C library";
#else
  const testing::Scene scene;
  const auto created = Odometry::Create(OdometryOptions(), testing::TestCamera());
  ASSERT_TRUE(created.ok()) << created.status();
  Odometry& odometry = **created;
  constexpr int kFrames = 80, kWarm = 24;  // frames tracked before counting: until the start is trusted
  int warm = 0, tracked = 0, in_tracking = 0, in_tracing = 0, keyframes = 0, in_keyframes = 0;
  for (int i = 0; i < kFrames; ++i) {
    const Frame frame = scene.Render(testing::TestCamera(), testing::SwayPose(i), i);
    const std::int64_t keyframes_before = odometry.Statistics().keyframes;
    allocations = 0, counting = true;
    const auto result = odometry.Track(frame);
    counting = false;
    ASSERT_TRUE(result.ok()) << result.status();
    const int tracking = allocations;
    allocations = 0, counting = true;
    while (odometry.OptimizeNext()) {
    }
    counting = false;
    odometry.TakePackets();
    if (result->keyframe < 0 || ++warm <= kWarm) continue;
    ++tracked, in_tracking += tracking;
    const bool keyframe = odometry.Statistics().keyframes > keyframes_before;
    (keyframe ? in_keyframes : in_tracing) += allocations;
    keyframes += keyframe;
  }
  ASSERT_GT(tracked, 20);
  EXPECT_GT(keyframes, 0);
  // Vectors of results and statistics double now and then, and a frame that becomes a keyframe takes its pyramid along;
  // one allocation in every frame would be more.
  EXPECT_LT(in_tracking, tracked / 2) << "in " << tracked << " frames";
  EXPECT_LT(in_tracing, tracked / 4) << "in " << tracked - keyframes << " frames";
  EXPECT_LE(in_keyframes, 400 * keyframes) << "for " << keyframes << " keyframes";
#endif
}

}  // namespace
}  // namespace cairn::direct
