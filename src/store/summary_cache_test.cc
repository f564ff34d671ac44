#include "store/summary_cache.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "store/sqlite_map_store.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using testing::MapGrower;
using testing::TempFolder;
using testing::TestInfo;

// Makes it look as if it had been written so long ago.
void Age(const std::string& path, std::chrono::seconds age) {
  std::filesystem::last_write_time(path, std::filesystem::file_time_type::clock::now() - age);
}

TEST(SummaryCache, IsAsTheFileIs) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  SummaryCache cache;
  EXPECT_EQ(FaultOf(cache.Read(path).status()), Fault::kNotFound);
  MapGrower grower(1);
  auto map = map::Snapshot::Empty(TestInfo());
  {
    auto file = *SqliteMapStore::Create(path, TestInfo());
    const map::Delta start = grower.Start(map);
    ASSERT_TRUE(file->Commit(start).ok());
    map = *map->Apply(start);
    EXPECT_EQ(cache.Read(path)->revision, 1u) << "while it is written";
    const map::Delta next = grower.AddKeyframe(map);
    ASSERT_TRUE(file->Commit(next).ok());
    map = *map->Apply(next);
    EXPECT_EQ(cache.Read(path)->revision, 2u);
    ASSERT_TRUE(file->Close().ok());
  }
  Age(path, std::chrono::seconds(60));
  EXPECT_EQ(cache.Read(path)->keyframes, 1);
  {
    auto file = *SqliteMapStore::Open(path);
    ASSERT_TRUE(file->Commit(grower.AddKeyframe(map)).ok());
    EXPECT_EQ(cache.Read(path)->keyframes, 2) << "in its log";
    ASSERT_TRUE(file->Close().ok());
  }
  EXPECT_EQ(cache.Read(path)->keyframes, 2);
  std::filesystem::remove(path);
  EXPECT_EQ(FaultOf(cache.Read(path).status()), Fault::kNotFound);
}

// What is kept is not read again: it is answered although nobody could read it.
TEST(SummaryCache, ReadsWhatHasChangedOnly) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  ASSERT_TRUE((*SqliteMapStore::Create(path, TestInfo()))->Close().ok());
  const auto damage = [&] {  // without a trace in its size and time
    const auto time = std::filesystem::last_write_time(path);
    std::fstream(path, std::ios::in | std::ios::out | std::ios::binary) << "this is no map any more";
    std::filesystem::last_write_time(path, time);
  };
  Age(path, std::chrono::seconds(60));
  SummaryCache cache;
  ASSERT_TRUE(cache.Read(path).ok());
  damage();
  EXPECT_TRUE(cache.Read(path).ok());
  EXPECT_FALSE(SummaryCache().Read(path).ok());
  Age(path, std::chrono::seconds(30));
  EXPECT_FALSE(cache.Read(path).ok()) << "it has changed";
}

// Two changes may have the same time.
TEST(SummaryCache, WhatWasChangedJustNowIsNotKept) {
  const TempFolder folder;
  const std::string path = folder.File("a.cairn");
  ASSERT_TRUE((*SqliteMapStore::Create(path, TestInfo()))->Close().ok());
  SummaryCache cache;
  ASSERT_TRUE(cache.Read(path).ok());
  const auto time = std::filesystem::last_write_time(path);
  std::fstream(path, std::ios::in | std::ios::out | std::ios::binary) << "this is no map any more";
  std::filesystem::last_write_time(path, time);
  EXPECT_FALSE(cache.Read(path).ok());
}

}  // namespace
}  // namespace cairn::store
