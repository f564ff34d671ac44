#include "base/guarded.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <new>
#include <stdexcept>

namespace cairn {
namespace {

TEST(Guarded, GivesWhatTheFunctionReturns) {
  EXPECT_TRUE(Guarded([] { return absl::OkStatus(); }).ok());
  EXPECT_EQ(*Guarded([]() -> absl::StatusOr<int> { return 3; }), 3);
  EXPECT_EQ(Guarded([] { return absl::NotFoundError("x"); }).code(), absl::StatusCode::kNotFound);
}

TEST(Guarded, TurnsExceptionsIntoErrors) {
  const auto throwing = [](const auto& exception) { return Guarded([&]() -> absl::Status { throw exception; }); };
  EXPECT_EQ(throwing(std::bad_alloc()).code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(throwing(std::bad_alloc()).message(), "out of memory");
  // As OpenCV says it.
  EXPECT_EQ(throwing(std::runtime_error("alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate")).code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(throwing(std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again))).code(),
            absl::StatusCode::kResourceExhausted);
  const absl::Status other = throwing(std::runtime_error("bad intrinsics"));
  EXPECT_EQ(other.code(), absl::StatusCode::kInternal);
  EXPECT_NE(other.message().find("bad intrinsics"), absl::string_view::npos) << other;
  EXPECT_EQ(throwing(7).code(), absl::StatusCode::kInternal);
  const absl::StatusOr<int> value = Guarded([]() -> absl::StatusOr<int> { throw std::bad_alloc(); });
  EXPECT_EQ(value.status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(StartThread, HandsOnWhatTheBodyThrows) {
  std::promise<absl::Status> told;
  auto thread = StartThread(
      "reading images", [] { throw std::bad_alloc(); }, [&](const absl::Status& status) { told.set_value(status); });
  ASSERT_TRUE(thread.ok()) << thread.status();
  const absl::Status status = told.get_future().get();
  thread->join();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(status.message(), "reading images: out of memory");
}

TEST(StartThread, TellsNothingOfABodyThatReturns) {
  bool ran = false, failed = false;
  auto thread = StartThread(
      "work", [&] { ran = true; }, [&](const absl::Status&) { failed = true; });
  ASSERT_TRUE(thread.ok()) << thread.status();
  thread->join();
  EXPECT_TRUE(ran);
  EXPECT_FALSE(failed);
}

TEST(RunInThreads, RunsEverywhereAndThrowsHere) {
  std::atomic<int> calls = 0;
  RunInThreads(3, [&] { ++calls; });
  EXPECT_EQ(calls, 3);
  EXPECT_THROW(RunInThreads(3,
                            [&] {
                              if (++calls == 5) throw std::bad_alloc();
                            }),
               std::bad_alloc);
  EXPECT_EQ(calls, 6) << "the others are waited for";
}

}  // namespace
}  // namespace cairn
