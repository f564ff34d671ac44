#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "base/files.h"
#include "server/access/authorized_maps.h"

namespace cairn::server {
namespace {

using nlohmann::json;
using testing::ElementsAre;

class FakeSession : public api::MapSession {
 public:
  explicit FakeSession(std::string map) : map_(std::move(map)) {}
  const std::string& token() const override { return token_; }
  const std::string& map() const override { return map_; }
  const std::string& map_id() const override { return map_id_; }
  const Camera& camera() const override { return camera_; }
  const std::optional<api::SessionAnswer>& last_answer() const override { return last_answer_; }
  const api::SessionProgress& progress() const override { return progress_; }
  absl::StatusOr<api::SessionAnswer> AddFrame(const api::SessionFrame& /*frame*/) override {
    return api::SessionAnswer();
  }
  absl::StatusOr<api::SessionSummary> Finish() override { return api::SessionSummary(); }

 private:
  const std::string token_ = "session", map_, map_id_;
  const Camera camera_;
  const std::optional<api::SessionAnswer> last_answer_;
  const api::SessionProgress progress_;
};

class FakeFeed : public api::MapFeed {
 public:
  absl::StatusOr<std::optional<api::MapStep>> Next(std::chrono::milliseconds /*timeout*/) override {
    return std::optional<api::MapStep>();
  }
  std::string Vocabulary() const override { return ""; }
};

class FakeTracker : public api::Tracker {
 public:
  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& /*frame*/) override { return api::TrackAnswer(); }
};

// Has the maps office and secret, and notes which calls have reached it.
class FakeMaps : public api::MapService {
 public:
  absl::StatusOr<std::vector<api::MapSummary>> List() override {
    std::vector<api::MapSummary> maps(2);
    maps[0].name = "office";
    maps[1].name = "secret";
    return maps;
  }
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) override {
    return Reach("describe", map, api::MapDescription());
  }
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& /*query*/) override {
    return Reach("localize", map, api::LocalizeAnswer());
  }
  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTracker(const std::string& map, const Camera& /*camera*/) override {
    return Reach("track", map, std::unique_ptr<api::Tracker>(new FakeTracker));
  }
  absl::StatusOr<std::unique_ptr<api::MapFeed>> Follow(const std::string& map,
                                                       const api::FollowRequest& /*request*/) override {
    return Reach("follow", map, std::unique_ptr<api::MapFeed>(new FakeFeed));
  }
  absl::StatusOr<std::unique_ptr<api::MapSession>> StartSession(const api::SessionRequest& request) override {
    client_ = request.client;
    return Reach("start", request.map, std::unique_ptr<api::MapSession>(new FakeSession(request.map)));
  }
  absl::StatusOr<std::unique_ptr<api::MapSession>> ResumeSession(const std::string& token) override {
    return std::unique_ptr<api::MapSession>(new FakeSession(token));
  }
  absl::StatusOr<api::AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                   const api::LocalizeQuery& /*query*/) override {
    return Reach("across", absl::StrJoin(maps, "+"), api::AcrossAnswer());
  }
  absl::StatusOr<std::vector<api::ActiveSession>> Sessions(const std::string& /*map*/) override {
    std::vector<api::ActiveSession> sessions(2);
    sessions[0].map = "office";
    sessions[1].map = "secret";
    return sessions;
  }
  absl::StatusOr<api::MapSummary> Create(const std::string& map, const std::string& /*title*/) override {
    return Reach("create", map, api::MapSummary());
  }
  absl::StatusOr<api::MapSummary> Snapshot(const std::string& map, const std::string& as) override {
    return Reach("snapshot to " + as, map, api::MapSummary());
  }
  absl::StatusOr<std::string> Delete(const std::string& map) override { return Reach("delete", map, map + ".1"); }
  absl::StatusOr<std::vector<api::DeletedMap>> ListDeleted() override {
    return std::vector<api::DeletedMap>{{"office.1", "office", 1, 1}, {"secret.1", "secret", 1, 1}};
  }
  absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) override {
    reached_.insert("restore " + deleted + " as " + as);
    return as;
  }
  absl::StatusOr<api::MapVerification> Verify(const std::string& map, api::VerifyDepth /*depth*/) override {
    return Reach("verify", map, api::MapVerification());
  }
  absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId /*session*/) override {
    return Reach("remove session", map, api::SessionRemoval());
  }
  absl::StatusOr<api::AlignAnswer> Align(const std::string& map, const api::AlignRequest& /*request*/) override {
    return Reach("align", map, api::AlignAnswer());
  }
  absl::StatusOr<map::MapOverview> Overview(const std::string& map) override {
    return Reach("overview", map, map::MapOverview());
  }
  absl::StatusOr<api::MapLog> Log(const std::string& map, const map::ChangeQuery& /*query*/) override {
    return Reach("log", map, api::MapLog());
  }
  absl::Status Export(const std::string& map, api::ExportContent /*content*/,
                      const api::ExportSink& /*sink*/) override {
    return Reach("export", map, 0).status();
  }

  // By "call map".
  std::set<std::string> reached_;
  std::string client_;

 private:
  template <class Answer>
  absl::StatusOr<Answer> Reach(const std::string& call, const std::string& map, Answer answer) {
    reached_.insert(call + " " + map);
    if (map != "office" && map != "secret") return absl::NotFoundError("there is no such map");
    return answer;
  }
};

class AccessTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = testing::TempDir() + "/access_test_" + std::to_string(getpid());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directory(folder_);
    options_.tokens = folder_ + "/tokens.json";
    options_.audit_log = folder_ + "/audit.jsonl";
    const auto token = [&](const std::string& name, std::vector<std::string> maps, Right right) {
      Token wanted;
      wanted.name = name;
      wanted.maps = std::move(maps);
      wanted.right = right;
      return *CreateToken(options_.tokens, wanted, absl::ToUnixSeconds(absl::Now()));
    };
    reader_ = token("reader", {"office", "hall*"}, Right::kRead);
    robot_ = token("robot", {"office"}, Right::kExtend);
    access_ = *Access::Open(options_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  AuthorizedMaps As(const std::string& secret) {
    Caller caller;
    caller.peer = "192.0.2.7";
    caller.authorization = "Bearer " + secret;
    Client client = *access_->Identify(caller);
    client.request_id = "r1";
    return {&maps_, access_.get(), client};
  }
  std::vector<json> Audit() const {
    std::vector<json> lines;
    const std::string text = *ReadWholeFile(options_.audit_log);
    for (const absl::string_view line : absl::StrSplit(text, '\n', absl::SkipEmpty())) {
      lines.push_back(json::parse(std::string(line)));
    }
    return lines;
  }
  api::SessionRequest Request(const std::string& map) const {
    api::SessionRequest request;
    request.map = map;
    return request;
  }

  std::string folder_, reader_, robot_;
  AccessOptions options_;
  std::unique_ptr<Access> access_;
  FakeMaps maps_;
};

TEST_F(AccessTest, WithoutATokenNobodyIsKnown) {
  for (const std::string& authorization : {std::string(), std::string("Bearer"), "Basic " + reader_,
                                           "Bearer x" + reader_, "Bearer " + reader_.substr(0, 20), reader_}) {
    Caller caller;
    caller.authorization = authorization;
    EXPECT_EQ(access_->Identify(caller).status().code(), absl::StatusCode::kUnauthenticated) << authorization;
  }
  Caller caller;
  caller.authorization = "bearer  " + reader_;
  EXPECT_EQ(access_->Identify(caller)->token_name, "reader");
}

TEST_F(AccessTest, AMapThatMayNotBeReadIsAsOneThatIsNotThere) {
  AuthorizedMaps reader = As(reader_);
  EXPECT_TRUE(reader.Describe("office").ok());
  EXPECT_EQ(reader.Describe("hall_2").status().code(), absl::StatusCode::kNotFound) << "may be told of it";
  const absl::Status secret = reader.Describe("secret").status(), none = reader.Describe("none").status();
  EXPECT_EQ(secret.code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(secret, none);
  EXPECT_EQ(reader.Overview("secret").status(), secret);
  EXPECT_EQ(reader.Localize("secret", {}).status(), secret);
  EXPECT_EQ(reader.NewTracker("secret", {}).status(), secret);
  EXPECT_EQ(reader.Follow("secret", {}).status(), secret);
  EXPECT_EQ(reader.Describe("../office").status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(maps_.reached_, ElementsAre("describe hall_2", "describe office"));
  const auto listed = *reader.List();
  ASSERT_EQ(listed.size(), 1u);
  EXPECT_EQ(listed[0].name, "office");
}

TEST_F(AccessTest, ToExtendTakesMoreThanToRead) {
  EXPECT_EQ(As(reader_).StartSession(Request("office")).status().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(As(reader_).ResumeSession("office").status().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(As(robot_).StartSession(Request("secret")).status().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(As(robot_).ResumeSession("secret").status().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_TRUE(maps_.reached_.empty());
  EXPECT_TRUE(As(robot_).Localize("office", {}).ok()) << "extend includes read";
  const auto session = As(robot_).StartSession(Request("office"));
  ASSERT_TRUE(session.ok()) << session.status();
  EXPECT_EQ(maps_.client_, "token robot");
  EXPECT_TRUE((*session)->AddFrame({}).ok());
  EXPECT_TRUE(As(robot_).ResumeSession("office").ok());
}

TEST_F(AccessTest, IsNotReadyWhileNobodyGetsIn) {
  EXPECT_TRUE(access_->Ready().ok());
  std::ofstream(options_.tokens) << "{ no tokens";
  EXPECT_EQ(access_->Ready().code(), absl::StatusCode::kUnavailable);
}

TEST_F(AccessTest, ARevokedTokenEndsWhatItBegan) {
  const auto session = *As(robot_).StartSession(Request("office"));
  const auto tracker = *As(robot_).NewTracker("office", {});
  const auto feed = *As(robot_).Follow("office", {});
  EXPECT_TRUE(session->AddFrame({}).ok() && tracker->Track({}).ok() && feed->Next({}).ok());
  ASSERT_TRUE(RevokeToken(options_.tokens, "robot").ok());
  EXPECT_EQ(session->AddFrame({}).status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(session->Finish().status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(tracker->Track({}).status().code(), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(feed->Next({}).status().code(), absl::StatusCode::kUnauthenticated);
}

TEST_F(AccessTest, ChangesAreWrittenDownWithWhoMadeThemAndSoAreAttempts) {
  AuthorizedMaps robot = As(robot_), reader = As(reader_);
  EXPECT_TRUE((*robot.StartSession(Request("office")))->Finish().ok());
  EXPECT_FALSE(reader.StartSession(Request("office")).ok());
  EXPECT_TRUE(robot.Describe("office").ok()) << "changes nothing";
  const std::vector<json> lines = Audit();
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0]["action"], "session_started");
  EXPECT_EQ(lines[0]["token"], "robot");
  EXPECT_EQ(lines[0]["peer"], "192.0.2.7");
  EXPECT_EQ(lines[0]["map"], "office");
  EXPECT_EQ(lines[0]["request"], "r1");
  EXPECT_EQ(lines[0]["outcome"], "ok");
  EXPECT_EQ(lines[1]["action"], "session_finished");
  EXPECT_EQ(lines[1]["details"]["frames"], 0);
  EXPECT_EQ(lines[2]["token"], "reader");
  EXPECT_EQ(lines[2]["outcome"], "permission_denied");
}

// By which the server names them when it has waited for them in vain.
TEST_F(AccessTest, WhoseSessionItIsIsKnownUntilItHasEnded) {
  { const auto left = *As(robot_).StartSession(Request("office")); }
  const std::optional<Client> held = access_->LetGo("office", SessionId());
  ASSERT_TRUE(held.has_value());
  EXPECT_EQ(held->token_name, "robot");
  EXPECT_EQ(held->peer, "192.0.2.7");
  EXPECT_FALSE(access_->LetGo("office", SessionId()).has_value());
  EXPECT_TRUE((*As(robot_).StartSession(Request("office")))->Finish().ok());
  EXPECT_FALSE(access_->LetGo("office", SessionId()).has_value());
}

TEST_F(AccessTest, ASessionThatCouldNotGoOnIsNoneThatItsClientLeft) {
  { const auto left = *As(robot_).StartSession(Request("office")); }
  {
    const auto revoked = *As(robot_).StartSession(Request("office"));
    ASSERT_TRUE(RevokeToken(options_.tokens, "robot").ok());
    EXPECT_FALSE(revoked->AddFrame({}).ok());
  }
  const std::vector<json> lines = Audit();
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(lines[1]["action"], "session_left");
  EXPECT_EQ(lines[1]["outcome"], "ok");
  EXPECT_EQ(lines[3]["action"], "session_failed");
  EXPECT_EQ(lines[3]["outcome"], "unauthenticated");
}

TEST_F(AccessTest, ASessionThatEndsWithTheServerIsNotLeftByItsClient) {
  const auto gone = [&] { return *As(robot_).StartSession(Request("office")); };
  gone();
  auto open = gone();
  access_->BeginStop();
  open.reset();
  Client robot;
  robot.token_name = "robot";
  access_->Hold("lobby", SessionId(7), robot);
  access_->RecordCutOff();
  access_->RecordCutOff();
  const std::vector<json> lines = Audit();
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[1]["action"], "session_left");
  EXPECT_EQ(lines[3]["action"], "session_cut_off");
  EXPECT_EQ(lines[3]["map"], "lobby");
  EXPECT_EQ(lines[3]["token"], "robot");
  EXPECT_EQ(lines[3]["details"]["session"], 7);
  EXPECT_EQ(lines[4]["map"], "office");
}

// However often they knock.
TEST_F(AccessTest, WhoIsNotKnownLeavesALineASecond) {
  Caller caller;
  caller.peer = "192.0.2.9";
  const absl::Status refused = access_->Identify(caller).status();
  for (int i = 0; i < 100; ++i) access_->RecordUnknown(caller, "r" + std::to_string(i), refused);
  std::vector<json> lines = Audit();
  ASSERT_LE(lines.size(), 2u);  // a slow machine may come to a second one
  EXPECT_EQ(lines[0]["action"], "unknown_client");
  EXPECT_EQ(lines[0]["peer"], "192.0.2.9");
  EXPECT_EQ(lines[0]["request"], "r0");
  EXPECT_EQ(lines[0]["outcome"], "unauthenticated");
  EXPECT_EQ(lines[0]["details"]["attempts"], 1);
}

TEST_F(AccessTest, LinesThatCannotBeWrittenAreCounted) {
  EXPECT_FALSE(As(reader_).StartSession(Request("office")).ok());
  EXPECT_EQ(access_->lost_audit_lines(), 0);
  std::filesystem::rename(options_.audit_log, options_.audit_log + ".1");
  std::filesystem::create_directory(options_.audit_log);
  EXPECT_TRUE(As(robot_).StartSession(Request("office")).ok()) << "the change stands";
  EXPECT_GE(access_->lost_audit_lines(), 1);
}

TEST_F(AccessTest, ALogThatWasMovedAwayIsMadeAnew) {
  EXPECT_FALSE(As(reader_).StartSession(Request("office")).ok());
  std::filesystem::rename(options_.audit_log, options_.audit_log + ".1");
  EXPECT_FALSE(As(reader_).StartSession(Request("office")).ok());
  EXPECT_EQ(Audit().size(), 1u);
  options_.audit_log = folder_ + "/none/audit.jsonl";
  EXPECT_EQ(Access::Open(options_).status().code(), absl::StatusCode::kFailedPrecondition);
}

// Where no tokens are asked for, this machine's own clients may do what they like.
TEST_F(AccessTest, WithoutTokensClientsAreCountedByAddress) {
  options_.tokens = "";
  access_ = *Access::Open(options_);
  Caller caller;
  for (const char* local : {"unix", "127.0.0.1", "127.8.0.1", "::1", "::ffff:127.0.0.1"}) {
    caller.peer = local;
    EXPECT_EQ(access_->Identify(caller)->limited_as, "") << local;
  }
  caller.peer = "192.0.2.7";
  EXPECT_EQ(access_->Identify(caller)->limited_as, "peer 192.0.2.7");
  EXPECT_TRUE(access_->Require(*access_->Identify(caller), Right::kAdmin, "*").ok());
}

TEST_F(AccessTest, KeepingMapsNeedsItsRights) {
  Token wanted;
  wanted.name = "keeper";
  wanted.maps = {"office", "copy"};
  wanted.right = Right::kAdmin;
  const std::string keeper = *CreateToken(options_.tokens, wanted, absl::ToUnixSeconds(absl::Now()));
  access_ = *Access::Open(options_);
  const auto denied = [](const auto& result) { return absl::IsPermissionDenied(result.status()); };

  AuthorizedMaps reads = As(reader_);
  EXPECT_TRUE(reads.Verify("office", api::VerifyDepth::kStored).ok());
  EXPECT_TRUE(reads.Log("office", {}).ok());
  EXPECT_TRUE(reads.Export("office", api::ExportContent::kMap, nullptr).ok());
  EXPECT_EQ(reads.Sessions("office")->size(), 1u) << "not those of other maps";
  EXPECT_TRUE(reads.LocalizeAcross({}, {}).ok());
  EXPECT_TRUE(maps_.reached_.contains("across office")) << "only what it may read";
  EXPECT_TRUE(denied(reads.LocalizeAcross({"office", "secret"}, {})));
  EXPECT_TRUE(denied(reads.Verify("secret", api::VerifyDepth::kStored)));
  EXPECT_TRUE(denied(reads.Log("secret", {})));
  EXPECT_TRUE(absl::IsPermissionDenied(reads.Export("secret", api::ExportContent::kMap, nullptr)));
  EXPECT_TRUE(denied(reads.Sessions("secret")));
  EXPECT_TRUE(denied(reads.Create("office", "")));
  EXPECT_TRUE(reads.ListDeleted()->empty());

  AuthorizedMaps extends = As(robot_);
  EXPECT_TRUE(extends.Create("office", "").ok());
  EXPECT_TRUE(denied(extends.Snapshot("office", "office")));
  EXPECT_TRUE(denied(extends.Delete("office")));
  EXPECT_TRUE(denied(extends.Restore("office.1", "")));
  EXPECT_TRUE(denied(extends.RemoveSession("office", SessionId(1))));
  EXPECT_TRUE(denied(extends.Align("office", {})));

  AuthorizedMaps keeps = As(keeper);
  EXPECT_TRUE(keeps.Snapshot("office", "copy").ok());
  EXPECT_TRUE(denied(keeps.Snapshot("office", "secret")));
  EXPECT_TRUE(denied(keeps.Snapshot("secret", "copy")));
  EXPECT_TRUE(keeps.Delete("office").ok());
  EXPECT_EQ(keeps.ListDeleted()->size(), 1u);
  EXPECT_TRUE(keeps.Restore("office.1", "copy").ok());
  const json restored = Audit().back();
  EXPECT_EQ(restored["action"], "map_restored");
  EXPECT_EQ(restored["map"], "office");
  EXPECT_TRUE(denied(keeps.Restore("office.1", "secret")));
  EXPECT_TRUE(denied(keeps.Restore("secret.1", "copy")));
  EXPECT_TRUE(keeps.RemoveSession("office", SessionId(1)).ok());
  EXPECT_TRUE(keeps.Align("office", {}).ok());
  std::vector<std::string> written;
  for (const json& line : Audit())
    written.push_back(line["action"].get<std::string>() + " " + line["map"].get<std::string>());
  EXPECT_THAT(written,
              testing::IsSupersetOf({"map_created office", "map_copied copy", "map_copied secret", "map_deleted office",
                                     "map_restored office", "map_aligned office", "session_removed office"}));
}

}  // namespace
}  // namespace cairn::server
