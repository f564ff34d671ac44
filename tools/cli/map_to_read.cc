#include "cli/map_to_read.h"

#include <stdlib.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <utility>
#include <vector>

#include "absl/strings/str_replace.h"
#include "cli/export_served.h"
#include "cli/input_options.h"
#include "store/log_damage.h"

namespace cairn::cli {
namespace {

constexpr const char* kFetchedName = "map.cairn";
// What can stand in the folder: the file on its way, the file, and what SQLite puts beside it.
constexpr std::array<const char*, 4> kFetchedFiles = {"map.cairn.part", "map.cairn", "map.cairn-wal", "map.cairn-shm"};
constexpr std::array<int, 4> kEndingSignals = {SIGINT, SIGTERM, SIGHUP, SIGPIPE};
constexpr std::size_t kMostFolders = 2;  // cairn diff

// For the handler below, which may only look at what is there and call what is safe in it.
struct FetchedFolder {
  volatile std::sig_atomic_t in_use = 0;
  std::array<std::array<char, 4096>, kFetchedFiles.size()> files{};
  std::array<char, 4096> folder{};
};
std::array<FetchedFolder, kMostFolders> fetched_folders;

void RemoveFetched(const FetchedFolder& fetched) {
  for (const auto& file : fetched.files) unlink(file.data());
  rmdir(fetched.folder.data());
}

extern "C" void EndWithoutFetched(int signal) {
  for (const FetchedFolder& fetched : fetched_folders) {
    if (fetched.in_use != 0) RemoveFetched(fetched);
  }
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

void KeepName(const std::string& from, std::array<char, 4096>* to) {
  std::strncpy(to->data(), from.c_str(), to->size() - 1);
}

void WatchFetched(const std::string& folder) {
  for (FetchedFolder& fetched : fetched_folders) {
    if (fetched.in_use != 0) continue;
    KeepName(folder, &fetched.folder);
    for (std::size_t i = 0; i < kFetchedFiles.size(); ++i) {
      KeepName(absl::StrCat(folder, "/", kFetchedFiles[i]), &fetched.files[i]);
    }
    fetched.in_use = 1;
    break;
  }
  for (const int signal : kEndingSignals) {
    struct sigaction now = {};
    if (sigaction(signal, nullptr, &now) == 0 && now.sa_handler == SIG_DFL) std::signal(signal, EndWithoutFetched);
  }
}

// Files of maps that were fetched, and what these are called: told also when the files are gone.
std::vector<std::pair<std::string, std::string>>& FetchedNames() {
  static std::vector<std::pair<std::string, std::string>> names;
  return names;
}

void ForgetFetched(const std::string& folder) {
  for (FetchedFolder& fetched : fetched_folders) {
    if (fetched.in_use != 0 && folder == fetched.folder.data()) fetched.in_use = 0;
  }
}

}  // namespace

absl::StatusOr<MapToRead> MapToRead::Open(const ServerChoice& server, const std::string& map) {
  if (server.empty()) return MapToRead(map);
  std::error_code error;
  std::string folder = (std::filesystem::temp_directory_path(error) / "cairn-XXXXXX").string();
  if (error || mkdtemp(folder.data()) == nullptr) {
    return absl::FailedPreconditionError(absl::StrCat("there is no folder for a temporary file (TMPDIR): ",
                                                      error ? error.message() : std::strerror(errno)));
  }
  MapToRead fetched(absl::StrCat(folder, "/", kFetchedName));
  fetched.folder_ = folder;
  WatchFetched(folder);
  FetchedNames().emplace_back(fetched.path_, map);
  CAIRN_RETURN_IF_ERROR(ExportServed(server, map, api::ExportContent::kMap, fetched.path_));
  return fetched;
}

MapToRead::MapToRead(MapToRead&& other) noexcept
    : path_(std::move(other.path_)), folder_(std::exchange(other.folder_, std::string())) {}

MapToRead::~MapToRead() {
  if (folder_.empty()) return;
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
  ForgetFetched(folder_);
}

std::string NamedAsServed(absl::string_view message) { return absl::StrReplaceAll(message, FetchedNames()); }

void TellLogDamage(const std::string& verb, const ServerChoice& server, const std::string& map) {
  if (!server.empty()) return;
  if (const std::string damage = store::LogDamageOf(map); !damage.empty()) TellNotes(verb, {damage});
}

std::string InputFile(const ServerChoice& server, const std::string& map) {
  return server.empty() ? map : std::string();
}

}  // namespace cairn::cli
