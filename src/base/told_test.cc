#include "base/told.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Told, WhatLiesInTheDirectoryKeepsItsNameAlone) {
  const auto told = [](const char* message) { return WithoutDirectory(message, "/srv/maps"); };
  EXPECT_EQ(told("opening map /srv/maps/office.cairn: /srv/maps/office.cairn-wal is gone"),
            "opening map office.cairn: office.cairn-wal is gone");
  EXPECT_EQ(told("/srv/maps: no space left"), "the folder of the maps: no space left");
  EXPECT_EQ(told("no space left in /srv/maps"), "no space left in the folder of the maps");
  EXPECT_EQ(told("no permission (/srv/maps/)"), "no permission ()");
  EXPECT_EQ(told("/srv/maps2/a"), "/srv/maps2/a") << "another one";
  EXPECT_EQ(told("office.cairn"), "office.cairn");
  EXPECT_EQ(WithoutDirectory("a: b", ""), "a: b");
  EXPECT_EQ(WithoutDirectory("a/b", "/"), "a/b");
}

TEST(Told, PayloadsStay) {
  absl::Status status = absl::DataLossError("/maps/a is damaged");
  status.SetPayload("x", absl::Cord("y"));
  const absl::Status told = WithoutDirectory(status, "/maps");
  EXPECT_EQ(told.message(), "a is damaged");
  EXPECT_EQ(told.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(told.GetPayload("x"), absl::Cord("y"));
  EXPECT_TRUE(WithoutDirectory(absl::OkStatus(), "/maps").ok());
}

}  // namespace
}  // namespace cairn
