#include "engine/map_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "store/test_maps.h"

namespace cairn::engine {
namespace {

using store::testing::MapGrower;
using store::testing::SameBits;
using store::testing::TempFolder;
using ::testing::HasSubstr;

std::unique_ptr<MapWriter> NewMap(const std::string& path) {
  auto writer = MapWriter::Create(path, store::testing::TestInfo(), {});
  EXPECT_TRUE(writer.ok()) << writer.status();
  return *std::move(writer);
}

TEST(MapWriter, WhatIsStoredInTheBackgroundIsAllInTheFile) {
  const TempFolder folder;
  const auto writer = NewMap(folder.File("map.cairn"));
  writer->StoreInBackground();
  MapGrower grower(3);
  ASSERT_TRUE(writer->Commit(grower.Start(writer->Current())).ok());
  for (int i = 0; i < 12; ++i) {
    const auto next = writer->Commit(grower.AddKeyframe(writer->Current()));
    ASSERT_TRUE(next.ok()) << next.status();
    EXPECT_EQ((*next)->revision(), writer->Current()->revision());
  }
  ASSERT_TRUE(writer->Close().ok());
  const auto reopened = MapWriter::Open(folder.File("map.cairn"));
  ASSERT_TRUE(reopened.ok()) << reopened.status();
  EXPECT_EQ((*reopened)->Current()->keyframes().size(), 12u);
  EXPECT_TRUE(SameBits(*(*reopened)->Current(), *writer->Current()));
}

TEST(MapWriter, WhatIsUnderWayWhenItIsDestroyedIsStored) {
  const TempFolder folder;
  Revision last;
  {
    const auto writer = NewMap(folder.File("map.cairn"));
    writer->StoreInBackground();
    MapGrower grower(4);
    ASSERT_TRUE(writer->Commit(grower.Start(writer->Current())).ok());
    for (int i = 0; i < 3; ++i) ASSERT_TRUE(writer->Commit(grower.AddKeyframe(writer->Current())).ok());
    last = writer->Current()->revision();
  }
  const auto reopened = MapWriter::Open(folder.File("map.cairn"));
  ASSERT_TRUE(reopened.ok()) << reopened.status();
  EXPECT_EQ((*reopened)->Current()->revision(), last);
}

TEST(MapWriter, AChangeThatCannotBeStoredStopsAllThatFollow) {
  const TempFolder folder;
  const auto writer = NewMap(folder.File("map.cairn"));
  MapGrower grower(5);
  ASSERT_TRUE(writer->Commit(grower.Start(writer->Current())).ok());
  ASSERT_TRUE(writer->Commit(grower.AddKeyframe(writer->Current())).ok());
  const Revision good = writer->Current()->revision();
  writer->StoreInBackground();
  // The map in memory takes a camera without a focal length, the file does not.
  map::Edit edit(writer->Current());
  map::MapCamera camera;
  camera.name = "broken";
  edit.AddCamera(camera);
  ASSERT_TRUE(writer->Commit(edit.Finish("a broken camera")).ok());
  EXPECT_THAT(std::string(writer->Flush().message()), HasSubstr("change rejected"));
  EXPECT_FALSE(writer->Commit(grower.AddKeyframe(writer->Current())).ok());
  EXPECT_FALSE(writer->Close().ok());
  const auto file = store::OpenMapStore(folder.File("map.cairn"), store::OpenMode::kRead);
  ASSERT_TRUE(file.ok()) << file.status();
  const auto stored = (*file)->LoadSnapshot();
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ((*stored)->revision(), good);
}

}  // namespace
}  // namespace cairn::engine
