#include "server/daemon/daemon.h"

#include <arpa/inet.h>
#include <cairn/v1/sessions.grpc.pb.h>
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <thread>

#include "wire/convert.h"

namespace cairn::server {
namespace {

DaemonOptions Options() {
  DaemonOptions options;
  options.maps.directory = testing::TempDir();
  options.grpc.address = options.http.address = "127.0.0.1:0";
  return options;
}

// Of the answer to a GET over HTTP: "200"; empty without one.
std::string StatusOf(const Daemon& daemon, const std::string& path) {
  const std::string& http = daemon.http_address();
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(http.substr(http.rfind(':') + 1))));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int connection = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  std::string answer;
  if (connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
    const std::string request = "GET " + path + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";
    send(connection, request.data(), request.size(), MSG_NOSIGNAL);
    char some[512];
    for (ssize_t got = 0; (got = recv(connection, some, sizeof(some), 0)) > 0;) {
      answer.append(some, static_cast<std::size_t>(got));
    }
  }
  close(connection);
  return answer.size() > 12 ? answer.substr(9, 3) : "";
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

TEST(Daemon, AFolderThatCannotBeWrittenIsServedAndSaidSo) {
  DaemonOptions options = Options();
  EXPECT_TRUE(options.Warnings().empty());
  options.maps.directory = absl::StrCat(testing::TempDir(), "/daemon_test_", getpid());
  std::filesystem::create_directory(options.maps.directory);
  std::filesystem::permissions(options.maps.directory, std::filesystem::perms(0555));
  const uid_t self = geteuid();
  if (self == 0) {
    ASSERT_EQ(seteuid(65534), 0);  // root may write everywhere
  }
  const absl::Status files = options.CheckFiles();
  const std::vector<std::string> warnings = options.Warnings();
  if (self == 0) {
    ASSERT_EQ(seteuid(self), 0);
  }
  EXPECT_TRUE(files.ok()) << files;
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], testing::HasSubstr("maps cannot be made, extended or deleted in"));
  std::filesystem::remove(options.maps.directory);
}

// For as long as calls under way get, here one that never ends.
TEST(Daemon, WhileItStopsHttpSaysSo) {
  auto daemon = Daemon::Start(Options());
  ASSERT_TRUE(daemon.ok()) << daemon.status();
  const auto stub =
      v1::Sessions::NewStub(grpc::CreateChannel((*daemon)->grpc_address(), grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  const auto stream = stub->RunSession(&context);
  v1::RunSessionRequest request;
  request.mutable_start()->set_map(absl::StrCat("stops_", getpid()));
  request.mutable_start()->set_policy(v1::SessionInfo::POLICY_CREATE);
  Camera camera;
  camera.width_px = 640, camera.height_px = 480;
  camera.fx_px = camera.fy_px = 500.0;
  camera.cx_px = 320.0, camera.cy_px = 240.0;
  wire::ToProto(camera, request.mutable_start()->mutable_camera());
  v1::RunSessionResponse started;
  ASSERT_TRUE(stream->Write(request) && stream->Read(&started)) << stream->Finish().error_message();
  EXPECT_EQ(StatusOf(**daemon, "/readyz"), "200");
  auto stopping = std::async(std::launch::async, [&] { (*daemon)->Stop(std::chrono::seconds(2)); });
  std::string ready = "200";
  for (int i = 0; i < 40 && ready == "200"; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    ready = StatusOf(**daemon, "/readyz");
  }
  EXPECT_EQ(ready, "503");
  EXPECT_EQ(StatusOf(**daemon, "/v1/maps"), "503");
  EXPECT_EQ(StatusOf(**daemon, "/healthz"), "200");
  EXPECT_EQ(stopping.wait_for(std::chrono::seconds(0)), std::future_status::timeout) << "it waits for the stream";
  stopping.wait();
  context.TryCancel();
  stream->Finish();
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
