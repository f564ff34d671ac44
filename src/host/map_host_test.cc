#include "host/map_host.h"

#include <gmock/gmock.h>

#include <thread>

#include "client/conformance/localizer_conformance.h"
#include "client/conformance/map_admin_conformance.h"
#include "client/conformance/map_service_conformance.h"
#include "map/edit.h"

namespace cairn::conformance {
namespace {

absl::StatusOr<std::unique_ptr<host::MapHost>> OpenHost(const std::string& directory, std::int64_t budget = 1 << 30) {
  host::MapHostOptions options;
  options.directory = directory;
  options.memory_budget_bytes = budget;
  options.refresh_interval_s = 0.0;
  return host::MapHost::Open(options);
}

absl::StatusOr<std::unique_ptr<api::MapService>> OpenService(const std::string& directory) {
  return OpenHost(directory);
}

class HostedLocalizer : public api::Localizer {
 public:
  HostedLocalizer(std::unique_ptr<host::MapHost> host, const std::string& map)
      : host_(std::move(host)), localizer_(host_.get(), map) {}
  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer_.Localize(query);
  }

 private:
  std::unique_ptr<host::MapHost> host_;
  api::ServedLocalizer localizer_;
};

absl::StatusOr<std::unique_ptr<api::Localizer>> OpenHosted(const std::string& path) {
  const std::filesystem::path file(path);
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<host::MapHost> host, OpenHost(file.parent_path().string()));
  return std::make_unique<HostedLocalizer>(std::move(host), file.stem().string());
}

INSTANTIATE_TEST_SUITE_P(Hosted, LocalizerConformance, testing::Values(LocalizerFactory(&OpenHosted)));
INSTANTIATE_TEST_SUITE_P(Hosted, MapServiceConformance, testing::Values(MapServiceFactory(&OpenService)));
INSTANTIATE_TEST_SUITE_P(Hosted, MapAdminConformance, testing::Values(MapServiceFactory(&OpenService)));
INSTANTIATE_TEST_SUITE_P(Hosted, MapSessionConformance, testing::Values(MapServiceFactory(&OpenService)));

class MapHost : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/map_host_test_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    for (const char* name : {"a", "b", "c"}) ASSERT_TRUE(WriteConformanceMap(Path(name)).ok());
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }

  std::string Path(const std::string& name) const { return directory_ + "/" + name + ".cairn"; }
  static std::vector<std::string> OpenOf(host::MapHost& host) {
    std::vector<std::string> names;
    for (const host::MapHost::OpenMap& map : host.OpenMaps()) names.push_back(map.name);
    return names;
  }

  std::string directory_;
};

TEST_F(MapHost, TheOneUsedLongestAgoMakesRoom) {
  const std::int64_t bytes = [&] {
    const auto host = *OpenHost(directory_);
    EXPECT_TRUE(host->Describe("a").ok());
    return host->OpenMaps().at(0).bytes;
  }();
  EXPECT_GT(bytes, 0);
  EXPECT_LT(bytes, static_cast<std::int64_t>(std::filesystem::file_size(Path("a")))) << "it is ready, not loaded";
  const auto host = *OpenHost(directory_, 2 * bytes + bytes / 2);
  EXPECT_THAT(OpenOf(*host), testing::IsEmpty());
  for (const char* name : {"a", "b", "a", "c"}) ASSERT_TRUE(host->Describe(name).ok());
  EXPECT_THAT(OpenOf(*host), testing::ElementsAre("a", "c"));
  const auto small = *OpenHost(directory_, 1);
  for (const char* name : {"a", "b"}) ASSERT_TRUE(small->Describe(name).ok());
  EXPECT_THAT(OpenOf(*small), testing::ElementsAre("b")) << "what is asked for is answered in any case";
}

TEST_F(MapHost, IdleMapsAreClosed) {
  host::MapHostOptions options;
  options.directory = directory_;
  options.idle_close_s = 60.0;
  const auto host = *host::MapHost::Open(options);
  ASSERT_TRUE(host->Describe("a").ok());
  host->CloseIdle(host::MapHost::Clock::now() + std::chrono::seconds(30));
  EXPECT_THAT(OpenOf(*host), testing::ElementsAre("a"));
  host->CloseIdle(host::MapHost::Clock::now() + std::chrono::seconds(61));
  EXPECT_THAT(OpenOf(*host), testing::IsEmpty());
  EXPECT_TRUE(host->Describe("a").ok());
}

TEST_F(MapHost, FollowsAnotherProcess) {
  const auto host = *OpenHost(directory_);
  const Revision before = host->Describe("a")->summary.revision;
  auto writer = store::OpenMapStore(Path("a"), store::OpenMode::kWrite);
  ASSERT_TRUE(writer.ok()) << writer.status();
  map::Edit edit(*(*writer)->LoadSnapshot());
  map::Component component = edit.base().component(ComponentId(1));
  component.world_from_component = Sim3(Quaterniond::Identity(), Vector3d(0.0, 7.0, 0.0), 3.0);
  edit.PutComponent(component);
  ASSERT_TRUE((*writer)->Commit(edit.Finish("aligned anew")).ok());
  const auto after = host->Describe("a");
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_EQ(after->summary.revision, before + 1);
  EXPECT_EQ(after->components[0].world_from_component->scale(), 3.0);
}

TEST_F(MapHost, ExportsAlsoWhereNothingCanBeWritten) {
  const auto host = *OpenHost(directory_);
  std::filesystem::permissions(directory_, std::filesystem::perms(0555));
  constexpr uid_t kNobody = 65534;  // root may write everywhere
  const uid_t self = geteuid();
  if (self == 0) {
    ASSERT_EQ(seteuid(kNobody), 0);
  }
  std::string file;
  const absl::Status exported = host->Export("a", api::ExportContent::kPoints, [&](absl::string_view part) {
    return absl::StrAppend(&file, part), absl::OkStatus();
  });
  if (self == 0) {
    ASSERT_EQ(seteuid(self), 0);
  }
  std::filesystem::permissions(directory_, std::filesystem::perms(0755));
  EXPECT_TRUE(exported.ok()) << exported;
  EXPECT_EQ(file.substr(0, 3), "ply");
}

TEST_F(MapHost, OneSessionIsOne) {
  host::MapHostOptions options;
  options.directory = directory_;
  options.max_sessions = 1;
  const auto host = *host::MapHost::Open(options);
  api::SessionRequest request;
  request.map = "new";
  request.policy = map::SessionPolicy::kCreate;
  request.camera = Camera::FromPinhole(TheConformanceMap().pinhole);
  const auto first = host->StartSession(request);
  ASSERT_TRUE(first.ok()) << first.status();
  request.map = "newer";
  const absl::Status second = host->StartSession(request).status();
  EXPECT_TRUE(absl::IsResourceExhausted(second));
  EXPECT_THAT(std::string(second.message()), testing::HasSubstr("there is 1 session already"));
}

TEST_F(MapHost, ATrackerWhoseMapIsGoneDoesNotSayWhereItWas) {
  host::MapHostOptions options;
  options.directory = directory_;
  options.refresh_interval_s = 0.0;
  options.tracker.wait_for_matches = true;
  options.tracker.refresh_interval_s = 0.0;
  const auto host = *host::MapHost::Open(options);
  const ConformanceMap& map = TheConformanceMap();
  const auto tracker = host->NewTracker("a", Camera::FromPinhole(map.pinhole));
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  std::filesystem::remove(Path("a"));
  std::string told;
  for (int i = 1; i <= 20 && told.empty(); ++i) {
    const auto answer =
        (*tracker)->Track({map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)), i * 40'000'000});
    told = answer.ok() ? answer->note : std::string(answer.status().message());
  }
  EXPECT_THAT(told, testing::HasSubstr("a.cairn"));
  EXPECT_THAT(told, testing::Not(testing::HasSubstr(host->directory())));
}

TEST_F(MapHost, ManyAtOnce) {
  const auto host = *OpenHost(directory_);
  const ConformanceMap& map = TheConformanceMap();
  const api::LocalizeQuery query{map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)),
                                 Camera::FromPinhole(map.pinhole), 0};
  std::atomic<int> located = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 12; ++i) {
    threads.emplace_back([&, i] {
      const auto answer = host->Localize(std::string(1, static_cast<char>('a' + i % 3)), query);
      if (answer.ok() && answer->localized) ++located;
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(located, 12);
}

TEST_F(MapHost, ErrorsOfOptions) {
  host::MapHostOptions options;
  EXPECT_EQ(host::MapHost::Open(options).status().code(), absl::StatusCode::kInvalidArgument);
  options.directory = directory_ + "/not_there";
  EXPECT_EQ(host::MapHost::Open(options).status().code(), absl::StatusCode::kNotFound);
  options.directory = Path("a");
  EXPECT_EQ(host::MapHost::Open(options).status().code(), absl::StatusCode::kNotFound);
  options.directory = directory_;
  options.idle_close_s = 0.0;
  EXPECT_EQ(host::MapHost::Open(options).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::conformance

namespace cairn::host {
namespace {

TEST(WorkGate, WhoComesFirstGoesFirstAndTooManyAreRefused) {
  WorkGate gate(1, 1);
  std::optional<WorkGate::Pass> first(*gate.Enter());
  std::atomic<bool> in = false;
  std::thread second([&] {
    const auto pass = gate.Enter();
    in = pass.ok();
  });
  while (gate.waiting() == 0) std::this_thread::yield();
  EXPECT_FALSE(in);
  EXPECT_EQ(gate.Enter().status().code(), absl::StatusCode::kResourceExhausted);
  first.reset();
  second.join();
  EXPECT_TRUE(in);
  EXPECT_TRUE(gate.Enter().ok());
}

}  // namespace
}  // namespace cairn::host
