// For tests of what happens to map files: their bytes and content, processes that write them and are killed.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>

#include "store/map_store.h"
#include "store/sqlite_map_store.h"
#include "store/testing_maps.h"

namespace cairn::store::testing {

inline std::string ReadBytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline void WriteBytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

// Starts a map at `path`, or goes on with it.
inline SnapshotPtr MakeMap(const std::string& path, std::uint64_t seed, int keyframes, GrowOptions options = {}) {
  const std::string vocabulary(9000, 'w');
  auto file = *SqliteMapStore::Create(
      path, TestInfo(), {.overwrite = true, .vocabulary = vocabulary, .write = {.sync_every_commit = false}});
  MapGrower grower(seed, options);
  SnapshotPtr map = map::Snapshot::Empty(TestInfo());
  for (int i = 0; i <= keyframes; ++i) {
    const map::Delta delta = i == 0 ? grower.Start(map) : grower.AddKeyframe(map);
    map = *map->Apply(delta);
    EXPECT_TRUE(file->Commit(delta).ok());
  }
  return map;
}

// What the map at `path` holds.
inline SnapshotPtr LoadMap(const std::string& path) {
  const auto store = OpenMapStore(path, OpenMode::kRead);
  EXPECT_TRUE(store.ok()) << store.status();
  const auto map = (*store)->LoadSnapshot();
  EXPECT_TRUE(map.ok()) << map.status();
  return *map;
}

// Runs `work` in a child process and gives its process id; what `work` returns is the exit code.
template <class Work>
pid_t InChild(Work work) {
  const pid_t child = fork();
  if (child == 0) _exit(work());
  return child;
}

inline int ExitCode(pid_t child) {
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// Goes on writing until killed; tells `acknowledge` every revision that is safe.
inline int WriteForever(const std::string& path, std::uint64_t seed, int acknowledge) {
  auto file = SqliteMapStore::Open(path);
  if (!file.ok()) return 2;
  auto map = (*file)->LoadSnapshot();
  if (!map.ok()) return 3;
  MapGrower grower(seed, {.features = 300, .new_points = 60});
  for (int step = 0;; ++step) {
    const map::Delta delta = step % 4 == 3 && (*map)->keyframes().size() > 12 ? grower.Cull(*map)
                             : step % 2 == 1                                  ? grower.Adjust(*map, 5)
                                                                              : grower.AddKeyframe(*map);
    map = (*map)->Apply(delta);
    if (!map.ok() || !(*file)->Commit(delta).ok()) return 4;
    const Revision revision = (*map)->revision();
    if (write(acknowledge, &revision, sizeof(revision)) != sizeof(revision)) return 5;
  }
}

}  // namespace cairn::store::testing
