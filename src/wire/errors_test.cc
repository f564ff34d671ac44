#include "wire/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace cairn::wire {
namespace {

TEST(Errors, EachKindHasAReasonOfItsOwnAndSurvivesTheWay) {
  std::set<absl::string_view> reasons;
  for (const ErrorKind& kind : ErrorKinds()) {
    EXPECT_TRUE(reasons.insert(kind.reason).second) << kind.reason;
    if (kind.code == absl::StatusCode::kOk) continue;
    EXPECT_GE(kind.http_status, 400);
    const absl::Status status = kind.fault == store::Fault::kNone ? absl::Status(kind.code, "what was wrong")
                                                                  : store::MakeFault(kind.fault, "what was wrong");
    EXPECT_EQ(status.code(), kind.code) << kind.reason;
    EXPECT_EQ(KindOf(status).reason, kind.reason);
    const absl::Status back = StatusFrom(static_cast<int>(status.code()), status.message(), DetailsOf(status, "1-2"));
    EXPECT_EQ(back, status);
    EXPECT_EQ(store::FaultOf(back), kind.fault);
  }
}

TEST(Errors, WhenToTryAgainSurvivesTheWay) {
  const absl::Status status = RetryLater("too much", 1.5);
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(KindOf(status).reason, "resource_exhausted");
  const absl::Status back = StatusFrom(static_cast<int>(status.code()), status.message(), DetailsOf(status, "1-2"));
  EXPECT_EQ(RetryAfterOf(back), 1.5);
  EXPECT_EQ(back, status);
  EXPECT_EQ(RetryAfterOf(absl::ResourceExhaustedError("too much")), 0.0);
}

TEST(Errors, WhatAnotherVersionSendsIsStillAnError) {
  EXPECT_EQ(StatusFrom(5, "gone", "").code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(StatusFrom(5, "gone", "no proto \xff").code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(StatusFrom(99, "what?", "").code(), absl::StatusCode::kUnknown);
  EXPECT_EQ(StatusFrom(-1, "what?", "").code(), absl::StatusCode::kUnknown);
  EXPECT_TRUE(StatusFrom(0, "", "").ok());
}

TEST(Errors, ToldInsideAnAnswer) {
  EXPECT_TRUE(StatusOfReason("", "").ok());
  for (const ErrorKind& kind : ErrorKinds().subspan(1)) {
    const absl::Status status = StatusOfReason(kind.reason, "why");
    EXPECT_EQ(KindOf(status).reason, kind.reason);
    EXPECT_EQ(status.message(), "why");
  }
  EXPECT_EQ(StatusOfReason("from_a_newer_server", "why").code(), absl::StatusCode::kUnknown);
  EXPECT_FALSE(StatusOfReason("ok", "why").ok());
}

}  // namespace
}  // namespace cairn::wire
