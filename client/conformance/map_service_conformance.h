// The test suite of api::MapService: every implementation passes the same one. Include it in one file of a test binary
// that links cairn::localizer_conformance, and instantiate it with a factory:
//
//   INSTANTIATE_TEST_SUITE_P(Hosted, MapServiceConformance, testing::Values(MapServiceFactory(&OpenHost)));
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>

#include "api/map_service.h"
#include "client/conformance/conformance_map.h"
#include "store/fault.h"

namespace cairn::conformance {

// Makes a service of the maps in `directory`. It may keep what it needs (a server, say) alive in the service.
using MapServiceFactory = std::function<absl::StatusOr<std::unique_ptr<api::MapService>>(const std::string& directory)>;

class MapServiceConformance : public testing::TestWithParam<MapServiceFactory> {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/map_service_conformance_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    ASSERT_TRUE(WriteConformanceMap(directory_ + "/room.cairn").ok());
    std::ofstream(directory_ + "/broken.cairn") << "this is no map, but long enough to be one perhaps";
    std::ofstream(directory_ + "/notes.txt") << "not listed";
    auto service = GetParam()(directory_);
    ASSERT_TRUE(service.ok()) << service.status();
    service_ = *std::move(service);
  }
  void TearDown() override {
    service_.reset();
    std::filesystem::remove_all(directory_);
  }

  static api::LocalizeQuery Query() {
    const ConformanceMap& map = TheConformanceMap();
    return {map.room.Render(map.pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05)), Camera::FromPinhole(map.pinhole), 42};
  }

  std::string directory_;
  std::unique_ptr<api::MapService> service_;
};

TEST_P(MapServiceConformance, ListsAllMapsByNameAndSaysWhatCannotBeRead) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  const auto maps = service_->List();
  ASSERT_TRUE(maps.ok()) << maps.status();
  ASSERT_EQ(maps->size(), 2u);
  const api::MapSummary& broken = (*maps)[0];
  EXPECT_EQ(broken.name, "broken");
  EXPECT_FALSE(broken.status.ok());
  EXPECT_THAT(std::string(broken.status.message()), testing::Not(testing::HasSubstr(directory_)));
  const api::MapSummary& room = (*maps)[1];
  EXPECT_EQ(room.name, "room");
  EXPECT_TRUE(room.status.ok()) << room.status;
  EXPECT_EQ(room.id, map.info().id);
  EXPECT_EQ(room.title, map.info().name);
  EXPECT_EQ(room.revision, map.revision());
  EXPECT_EQ(room.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  EXPECT_EQ(room.points, static_cast<std::int64_t>(map.points().size()));
  EXPECT_EQ(room.file_bytes, static_cast<std::int64_t>(std::filesystem::file_size(directory_ + "/room.cairn")));
  EXPECT_FALSE(room.open) << "nobody has asked for it";
  EXPECT_FALSE(room.writing);
  ASSERT_TRUE(service_->Localize("room", Query()).ok());
  EXPECT_TRUE((*service_->List())[1].open);
}

TEST_P(MapServiceConformance, DescribesAMap) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  const auto described = service_->Describe("room");
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_EQ(described->summary.name, "room");
  EXPECT_EQ(described->summary.revision, map.revision());
  EXPECT_EQ(described->summary.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  EXPECT_GE(described->summary.format_version, 4);
  ASSERT_EQ(described->cameras.size(), 1u);
  EXPECT_EQ(described->cameras[0].camera, map.cameras().begin()->second.model);
  ASSERT_EQ(described->components.size(), 1u);
  const api::ComponentInfo& component = described->components[0];
  EXPECT_EQ(component.id, ComponentId(1));
  EXPECT_EQ(component.keyframes, static_cast<std::int64_t>(map.keyframes().size()));
  ASSERT_TRUE(component.world_from_component);
  EXPECT_EQ(component.world_from_component->scale(), 2.0);
  EXPECT_FALSE(component.joined_into);
  ASSERT_EQ(described->sessions.size(), map.sessions().size());
  EXPECT_EQ(described->sessions[0].id, map.sessions().begin()->first);
}

TEST_P(MapServiceConformance, NamesDoNotLeaveTheDirectory) {
  ASSERT_TRUE(WriteConformanceMap(directory_ + "_outside.cairn").ok());
  const std::string outside = std::filesystem::path(directory_).filename().string() + "_outside";
  std::error_code error;
  std::filesystem::create_symlink(directory_ + "_outside.cairn", directory_ + "/link.cairn", error);
  for (const std::string& name : {std::string(), std::string("../") + outside, directory_ + "/room",
                                  std::string("room/../room"), std::string("room\0x", 6), std::string(".")}) {
    EXPECT_EQ(service_->Describe(name).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(service_->Localize(name, Query()).status().code(), absl::StatusCode::kInvalidArgument) << name;
  }
  EXPECT_EQ(service_->Describe("link").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->List()->size(), 2u);
  std::filesystem::remove(directory_ + "_outside.cairn");
}

TEST_P(MapServiceConformance, ErrorsSayWhichAndKeepTheirFault) {
  const absl::Status missing = service_->Localize("kitchen", Query()).status();
  EXPECT_EQ(missing.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store::FaultOf(missing), store::Fault::kNotFound);
  EXPECT_THAT(std::string(missing.message()), testing::HasSubstr("kitchen"));
  const absl::Status broken = service_->Describe("broken").status();
  EXPECT_EQ(store::FaultOf(broken), store::Fault::kNotAMap) << broken;
  EXPECT_THAT(std::string(broken.message()), testing::HasSubstr("broken"));
  EXPECT_THAT(std::string(broken.message()), testing::Not(testing::HasSubstr(directory_)));
}

// The map that a name means is the one that lies there now.
TEST_P(MapServiceConformance, MapsComeGoAndAreReplaced) {
  ASSERT_TRUE(service_->Localize("room", Query()).ok());
  std::filesystem::remove(directory_ + "/room.cairn");
  EXPECT_EQ(service_->Localize("room", Query()).status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(WriteConformanceMap(directory_ + "/room.cairn").ok());
  ASSERT_TRUE(WriteConformanceMap(directory_ + "/other.cairn").ok());
  for (const char* name : {"room", "other"}) {
    const auto answer = service_->Localize(name, Query());
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_TRUE(answer->localized) << answer->reason;
  }
}

}  // namespace cairn::conformance
