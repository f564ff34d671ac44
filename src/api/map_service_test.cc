#include "api/map_service.h"

#include <gtest/gtest.h>

namespace cairn::api {
namespace {

TEST(MapName, StaysInItsDirectory) {
  for (const char* good : {"office", "Office-2.v1", "0", "a_b", "a.cairn.old"})
    EXPECT_TRUE(CheckMapName(good).ok()) << good;
  for (const std::string& bad : {std::string(), std::string("."), std::string(".."), std::string("../office"),
                                 std::string("a/b"), std::string("/etc/passwd"), std::string("a\\b"),
                                 std::string("a\0b", 3), std::string("-rf"), std::string(".hidden"), std::string("a b"),
                                 std::string("b\xC3\xBCro"), std::string("office.cairn"), std::string(129, 'a')}) {
    EXPECT_EQ(CheckMapName(bad).code(), absl::StatusCode::kInvalidArgument) << bad;
  }
}

}  // namespace
}  // namespace cairn::api
