// Following a map over gRPC: the call, and the client that keeps a copy.
#include <cairn/v1/follow.grpc.pb.h>
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <thread>

#include "cairn/map.h"
#include "client/conformance/conformance_map.h"
#include "client/local_tracker.h"
#include "client/remote/followed_map.h"
#include "map/edit.h"
#include "server/grpc/testing_server.h"
#include "store/digest.h"
#include "store/fault.h"
#include "store/map_store.h"
#include "wire/convert_deltas.h"

namespace cairn::server {
namespace {

using client::FollowedMap;
using std::chrono::seconds;

std::chrono::steady_clock::time_point In(seconds time) { return std::chrono::steady_clock::now() + time; }

class FollowMapTest : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/follow_map_test_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    path_ = directory_ + "/room.cairn";
    ASSERT_TRUE(conformance::WriteConformanceMap(path_).ok());
    Start();
  }
  void TearDown() override {
    writer_.reset();
    server_.reset();
    std::filesystem::remove_all(directory_);
  }
  // On the port of the one before, if there was one.
  void Start() {
    server_.reset();
    auto server = TestingServer::Start(directory_, {}, port_);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    port_ = server_->grpc->port();
  }

  std::shared_ptr<FollowedMap> Follow() {
    auto service = client::RemoteMapService::Connect(server_->Remote());
    EXPECT_TRUE(service.ok()) << service.status();
    auto followed = (*service)->CopyOf("room");
    EXPECT_TRUE(followed.ok()) << followed.status();
    return followed.ok() ? *followed : nullptr;
  }

  // As another process would: `count` revisions, each of which moves a keyframe and what it sees.
  void Change(int count) {
    if (writer_ == nullptr) {
      auto writer = store::OpenMapStore(path_, store::OpenMode::kWrite, {.sync_every_commit = false});
      ASSERT_TRUE(writer.ok()) << writer.status();
      writer_ = *std::move(writer);
      map_ = *writer_->LoadSnapshot();
    }
    for (int i = 0; i < count; ++i) {
      map::Edit edit(map_);
      const auto id = KeyframeId(static_cast<KeyframeId::Value>(1 + i % 3));
      edit.SetPose(id, SE3(ExpSO3(Vector3d(0, 1e-4, 0)), Vector3d(1e-4, 0, 0)) * map_->keyframe(id).camera_from_map);
      const map::Delta delta = edit.Finish("moved");
      map_ = *map_->Apply(delta);
      ASSERT_TRUE(writer_->Commit(delta).ok());
    }
  }

  std::string directory_, path_;
  int port_ = 0;
  std::unique_ptr<TestingServer> server_;
  std::unique_ptr<store::MapStore> writer_;
  std::shared_ptr<const map::Snapshot> map_;  // that the writer has made
};

TEST_F(FollowMapTest, TheCallGivesAViewWithItsVocabularyAndThenSignsOfLife) {
  const auto channel = grpc::CreateChannel(server_->Remote().server, grpc::InsecureChannelCredentials());
  grpc::ClientContext context;
  v1::FollowMapRequest request;
  request.set_map("room");
  const auto stream = v1::Follow::NewStub(channel)->FollowMap(&context, request);
  wire::UpdateReader reader(nullptr);
  v1::FollowMapResponse message;
  for (bool last = false; !last;) {
    ASSERT_TRUE(stream->Read(&message));
    const auto read = reader.Read(message);
    ASSERT_TRUE(read.ok()) << read.status();
    last = *read;
  }
  const auto update = reader.Take();
  ASSERT_TRUE(update.ok()) << update.status();
  EXPECT_EQ(update->vocabulary, conformance::TheConformanceMap().vocabulary);
  const auto map = update->base->Apply(update->delta);
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(store::ContentDigest(**map), store::ContentDigest(*conformance::TheConformanceMap().snapshot));
  ASSERT_TRUE(stream->Read(&message));
  ASSERT_TRUE(message.has_up_to_date());
  EXPECT_EQ(message.up_to_date().revision(), (*map)->revision());
  context.TryCancel();
}

TEST_F(FollowMapTest, RequestsThatMakeNoSense) {
  const auto channel = grpc::CreateChannel(server_->Remote().server, grpc::InsecureChannelCredentials());
  const auto code = [&](const std::string& map, int interval_ms) {
    grpc::ClientContext context;
    v1::FollowMapRequest request;
    request.set_map(map);
    request.set_min_interval_ms(interval_ms);
    v1::FollowMapResponse message;
    const auto stream = v1::Follow::NewStub(channel)->FollowMap(&context, request);
    EXPECT_FALSE(stream->Read(&message));
    return stream->Finish().error_code();
  };
  EXPECT_EQ(code("kitchen", 0), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(code("../room", 0), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code("room", -1), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(code("room", 100'000), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(FollowMapTest, TheCopyIsTheServersMapAsItChanges) {
  const auto followed = Follow();
  ASSERT_NE(followed, nullptr);
  EXPECT_TRUE(followed->connection().connected);
  EXPECT_TRUE(followed->problem().ok());
  for (int round = 0; round < 3; ++round) {
    ASSERT_NO_FATAL_FAILURE(Change(5));
    ASSERT_TRUE(followed->WaitFor(map_->revision(), In(seconds(20))));
    EXPECT_EQ(store::ContentDigest(followed->view()->map()), store::ContentDigest(*map_));
    EXPECT_TRUE(followed->view()->map().CheckConsistency().ok());
  }
  EXPECT_EQ(followed->traffic().views, 1);
  EXPECT_GE(followed->traffic().changes, 3);
}

TEST_F(FollowMapTest, WhatWasMissedIsAskedForAlsoOfAServerThatWasRestarted) {
  const auto followed = Follow();
  ASSERT_NE(followed, nullptr);
  const std::int64_t view_bytes = followed->traffic().bytes;
  followed->Disconnect();
  EXPECT_FALSE(followed->connection().connected);
  EXPECT_FALSE(followed->problem().ok());
  ASSERT_NO_FATAL_FAILURE(Change(100));
  EXPECT_FALSE(followed->WaitFor(map_->revision(), In(seconds(0))));
  // The server reads what others write a little later: it has all of it when another copy has.
  ASSERT_TRUE(Follow()->WaitFor(map_->revision(), In(seconds(20))));
  followed->Reconnect();
  ASSERT_TRUE(followed->WaitFor(map_->revision(), In(seconds(20))));
  EXPECT_EQ(store::ContentDigest(followed->view()->map()), store::ContentDigest(*map_));
  server_.reset();
  ASSERT_NO_FATAL_FAILURE(Change(20));
  Start();
  ASSERT_TRUE(followed->WaitFor(map_->revision(), In(seconds(20))));
  EXPECT_EQ(store::ContentDigest(followed->view()->map()), store::ContentDigest(*map_));
  EXPECT_EQ(followed->traffic().views, 1) << "the rest is not sent again";
  EXPECT_EQ(followed->traffic().changes, 2);
  EXPECT_LT(followed->traffic().bytes, 2 * view_bytes);
  EXPECT_TRUE(followed->connection().connected);
  EXPECT_TRUE(followed->problem().ok()) << followed->problem();
}

TEST_F(FollowMapTest, ARegionMovesAlongAndChanges) {
  const auto around = [](std::uint32_t keyframe) {
    map::RegionQuery region;
    region.around = {KeyframeId(keyframe)};
    region.max_keyframes = 3;
    return region;
  };
  const client::RemoteOptions options = server_->Remote();
  auto copy = FollowedMap::Start(options, client::NewChannel(options), "room", around(2));
  ASSERT_TRUE(copy.ok()) << copy.status();
  const auto keyframes = [&] {
    std::vector<KeyframeId> ids;
    (*copy)->view()->map().keyframes().ForEach([&](const auto& keyframe) { ids.push_back(keyframe->id); });
    return ids;
  };
  const auto until = [&](const auto& done) {
    const auto end = In(seconds(20));
    while (!done() && std::chrono::steady_clock::now() < end) std::this_thread::yield();
    EXPECT_TRUE(done());
  };
  const map::Snapshot& map = *conformance::TheConformanceMap().snapshot;
  EXPECT_EQ(keyframes(), map::KeyframesAround(map, around(2)));
  const std::int64_t view_bytes = (*copy)->traffic().bytes;
  for (const std::uint32_t keyframe : {5u, 9u, 3u}) {  // and back to what was there before
    (*copy)->MoveTo(around(keyframe));
    until([&] { return keyframes() == map::KeyframesAround(map, around(keyframe)); });
    const map::Snapshot& region = (*copy)->view()->map();
    EXPECT_TRUE(region.CheckConsistency().ok()) << region.CheckConsistency();
    EXPECT_EQ(region.keyframe(KeyframeId(keyframe)).descriptors(), map.keyframe(KeyframeId(keyframe)).descriptors());
    EXPECT_TRUE((*copy)->connection().connected);
  }
  EXPECT_EQ((*copy)->traffic().views, 1);
  EXPECT_LT((*copy)->traffic().bytes, 5 * view_bytes);
  ASSERT_NO_FATAL_FAILURE(Change(6));
  ASSERT_TRUE((*copy)->WaitFor(map_->revision(), In(seconds(20))));
  EXPECT_TRUE((*copy)->view()->map().CheckConsistency().ok());
  EXPECT_EQ((*copy)->view()->map().keyframe(KeyframeId(3)).camera_from_map.translation(),
            map_->keyframe(KeyframeId(3)).camera_from_map.translation());
}

// As a program that links the library sees it.
TEST_F(FollowMapTest, ThePublicLibraryOpensAMapOfAServer) {
  const std::string uri = absl::StrCat("cairn://127.0.0.1:", port_, "/room");
  const auto map = v0::Map::Open(uri);
  ASSERT_TRUE(map.ok()) << map.status();
  const auto info = map->Info();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->id, conformance::TheConformanceMap().snapshot->info().id);
  ASSERT_FALSE(info->cameras.empty());
  auto tracker = map->NewTracker(info->cameras[0].camera);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  const cv::Mat image = conformance::TheConformanceMap().room.Render(conformance::TheConformanceMap().pinhole,
                                                                     conformance::LookInRoom({0.2, 0.0, -1.4}, 0.05));
  const v0::ImageView view{image.data, image.cols, image.rows, static_cast<int>(image.step), v0::PixelFormat::kGray8};
  const auto tracked = tracker->Track(view, 1'000'000'000);
  ASSERT_TRUE(tracked.ok()) << tracked.status();
  EXPECT_EQ(tracked->state, v0::TrackState::kLocated) << tracked->reason;
  EXPECT_TRUE(tracked->connected);
  EXPECT_LT(tracked->map_age_s, 60.0);
  ASSERT_NO_FATAL_FAILURE(Change(3));
  const auto end = In(seconds(20));
  while (map->Info()->revision != map_->revision() && std::chrono::steady_clock::now() < end) {
    EXPECT_TRUE(map->Refresh().ok());
  }
  EXPECT_EQ(map->Info()->revision, map_->revision());
  EXPECT_TRUE(absl::IsNotFound(v0::Map::Open(absl::StrCat("cairn://127.0.0.1:", port_, "/kitchen")).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(v0::Map::Open("cairn://room").status()));
  server_.reset();
  const auto refreshed = map->Refresh();
  EXPECT_TRUE(refreshed.ok() || absl::IsUnavailable(refreshed.status())) << refreshed.status();
  EXPECT_TRUE(absl::IsUnavailable(v0::Map::Open(uri).status()));
  EXPECT_TRUE(map->Info().ok()) << "what is known is good";
}

TEST_F(FollowMapTest, ATrackerWorksThroughAnOutageAndSaysSo) {
  auto service = *client::RemoteMapService::Connect(server_->Remote());
  const conformance::ConformanceMap& map = conformance::TheConformanceMap();
  auto tracker = service->NewTracker("room", Camera::FromPinhole(map.pinhole));
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  TimeNs time_ns = 1'000'000'000;
  int frame = 0;
  const auto track = [&] {
    const SE3 pose = conformance::LookInRoom({0.005 * frame++, 0.0, -1.4}, 0.0);
    const auto answer = (*tracker)->Track({map.room.Render(map.pinhole, pose), time_ns += 33'333'333});
    EXPECT_TRUE(answer.ok()) << answer.status();
    EXPECT_NE(answer->state, api::TrackState::kLost) << answer->reason;
    return *answer;
  };
  api::TrackAnswer answer = track();
  EXPECT_TRUE(answer.connected);
  EXPECT_TRUE(answer.note.empty()) << answer.note;
  server_.reset();
  const auto begun = std::chrono::steady_clock::now();
  const auto until = [&](auto done) {
    do {
      answer = track();
    } while (!done(answer) && std::chrono::steady_clock::now() < begun + seconds(60));
    EXPECT_TRUE(done(answer));
  };
  until([](const api::TrackAnswer& given) { return !given.connected && !given.note.empty(); });
  const double age_s = answer.map_age_s;
  answer = track();
  EXPECT_GT(answer.map_age_s, age_s);
  Start();
  until([](const api::TrackAnswer& given) { return given.connected && given.note.empty(); });
}

TEST_F(FollowMapTest, AnotherMapOfThatNameIsNotFollowed) {
  const auto followed = Follow();
  ASSERT_NE(followed, nullptr);
  const Revision revision = followed->view()->revision();
  std::filesystem::remove(path_);
  map::MapInfo info = conformance::TheConformanceMap().snapshot->info();
  info.id[0] = info.id[0] == 'a' ? 'b' : 'a';
  map::Delta delta = conformance::TheConformanceMap().delta;
  delta.info = info;
  auto other = store::CreateMapStore(path_, info, {.vocabulary = conformance::TheConformanceMap().vocabulary});
  ASSERT_TRUE(other.ok()) << other.status();
  ASSERT_TRUE((*other)->Commit(delta).ok());
  const auto begun = std::chrono::steady_clock::now();
  while (!absl::IsAborted(followed->problem()) && std::chrono::steady_clock::now() < begun + seconds(20)) {
    std::this_thread::yield();
  }
  EXPECT_EQ(store::FaultOf(followed->problem()), store::Fault::kMoved) << followed->problem();
  EXPECT_EQ(followed->view()->revision(), revision) << "what was known is good";
}

// A server that sends what it likes.
class LyingServer final : public v1::Follow::Service {
 public:
  explicit LyingServer(std::vector<v1::FollowMapResponse> messages) : messages_(std::move(messages)) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }
  ~LyingServer() override { server_->Shutdown(std::chrono::system_clock::now()); }
  grpc::Status FollowMap(grpc::ServerContext*, const v1::FollowMapRequest*,
                         grpc::ServerWriter<v1::FollowMapResponse>* writer) override {
    ++calls_;
    for (const v1::FollowMapResponse& message : messages_) writer->Write(message);
    return grpc::Status::OK;
  }
  absl::Status ErrorAtTheClient() const {
    client::RemoteOptions options;
    options.server = absl::StrCat("127.0.0.1:", port_);
    options.deadline_s = 20.0;
    auto service = client::RemoteMapService::Connect(options);
    return service.ok() ? (*service)->CopyOf("room").status() : service.status();
  }
  int calls() const { return calls_; }

 private:
  const std::vector<v1::FollowMapResponse> messages_;
  std::atomic<int> calls_ = 0;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

TEST(FollowMapClient, AServerThatLiesIsAnErrorAfterAFewAttempts) {
  v1::FollowMapResponse begin, rows, up_to_date, end;
  begin.mutable_begin()->set_whole(true);
  begin.mutable_begin()->set_revision(5);
  rows.mutable_rows()->add_keyframes()->set_id(1);
  up_to_date.mutable_up_to_date()->set_revision(5);
  end.mutable_end();
  const std::vector<std::vector<v1::FollowMapResponse>> lies = {
      {}, {up_to_date}, {rows}, {begin, rows, end}, {begin, begin}, {end}, {v1::FollowMapResponse()}};
  for (const auto& messages : lies) {
    const LyingServer server(messages);
    const absl::Status status = server.ErrorAtTheClient();
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    EXPECT_GE(server.calls(), 2);
    EXPECT_LE(server.calls(), 10);
  }
}

}  // namespace
}  // namespace cairn::server
