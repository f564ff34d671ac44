#include "base/files.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

namespace cairn {
namespace {

namespace fs = std::filesystem;

class Files : public ::testing::Test {
 protected:
  Files() {
    std::string name = (fs::temp_directory_path() / "cairn_files_XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  ~Files() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  std::size_t Entries() const { return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), {})); }

  fs::path folder_;
};

TEST_F(Files, ReadsWhatWasWritten) {
  const std::string contents("a\0b\n", 4);
  ASSERT_TRUE(WriteFileAtomically(Path("a"), contents, false).ok());
  EXPECT_EQ(*ReadWholeFile(Path("a")), contents);
  EXPECT_EQ(WriteFileAtomically(Path("a"), "x", false).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(WriteFileAtomically(Path("a"), "", true).ok());
  EXPECT_EQ(*ReadWholeFile(Path("a")), "");
  EXPECT_EQ(Entries(), 1u);
  EXPECT_EQ(ReadWholeFile(Path("none")).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(WriteFileAtomically(Path("none/a"), "x", true).code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(ReadWholeFile("/proc/self/status")->empty()) << "a file of unknown size";
}

TEST_F(Files, WhatIsNoFileIsNeitherReadNorReplaced) {
  ASSERT_EQ(mkfifo(Path("pipe").c_str(), 0600), 0);
  fs::create_directory(folder_ / "folder");
  const std::pair<std::string, std::string> kinds[] = {
      {Path("pipe"), "is a pipe"}, {Path("folder"), "is a folder"}, {"/dev/zero", "is a device"}};
  for (const auto& [path, kind] : kinds) {
    EXPECT_EQ(WhyNoFile(path), kind);
    const absl::Status read = ReadWholeFile(path).status();  // and does not wait for a writer
    EXPECT_EQ(read.code(), absl::StatusCode::kInvalidArgument) << path;
    EXPECT_NE(read.message().find(path + " " + kind), absl::string_view::npos) << read;
    EXPECT_EQ(WriteFileAtomically(path, "x", true).code(), absl::StatusCode::kInvalidArgument) << path;
  }
  EXPECT_TRUE(fs::is_fifo(Path("pipe")));
  EXPECT_EQ(WhyNoFile(Path("none")), "");
}

TEST_F(Files, ReadsNoMoreThanAllowed) {
  ASSERT_TRUE(WriteFileAtomically(Path("a"), std::string(5000, 'x'), false).ok());
  EXPECT_TRUE(ReadWholeFile(Path("a"), 5000).ok());
  EXPECT_EQ(ReadWholeFile(Path("a"), 4999).status().code(), absl::StatusCode::kInvalidArgument);
  std::ofstream(Path("sparse")).close();
  fs::resize_file(Path("sparse"), std::uintmax_t{1} << 40);
  EXPECT_EQ(ReadWholeFile(Path("sparse")).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(Files, LinksAreWrittenThrough) {
  ASSERT_TRUE(WriteFileAtomically(Path("target"), "old", false).ok());
  fs::create_symlink("target", Path("link"));
  EXPECT_EQ(WriteFileAtomically(Path("link"), "new", false).code(), absl::StatusCode::kAlreadyExists);
  ASSERT_TRUE(WriteFileAtomically(Path("link"), "new", true).ok());
  EXPECT_TRUE(fs::is_symlink(Path("link")));
  EXPECT_EQ(*ReadWholeFile(Path("target")), "new");
  fs::create_symlink("later", Path("dangling"));
  ASSERT_TRUE(WriteFileAtomically(Path("dangling"), "made", false).ok());
  EXPECT_TRUE(fs::is_symlink(Path("dangling")));
  EXPECT_EQ(*ReadWholeFile(Path("later")), "made");
}

TEST_F(Files, NamesMayBeAsLongAsTheyCanBe) {
  const std::string longest(255, 'n');
  ASSERT_TRUE(WriteFileAtomically(Path(longest), "x", false).ok());
  EXPECT_EQ(*ReadWholeFile(Path(longest)), "x");
  EXPECT_EQ(WriteFileAtomically(Path(longest + "n"), "x", false).code(), absl::StatusCode::kInvalidArgument);
  std::string deep;
  while (folder_.string().size() + deep.size() < 1200) {
    deep += std::string(200, 'd') + "/";
    fs::create_directory(Path(deep));
  }
  EXPECT_TRUE(WriteFileAtomically(Path(deep + "a"), "x", false).ok());
  for (const char* odd : {"-rf", " ", "a\nb", "\xff\xfe", "file:x?mode=ro", "%s"}) {
    EXPECT_TRUE(WriteFileAtomically(Path(odd), "x", false).ok()) << odd;
    EXPECT_TRUE(fs::exists(Path(odd))) << odd;
  }
}

// The mask of the process belongs to all its threads: it is honoured, and never changed, not even for a moment.
TEST_F(Files, SecretsAreForTheirOwnerOnlyAlsoWhenTheyReplaceWhatWasNot) {
  ASSERT_TRUE(WriteFileAtomically(Path("a"), "public", false).ok());
  ASSERT_TRUE(WriteFileAtomically(Path("a"), "secret", true, FilePermissions::kOwnerOnly).ok());
  EXPECT_EQ(fs::status(Path("a")).permissions(), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_EQ(*ReadWholeFile(Path("a")), "secret");
  if (geteuid() != 0) return;  // only root can give files away
  fs::create_directory(Path("service"));
  ASSERT_EQ(chown(Path("service").c_str(), 4321, 4322), 0);
  ASSERT_TRUE(WriteFileAtomically(Path("service/a"), "secret", false, FilePermissions::kOwnerOnly).ok());
  struct stat info = {};
  ASSERT_EQ(stat(Path("service/a").c_str(), &info), 0);
  EXPECT_EQ(info.st_uid, 4321u);
  EXPECT_EQ(info.st_gid, 4322u);
}

TEST_F(Files, NewFilesHaveThePermissionsOfTheProcess) {
  const mode_t before = umask(027);
  std::atomic<bool> stop = false;
  std::atomic<int> open_to_all = 0;
  std::thread other([&] {
    for (int i = 0; !stop; ++i) {
      const std::string path = Path("other" + std::to_string(i % 8));
      std::ofstream(path).close();
      struct stat info = {};
      if (stat(path.c_str(), &info) == 0 && (info.st_mode & 0007) != 0) ++open_to_all;
      unlink(path.c_str());
    }
  });
  for (int i = 0; i < 200; ++i) EXPECT_TRUE(WriteFileAtomically(Path("a"), "x", true).ok());
  stop = true;
  other.join();
  umask(before);
  EXPECT_EQ(fs::status(Path("a")).permissions(), fs::perms(0640));
  EXPECT_EQ(open_to_all, 0);
}

}  // namespace
}  // namespace cairn
