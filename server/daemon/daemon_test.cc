#include "server/daemon/daemon.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <future>

namespace cairn::server {
namespace {

DaemonOptions Options() {
  DaemonOptions options;
  options.maps.directory = testing::TempDir();
  options.grpc.address = options.http.address = "127.0.0.1:0";
  return options;
}

TEST(Daemon, DoesNotListenBeyondThisMachineUnlessToldSoInWords) {
  DaemonOptions options = Options();
  options.grpc.address = "0.0.0.0:0";
  const absl::Status refused = Daemon::Start(options).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(refused.message()), testing::HasSubstr("--without-protection"));
  EXPECT_THAT(std::string(refused.message()), testing::HasSubstr("TLS (tls_certificate, tls_key) and tokens"));
  options.access.tokens = "tokens.json";
  EXPECT_THAT(std::string(Daemon::Start(options).status().message()),
              testing::HasSubstr("TLS (tls_certificate, tls_key) is"));
  options.access.tokens = "";
  options.without_protection = true;
  EXPECT_TRUE(Daemon::Start(options).ok());
  options = Options();
  options.http.address = "0.0.0.0:0";
  EXPECT_EQ(Daemon::Start(options).status().code(), absl::StatusCode::kFailedPrecondition);
  options.no_http = true;
  EXPECT_TRUE(Daemon::Start(options).ok());
}

TEST(Daemon, SaysWhereItListensAndThatAnAddressIsTaken) {
  const auto daemon = Daemon::Start(Options());
  ASSERT_TRUE(daemon.ok()) << daemon.status();
  EXPECT_THAT((*daemon)->grpc_address(), testing::MatchesRegex("127.0.0.1:[1-9][0-9]+"));
  EXPECT_THAT((*daemon)->http_address(), testing::MatchesRegex("127.0.0.1:[1-9][0-9]+"));
  DaemonOptions taken = Options();
  taken.http.address = (*daemon)->http_address();
  EXPECT_EQ(Daemon::Start(taken).status().code(), absl::StatusCode::kUnavailable);
  taken = Options();
  taken.grpc.address = (*daemon)->grpc_address();
  EXPECT_EQ(Daemon::Start(taken).status().code(), absl::StatusCode::kUnavailable);
  (*daemon)->Stop(std::chrono::seconds(1));
  EXPECT_TRUE(Daemon::Start(taken).ok()) << "free again";
}

TEST(Daemon, LeavesASocketToWhoIsAtIt) {
  DaemonOptions options = Options();
  options.grpc.address = absl::StrCat("unix:", testing::TempDir(), "/daemon_test_", getpid(), ".socket");
  options.no_http = true;
  {
    const auto first = Daemon::Start(options);
    ASSERT_TRUE(first.ok()) << first.status();
    EXPECT_EQ(Daemon::Start(options).status().code(), absl::StatusCode::kUnavailable);
  }
  EXPECT_TRUE(Daemon::Start(options).ok()) << "free again";
}

TEST(Daemon, WaitsForPortsThatAreAboutToBeFree) {
  auto first = Daemon::Start(Options());
  ASSERT_TRUE(first.ok()) << first.status();
  DaemonOptions same = Options();
  same.grpc.address = (*first)->grpc_address();
  same.http.address = (*first)->http_address();
  auto next = std::async(std::launch::async, [&] { return Daemon::Start(same); });
  first->reset();
  const auto started = next.get();
  EXPECT_TRUE(started.ok()) << started.status();
}

TEST(Daemon, ChecksWhatItsSettingsNameBeforeItIsStarted) {
  EXPECT_TRUE(Options().CheckFiles().ok());
  const auto refused = [](const std::function<void(DaemonOptions*)>& change) {
    DaemonOptions options = Options();
    change(&options);
    const absl::Status valid = options.Validate();
    return std::string((valid.ok() ? options.CheckFiles() : valid).message());
  };
  using testing::HasSubstr;
  EXPECT_THAT(refused([](DaemonOptions* o) { o->access.audit_log = testing::TempDir(); }), HasSubstr("is a folder"));
  EXPECT_THAT(refused([](DaemonOptions* o) { o->access.request_log = "/not/there/log"; }),
              HasSubstr("cannot be written"));
  EXPECT_THAT(refused([](DaemonOptions* o) { o->access.tokens = o->access.audit_log = "t.json"; }),
              HasSubstr("a file of its own"));
  const std::string other = testing::TempDir() + "/no_log";
  std::ofstream(other) << "SQLite format 3";
  EXPECT_THAT(refused([&](DaemonOptions* o) { o->access.audit_log = other; }), HasSubstr("something else in it"));
  EXPECT_THAT(refused([](DaemonOptions* o) { o->geopose_map = "none"; }), HasSubstr("there is no map \"none\""));
  EXPECT_THAT(refused([](DaemonOptions* o) { o->grpc.address = "unix:/not/there/socket"; }), HasSubstr("/not/there"));
  EXPECT_THAT(refused([](DaemonOptions* o) { o->grpc.address = o->http.address = "127.0.0.1:7999"; }),
              HasSubstr("an address of its own"));
  // Of the documentation (RFC 5737): no machine has it.
  EXPECT_THAT(refused([](DaemonOptions* o) {
                o->without_protection = true;
                o->http.address = "192.0.2.1:7879";
              }),
              HasSubstr("192.0.2.1"));
  const auto running = Daemon::Start(Options());
  ASSERT_TRUE(running.ok()) << running.status();
  EXPECT_EQ(refused([&](DaemonOptions* o) { o->grpc.address = (*running)->grpc_address(); }), "")
      << "it may be running";
}

TEST(Daemon, ErrorsOfOptions) {
  DaemonOptions options = Options();
  options.grpc.address = "7878";
  EXPECT_EQ(Daemon::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
  options = Options();
  options.images.max_pixels = 0;
  EXPECT_EQ(Daemon::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
  options = Options();
  options.maps.directory = "/not/there";
  EXPECT_EQ(Daemon::Start(options).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace cairn::server
