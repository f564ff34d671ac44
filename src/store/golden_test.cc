// Map files of every released format, as the software of their time wrote them (tests/golden/README.md): they are read
// as they are, and brought up to date. Images are located in them by tests/e2e/golden_test.py.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <filesystem>

#include "map/edit.h"
#include "store/testing_files.h"
#include "store/testing_maps.h"

namespace cairn::store {
namespace {

using ::testing::ElementsAre;
using testing::ExitCode;
using ::testing::HasSubstr;
using testing::InChild;
using ::testing::IsEmpty;
using testing::LoadMap;
using testing::ReadBytes;
using testing::SameBits;
using testing::TempFolder;
using ::testing::UnorderedElementsAre;

struct Golden {
  std::string name;
  int format;
  std::string digest;  // as the software of its time computed it; empty: not comparable
  Revision revision;
  std::size_t keyframes;
  std::size_t points;
  std::size_t components;
};

const Golden kGoldens[] = {
    {"format1.cairn", 1, "9bce9cf421295c7252525991cb50559c", 10, 7, 1285, 1},
    {"format2.cairn", 2, "9bce9cf421295c7252525991cb50559c", 10, 7, 1285, 1},
    {"format3.cairn", 3, "3d51a852150918dbd8791ee234af79cb", 10, 7, 1285, 1},
    // Its digest then was of a tree that a guess held together.
    {"format3_parts.cairn", 3, "", 14, 11, 1894, 2},
};

class GoldenFile : public ::testing::TestWithParam<Golden> {
 protected:
  GoldenFile() : path_(folder_.File("map.cairn")) {
    std::filesystem::copy_file(std::string(GOLDEN_FOLDER) + "/" + GetParam().name, path_);
    std::filesystem::permissions(path_, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  }
  const TempFolder folder_;
  const std::string path_;
};

TEST_P(GoldenFile, IsReadAsItIs) {
  const Golden& golden = GetParam();
  const std::string bytes = ReadBytes(path_);
  {
    auto file = OpenMapStore(path_, OpenMode::kRead);
    ASSERT_TRUE(file.ok()) << file.status();
    const auto summary = (*file)->ReadSummary();
    ASSERT_TRUE(summary.ok()) << summary.status();
    EXPECT_EQ(summary->format_version, golden.format);
    EXPECT_THAT(*(*file)->Verify(), IsEmpty());
    const auto map = (*file)->LoadSnapshot();
    ASSERT_TRUE(map.ok()) << map.status();
    EXPECT_EQ((*map)->revision(), golden.revision);
    EXPECT_EQ((*map)->keyframes().size(), golden.keyframes);
    EXPECT_EQ((*map)->points().size(), golden.points);
    EXPECT_EQ((*map)->components().size(), golden.components);
    if (!golden.digest.empty()) {
      EXPECT_EQ(*(*file)->ContentDigest(), golden.digest);
    }
    EXPECT_TRUE((*map)->CheckConsistency().ok()) << (*map)->CheckConsistency();
    // What the formats brought.
    EXPECT_TRUE((*map)->component(ComponentId(1)).world_from_component.has_value());
    EXPECT_EQ((*map)->NumKeyframes(ComponentId(1)), 7);
    const map::Session& session = (*map)->sessions().at(SessionId(1));
    EXPECT_EQ(session.loops.size(), golden.format >= 2 ? 1u : 0u);
    EXPECT_EQ(session.trajectory.has_value(), golden.format >= 2);
    EXPECT_EQ(session.result, map::SessionResult::kCreated);
    EXPECT_EQ(session.components.size(), golden.components);
    EXPECT_EQ((*map)->cameras().at(CameraId(1)).lens.has_value(), golden.format >= 3);
    const auto changes = (*file)->ReadChanges();
    ASSERT_TRUE(changes.ok()) << changes.status();
    EXPECT_EQ(changes->size(), golden.revision);
    EXPECT_EQ(changes->front().reason, "align to poses.txt");
    EXPECT_FALSE((*file)->ReadDelta(**map)->has_value());
  }
  EXPECT_TRUE(ReadBytes(path_) == bytes);
  EXPECT_THAT(folder_.Names(), ElementsAre("map.cairn"));
}

TEST_P(GoldenFile, IsBroughtUpToDate) {
  const Golden& golden = GetParam();
  const auto before = LoadMap(path_);
  const std::string backup = path_ + ".format" + std::to_string(golden.format) + "-backup";
  {
    auto file = OpenMapStore(path_, OpenMode::kWrite);
    ASSERT_TRUE(file.ok()) << file.status();
    EXPECT_THAT((*file)->notes(), ElementsAre(HasSubstr(backup)));
    EXPECT_EQ((*file)->ReadSummary()->format_version, SupportedFormatVersion());
    EXPECT_TRUE(SameBits(**(*file)->LoadSnapshot(), *before));
    EXPECT_THAT(*(*file)->Verify(), IsEmpty());
    EXPECT_EQ((*file)->ReadChanges()->size(), golden.revision);
    // What was read from the old file can be followed.
    map::Edit edit(before);
    map::Component component = before->component(ComponentId(1));
    component.world_from_component.reset();
    edit.PutComponent(component);
    const map::Delta delta = edit.Finish("not aligned any more");
    ASSERT_TRUE((*file)->Commit(delta).ok());
    const auto read = (*file)->ReadDelta(*before);
    ASSERT_TRUE(read.ok() && read->has_value()) << read.status();
    EXPECT_TRUE(SameBits(**before->Apply(**read), **before->Apply(delta)));
  }
  EXPECT_THAT(folder_.Names(), UnorderedElementsAre("map.cairn", std::filesystem::path(backup).filename().string()));
  // The backup is the map as it was, and a second one does not take its place.
  EXPECT_EQ((*OpenMapStore(backup, OpenMode::kRead))->ReadSummary()->format_version, golden.format);
  EXPECT_TRUE(SameBits(*LoadMap(backup), *before));
  const std::string backup_bytes = ReadBytes(backup);
  std::filesystem::copy_file(std::string(GOLDEN_FOLDER) + "/" + golden.name, path_,
                             std::filesystem::copy_options::overwrite_existing);
  std::filesystem::permissions(path_, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  EXPECT_THAT((*OpenMapStore(path_, OpenMode::kWrite))->notes(), ElementsAre(HasSubstr(backup + "-2")));
  EXPECT_TRUE(ReadBytes(backup) == backup_bytes);
}

// An upgrade that is cut short anywhere leaves the map as it was.
TEST_P(GoldenFile, SurvivesAnUpgradeThatIsCutShort) {
  const auto before = LoadMap(path_);
  const auto size = std::filesystem::file_size(path_);
  for (const double room : {0.01, 0.3, 0.9, 1.1, 1.5}) {
    const pid_t child = InChild([&] {
      signal(SIGXFSZ, SIG_IGN);
      rlimit limit{};
      getrlimit(RLIMIT_FSIZE, &limit);
      limit.rlim_cur = static_cast<rlim_t>(room * static_cast<double>(size));
      setrlimit(RLIMIT_FSIZE, &limit);
      const auto file = OpenMapStore(path_, OpenMode::kWrite);
      if (file.ok()) kill(getpid(), SIGKILL);
      return FaultOf(file.status()) == Fault::kFull ? 0 : 1;
    });
    EXPECT_THAT(ExitCode(child), ::testing::AnyOf(0, -1)) << room;
    EXPECT_TRUE(SameBits(*LoadMap(path_), *before)) << room;
  }
  ASSERT_TRUE(OpenMapStore(path_, OpenMode::kWrite).ok());
  EXPECT_TRUE(SameBits(*LoadMap(path_), *before));
}

INSTANTIATE_TEST_SUITE_P(Formats, GoldenFile, ::testing::ValuesIn(kGoldens), [](const auto& tested) {
  std::string name = tested.param.name;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == '.'; }, '_');
  return name;
});

}  // namespace
}  // namespace cairn::store
