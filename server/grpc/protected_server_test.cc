// Over the wire: TLS, certificates of clients, tokens and limits, as clients of client/remote meet them.
#include <cairn/v1/maps.grpc.pb.h>
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "cairn.h"
#include "cairn/map.h"
#include "client/conformance/conformance_map.h"
#include "server/grpc/testing_server.h"
#include "server/tls/testing_certificates.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

using client::RemoteMapService;
using client::RemoteOptions;
using testing::HasSubstr;

class ProtectedServer : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = testing::TempDir() + "/protected_server_test_" + std::to_string(getpid());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_ + "/maps");
    for (const char* name : {"room", "secret"}) {
      ASSERT_TRUE(conformance::WriteConformanceMap(folder_ + "/maps/" + name + ".cairn").ok());
    }
    access_.tokens = folder_ + "/tokens.json";
    reader_ = NewToken("reader", Right::kRead);
    robot_ = NewToken("robot", Right::kExtend);
    ca_ = MakeTestingCa();
    UseCertificate(MakeTestingCertificate({}, &ca_));
  }
  void TearDown() override {
    server_.reset();
    std::filesystem::remove_all(folder_);
  }

  std::string NewToken(const std::string& name, Right right) const {
    Token token;
    token.name = name;
    token.maps = {"room", "new*"};
    token.right = right;
    return *CreateToken(access_.tokens, token, absl::ToUnixSeconds(absl::Now()));
  }
  void UseCertificate(const TestingCertificate& certificate) {
    grpc_.tls = ServerTls{certificate.certificate_pem, certificate.key_pem, "", 0};
  }
  void Start() {
    auto server = TestingServer::Start(folder_ + "/maps", grpc_, 0, access_);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
  }
  RemoteOptions Remote(const std::string& token) const {
    RemoteOptions options = server_->Remote();
    options.server = absl::StrCat("localhost:", server_->grpc->port());
    options.token = token;
    options.tls.emplace().ca_pem = ca_.certificate_pem;
    options.attempts = 1;
    options.deadline_s = 10.0;
    return options;
  }
  static absl::Status Ask(const RemoteOptions& options, const std::string& map = "room") {
    const auto service = RemoteMapService::Connect(options);
    return service.ok() ? (*service)->Describe(map).status() : service.status();
  }
  static api::SessionRequest Session(const std::string& map) {
    api::SessionRequest request;
    request.map = map;
    request.policy = map::SessionPolicy::kCreate;
    request.camera = Camera::FromPinhole(conformance::TheConformanceMap().pinhole);
    return request;
  }
  static api::SessionFrame Frame(TimeNs time_ns) {
    const Pinhole& pinhole = conformance::TheConformanceMap().pinhole;
    return {cv::Mat(pinhole.height_px, pinhole.width_px, CV_8UC1, cv::Scalar(90)), time_ns};
  }

  std::string folder_, reader_, robot_;
  TestingCertificate ca_;
  GrpcServerOptions grpc_;
  AccessOptions access_;
  std::unique_ptr<TestingServer> server_;
};

TEST_F(ProtectedServer, KnowsWhoAsksAndWhatTheyMay) {
  Start();
  EXPECT_TRUE(Ask(Remote(reader_)).ok()) << Ask(Remote(reader_));
  EXPECT_EQ(Ask(Remote("")).code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(Ask(Remote("cairn_wrong")).code(), absl::StatusCode::kUnauthenticated);
  const absl::Status secret = Ask(Remote(reader_), "secret");
  EXPECT_EQ(secret.code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(secret, Ask(Remote(reader_), "none"));
  const auto service = *RemoteMapService::Connect(Remote(reader_));
  EXPECT_EQ(service->List()->size(), 1u);
  EXPECT_EQ(service->StartSession(Session("new")).status().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_TRUE(service->NewTracker("room", Session("").camera).ok());
  EXPECT_EQ(service->NewTracker("secret", Session("").camera).status().code(), absl::StatusCode::kPermissionDenied);
}

// As programs do that link the library, by options or by the environment.
TEST_F(ProtectedServer, ThePublicLibraryShowsATokenAndChecksTheCertificate) {
  Start();
  const std::string uri = absl::StrCat("cairn://localhost:", server_->grpc->port(), "/room");
  const std::string ca_file = folder_ + "/ca.pem";
  std::ofstream(ca_file) << ca_.certificate_pem;
  v0::MapOptions options;
  options.server.ca_file = ca_file;
  EXPECT_TRUE(absl::IsUnauthenticated(v0::Map::Open(uri, options).status())) << v0::Map::Open(uri, options).status();
  options.server.token = robot_;
  EXPECT_TRUE(v0::Map::Open(uri, options).ok()) << v0::Map::Open(uri, options).status();
  options.server.ca_file = folder_ + "/none.pem";
  EXPECT_TRUE(absl::IsNotFound(v0::Map::Open(uri, options).status()));

  cairn_map_options c_options{};
  c_options.struct_size = sizeof(c_options);
  c_options.token = reader_.c_str();
  c_options.ca_file = ca_file.c_str();
  cairn_map* map = nullptr;
  cairn_error error{};
  error.struct_size = sizeof(error);
  EXPECT_EQ(cairn_map_open(uri.c_str(), &c_options, nullptr, &map, &error), CAIRN_OK) << error.message;
  cairn_map_close(map);

  setenv("CAIRN_TOKEN", reader_.c_str(), 1);
  setenv("CAIRN_CA", ca_file.c_str(), 1);
  const auto by_environment = v0::Map::Open(uri);
  unsetenv("CAIRN_TOKEN");
  unsetenv("CAIRN_CA");
  EXPECT_TRUE(by_environment.ok()) << by_environment.status();
  EXPECT_TRUE(by_environment->Refresh().ok());
  EXPECT_TRUE(absl::IsUnavailable(v0::Map::Open(uri).status())) << "TLS is spoken there";
}

TEST_F(ProtectedServer, ServersThatAreNotWhoTheyShouldBeGetNoToken) {
  Start();
  RemoteOptions options = Remote(reader_);
  options.tls->ca_pem = MakeTestingCa().certificate_pem;
  absl::Status status = Ask(options);
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr("TLS failed"));

  options = Remote(reader_);
  options.tls.reset();
  status = Ask(options);  // plain, where TLS is spoken
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr("does it speak TLS"));

  server_.reset();
  UseCertificate(MakeTestingCertificate({.name = "maps.example.org"}, &ca_));
  Start();
  status = Ask(Remote(reader_));
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr("for another name"));
}

TEST_F(ProtectedServer, MayAskForCertificatesOfClients) {
  const TestingCertificate clients_ca = MakeTestingCa();
  grpc_.tls->client_ca_pem = clients_ca.certificate_pem;
  Start();
  RemoteOptions options = Remote(reader_);
  const absl::Status none = Ask(options);
  EXPECT_EQ(none.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(none.message()), HasSubstr("--cert"));
  const TestingCertificate known = MakeTestingCertificate({.name = "robot"}, &clients_ca);
  options.tls->certificate_pem = known.certificate_pem;
  options.tls->key_pem = known.key_pem;
  EXPECT_TRUE(Ask(options).ok()) << Ask(options);
  options.token = "";
  EXPECT_EQ(Ask(options).code(), absl::StatusCode::kUnauthenticated) << "a token is needed all the same";
  const TestingCertificate stranger = MakeTestingCertificate({.name = "robot"}, &ca_);
  options.token = reader_;
  options.tls->certificate_pem = stranger.certificate_pem;
  options.tls->key_pem = stranger.key_pem;
  EXPECT_EQ(Ask(options).code(), absl::StatusCode::kUnavailable);
}

TEST_F(ProtectedServer, ARevokedTokenEndsItsStreamsWithTheNextFrame) {
  Start();
  const auto service = *RemoteMapService::Connect(Remote(robot_));
  auto session = service->StartSession(Session("new"));
  ASSERT_TRUE(session.ok()) << session.status();
  EXPECT_TRUE((*session)->AddFrame(Frame(1)).ok());
  const auto resumed_by_another = (*RemoteMapService::Connect(Remote(reader_)))->ResumeSession((*session)->token());
  EXPECT_FALSE(resumed_by_another.ok());
  ASSERT_TRUE(RevokeToken(access_.tokens, "robot").ok());
  EXPECT_EQ((*session)->AddFrame(Frame(2)).status().code(), absl::StatusCode::kUnauthenticated);
  // It waits for its client, which may come back with another token.
  const std::string token = (*session)->token();
  session->reset();
  const auto again = *RemoteMapService::Connect(Remote(NewToken("robot_2", Right::kExtend)));
  const auto resumed = again->ResumeSession(token);
  ASSERT_TRUE(resumed.ok()) << resumed.status();
  EXPECT_EQ((*resumed)->map(), "new");
  EXPECT_EQ((*resumed)->last_answer()->time_ns, 1);
}

// Whoever rotates tokens replaces the file of a client that runs.
TEST_F(ProtectedServer, ATokenThatIsNotKnownAnyMoreIsReadAgain) {
  Start();
  RemoteOptions options = Remote(robot_);
  std::string in_file = robot_;
  int reads = 0;
  options.read_token = [&]() -> absl::StatusOr<std::string> {
    ++reads;
    return in_file;
  };
  options.track_at = client::TrackAt::kServer;
  const auto service = *RemoteMapService::Connect(options);
  const auto session = *service->StartSession(Session("new"));
  EXPECT_TRUE(session->AddFrame(Frame(1)).ok());
  const auto tracker = *service->NewTracker("room", Session("").camera);
  EXPECT_TRUE(tracker->Track({Frame(1).image, 1}).ok());
  EXPECT_EQ(reads, 0);
  in_file = NewToken("robot_2", Right::kExtend);
  ASSERT_TRUE(RevokeToken(access_.tokens, "robot").ok());
  // Sooner or later the server notices that the client, whose stream it has ended, is gone.
  const auto answer = session->AddFrame(Frame(2));
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(answer->time_ns, 2);
  EXPECT_EQ(reads, 1);
  EXPECT_TRUE(tracker->Track({Frame(2).image, 2}).ok());
  EXPECT_TRUE(service->Describe("room").ok());
  EXPECT_EQ(reads, 1) << "all calls show the new one";
  in_file = "none";
  ASSERT_TRUE(RevokeToken(access_.tokens, "robot_2").ok());
  EXPECT_TRUE(absl::IsUnauthenticated(service->Describe("room").status()));
  EXPECT_EQ(reads, 2) << "once, and then it is given up";
}

TEST_F(ProtectedServer, RefusesWhatIsTooMuchAndSaysWhenToTryAgain) {
  access_.limits.requests_per_s = 1.0;
  Start();
  RemoteOptions impatient = Remote(reader_);
  impatient.outage_s = 0.0;
  const auto service = *RemoteMapService::Connect(impatient);
  absl::Status status;
  for (int i = 0; i < 20 && status.ok(); ++i) status = service->List().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_GT(wire::RetryAfterOf(status), 0.0);
  EXPECT_TRUE((*RemoteMapService::Connect(Remote(robot_)))->List().ok()) << "another client is not concerned";
}

// Whatever they change: what was refused so was never begun.
TEST_F(ProtectedServer, ClientsWaitWhenTheyAskTooMuch) {
  access_.limits.requests_per_s = 5.0;  // ten at once
  Start();
  const auto service = *RemoteMapService::Connect(Remote(robot_));
  for (int i = 0; i < 12; ++i) {
    const absl::Status asked = service->Describe("room").status();
    ASSERT_TRUE(asked.ok()) << asked;
  }
  for (int i = 0; i < 3; ++i) {
    const auto session = service->StartSession(Session(absl::StrCat("new", i)));
    ASSERT_TRUE(session.ok()) << session.status();
  }
  RemoteOptions given_up = Remote(robot_);
  given_up.give_up = [] { return true; };
  const auto interrupted = *RemoteMapService::Connect(given_up);
  absl::Status status;
  for (int i = 0; i < 20 && status.ok(); ++i) status = interrupted->List().status();
  EXPECT_TRUE(absl::IsResourceExhausted(status)) << "Ctrl-C ends the wait";
}

TEST_F(ProtectedServer, AKeyThatIsNotOfTheCertificateIsNamed) {
  const TestingCertificate one = MakeTestingCertificate({.name = "robot"}, &ca_);
  const TestingCertificate other = MakeTestingCertificate({.name = "robot"}, &ca_);
  client::ClientTlsFiles files;
  files.on = true;
  files.certificate = folder_ + "/one.pem";
  files.key = folder_ + "/one.key";
  std::ofstream(files.certificate) << one.certificate_pem;
  std::ofstream(files.key) << one.key_pem;
  EXPECT_TRUE(client::LoadClientTls(files).ok());
  std::ofstream(files.key) << other.key_pem;
  const absl::Status refused = client::LoadClientTls(files).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(refused));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("one.key: the key (--key) does not belong to"));
}

TEST_F(ProtectedServer, RequestsHaveTheIdThatTheClientGaveThem) {
  grpc_.tls.reset();
  Start();
  const auto channel = grpc::CreateChannel(server_->Remote().server, grpc::InsecureChannelCredentials());
  const auto id_of = [&](const std::string& sent) -> std::string {
    grpc::ClientContext context;
    if (!sent.empty()) context.AddMetadata("x-request-id", sent);
    context.AddMetadata("authorization", "Bearer " + reader_);
    v1::ListMapsResponse response;
    EXPECT_TRUE(v1::Maps::NewStub(channel)->ListMaps(&context, {}, &response).ok());
    const auto found = context.GetServerTrailingMetadata().find("x-request-id");
    return found == context.GetServerTrailingMetadata().end() ? ""
                                                              : std::string(found->second.data(), found->second.size());
  };
  EXPECT_EQ(id_of("robot-1.42"), "robot-1.42");
  const std::string own = id_of("not an id");
  EXPECT_NE(own, "not an id");
  EXPECT_FALSE(own.empty());
  EXPECT_NE(id_of(""), own);
}

TEST(RemoteOptions, ATokenIsNotSentInTheClearBeyondThisMachineUnlessToldSo) {
  RemoteOptions options;
  options.token = "cairn_x";
  options.server = "localhost:7878";
  EXPECT_TRUE(options.Validate().ok());
  options.server = "unix:/run/cairnd";
  EXPECT_TRUE(options.Validate().ok());
  options.server = "maps.example.org:7878";
  EXPECT_EQ(options.Validate().code(), absl::StatusCode::kFailedPrecondition);
  options.token_in_clear = true;
  EXPECT_TRUE(options.Validate().ok());
  options.token_in_clear = false;
  options.tls.emplace();
  EXPECT_TRUE(options.Validate().ok());
  options.token = "two words";
  EXPECT_EQ(options.Validate().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::server
