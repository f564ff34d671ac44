#include "server/daemon/settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

namespace cairn::server {
namespace {

class Settings : public testing::Test {
 protected:
  void TearDown() override { std::remove(path_.c_str()); }
  absl::Status Load(const std::string& text) {
    std::ofstream(path_) << text;
    return LoadSettings(path_, settings_);
  }
  std::string Refusal(const std::string& text) {
    const absl::Status status = Load(text);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    return std::string(status.message());
  }

  const std::string path_ = testing::TempDir() + "/settings_test_" + std::to_string(getpid()) + ".yaml";
  DaemonOptions options_;
  std::vector<Setting> settings_ = SettingsOf(&options_);
};

TEST_F(Settings, AreTakenOverAndTheRestStays) {
  const DaemonOptions standard;
  ASSERT_TRUE(Load("# a comment\nmaps: /srv/maps\nmemory_mb: 1.5\nwithout_protection: true\nmax_sessions: 3\n"
                   "max_message_mb: 2\n")
                  .ok());
  EXPECT_EQ(options_.maps.directory, "/srv/maps");
  EXPECT_EQ(options_.maps.memory_budget_bytes, 1'500'000);
  EXPECT_TRUE(options_.without_protection);
  EXPECT_EQ(options_.maps.max_sessions, 3);
  EXPECT_EQ(options_.grpc.max_message_bytes, 2 << 20);
  EXPECT_EQ(options_.grpc.address, standard.grpc.address);
  EXPECT_EQ(options_.maps.idle_close_s, standard.maps.idle_close_s);
}

// What --help and the documentation show as the standard is what sets it.
TEST_F(Settings, StandardsAreTheirOwnText) {
  for (const Setting& setting : settings_) {
    EXPECT_TRUE(setting.set(setting.standard).ok()) << setting.key << " " << setting.standard;
    EXPECT_FALSE(setting.help.empty());
  }
  const DaemonOptions standard;
  EXPECT_EQ(options_.maps.memory_budget_bytes, standard.maps.memory_budget_bytes);
  EXPECT_EQ(options_.images.max_pixels, standard.images.max_pixels);
  EXPECT_EQ(options_.grpc.max_message_bytes, standard.grpc.max_message_bytes);
  EXPECT_EQ(options_.maps.workers, standard.maps.workers);
}

TEST_F(Settings, MistakesNameTheLine) {
  EXPECT_THAT(Refusal("maps: a\nmemroy_mb: 5\n"), testing::HasSubstr(":2: unknown key `memroy_mb`; there are maps,"));
  EXPECT_THAT(Refusal("maps: a\nmaps: b\n"), testing::HasSubstr(":2: `maps` is repeated"));
  EXPECT_THAT(Refusal("memory_mb: lots\n"), testing::HasSubstr(":1: `memory_mb` must be a number"));
  EXPECT_THAT(Refusal("memory_mb: .inf\n"), testing::HasSubstr("must be a number"));
  EXPECT_THAT(Refusal("max_sessions: 1.5\n"), testing::HasSubstr("whole number"));
  EXPECT_THAT(Refusal("max_sessions: 1e12\n"), testing::HasSubstr("`max_sessions` must be 1 to 10000, not 1e+12"));
  EXPECT_THAT(Refusal("max_calls: 0\n"), testing::HasSubstr("`max_calls` must be 8 to 10000, not 0"));
  EXPECT_THAT(Refusal("workers: -3\n"), testing::HasSubstr("`workers` must be 0 to 1024, not -3"));
  EXPECT_THAT(Refusal("idle_close_s: 1e300\n"), testing::HasSubstr("must be 1 to 10000000, not 1e+300"));
  EXPECT_THAT(Refusal("no_http: perhaps\n"), testing::HasSubstr("true or false"));
  EXPECT_THAT(Refusal("maps: [a, b]\n"), testing::HasSubstr("takes one value"));
  EXPECT_THAT(Refusal("- a\n- b\n"), testing::HasSubstr("key: value"));
  EXPECT_EQ(LoadSettings("/not/there.yaml", settings_).code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace cairn::server
