#include "cli/cli.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "absl/strings/match.h"
#include "store/fault.h"

namespace cairn::cli {
namespace {

double NowSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

int ExitCodeOf(const absl::Status& status) {
  if (status.ok()) return kOk;
  if (store::IsDamaged(status)) return kDamagedMap;
  if (store::IsNewerVersion(status)) return kNewerVersion;
  return kFailure;
}

}  // namespace

int Fail(const std::string& verb, const absl::Status& status, bool json) {
  const int code = ExitCodeOf(status);
  if (json) {
    const absl::string_view fault = store::FaultName(store::FaultOf(status));
    PrintJson({{"error", std::string(status.message())}, {"fault", std::string(fault)}, {"exit_code", code}});
  } else {
    std::cerr << "cairn " << verb << ": " << status.message() << "\n";
  }
  return code;
}

void PrintJson(const nlohmann::ordered_json& json) {
  std::cout << json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << "\n";
}

namespace {

// A Cairn map by its header, or by the files that stand beside it while it is written; or one of these.
bool BelongsToMap(const std::string& path) {
  std::error_code error;
  for (const char* suffix : {"-wal", "-shm", "-lock", "-journal"}) {
    if (std::filesystem::exists(path + suffix, error)) return true;
    if (absl::EndsWith(path, suffix) &&
        std::filesystem::exists(path.substr(0, path.size() - std::strlen(suffix)), error)) {
      return true;
    }
  }
  if (!std::filesystem::is_regular_file(path, error)) return false;
  char header[72] = {};
  std::ifstream file(path, std::ios::binary);
  file.read(header, sizeof(header));
  return absl::string_view(header, 15) == "SQLite format 3" && absl::string_view(header + 68, 4) == "CAIR";
}

}  // namespace

absl::Status CheckWritable(const std::string& path, bool overwrite, bool is_map) {
  std::error_code error;
  if (!path.empty() && !overwrite && std::filesystem::exists(path, error)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, " exists already: choose another name, or give --overwrite to replace it"));
  }
  if (path.empty()) return absl::OkStatus();
  std::filesystem::path folder = std::filesystem::path(path).parent_path();
  if (folder.empty()) folder = ".";
  if (!std::filesystem::is_directory(folder, error)) {
    return absl::NotFoundError(absl::StrCat("the folder of ", path, " does not exist: create it first"));
  }
  if (std::filesystem::is_directory(path, error)) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is a folder: name a file"));
  }
  if (access(folder.c_str(), W_OK) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat("the folder of ", path, " cannot be written: ", std::strerror(errno)));
  }
  if (!is_map && BelongsToMap(path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, " is a map, or belongs to one, and is not replaced by anything else: choose another name"));
  }
  return absl::OkStatus();
}

namespace {

std::filesystem::path Real(const std::string& path) {
  std::error_code error;
  return std::filesystem::weakly_canonical(std::filesystem::absolute(path, error), error);
}

// A map, a trajectory or a drawing: what cairn itself may have written there before.
bool MayBeOurs(const std::filesystem::path& path) {
  std::string start(400, '\0');
  std::ifstream(path, std::ios::binary).read(start.data(), static_cast<std::streamsize>(start.size()));
  return absl::StartsWith(start, "SQLite format 3") || absl::StrContains(start, "# timestamp_s tx ty tz") ||
         absl::StrContains(start, "<svg");
}

bool Within(const std::filesystem::path& path, const std::filesystem::path& folder) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first == folder.end();
}

}  // namespace

absl::Status CheckDistinct(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs) {
  std::vector<std::filesystem::path> taken;
  std::vector<std::filesystem::path> folders;
  std::error_code error;
  for (const std::string& input : inputs) {
    if (input.empty()) continue;
    taken.push_back(Real(input));
    if (std::filesystem::is_directory(input, error)) folders.push_back(taken.back());
  }
  for (const std::string& output : outputs) {
    if (output.empty()) continue;
    const std::filesystem::path path = Real(output);
    for (const std::filesystem::path& folder : folders) {
      if (Within(path, folder) && std::filesystem::is_regular_file(path, error) && !MayBeOurs(path)) {
        return absl::InvalidArgumentError(
            absl::StrCat(output, " is part of the sequence, which is never overwritten: choose another name"));
      }
    }
    if (std::find(taken.begin(), taken.end(), path) != taken.end()) {
      return absl::InvalidArgumentError(
          absl::StrCat(output, " is named twice, or is an input: give each output a file of its own"));
    }
    taken.push_back(path);
  }
  return absl::OkStatus();
}

absl::Status CheckPicture(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  if (path.empty() || extension == ".png" || extension == ".svg") return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(path, ": a picture's name has to end in .png or .svg"));
}

Progress::Progress(std::string label, std::int64_t total, bool quiet)
    : label_(std::move(label)), total_(std::max<std::int64_t>(total, 1)), quiet_(quiet), terminal_(isatty(2) != 0) {}

Progress::~Progress() { Finish(); }

void Progress::Update(std::int64_t done, const std::string& note) {
  if (quiet_ || finished_) return;
  if (terminal_) {
    const double now_s = NowSeconds();
    if (now_s - last_drawn_s_ < 0.1) return;
    last_drawn_s_ = now_s;
  } else {
    const std::int64_t tenth = done * 10 / total_;
    if (tenth == last_tenth_ || tenth == 0) return;
    last_tenth_ = tenth;
  }
  Draw(done, note);
}

void Progress::Finish(const std::string& note) {
  if (quiet_ || finished_) return;
  finished_ = true;
  if (terminal_ && last_drawn_s_ >= 0.0) {
    std::fputs("\r\033[K", stderr);
    if (!note.empty()) std::fprintf(stderr, "%s: %s\n", label_.c_str(), note.c_str());
  }
}

void Progress::Draw(std::int64_t done, const std::string& note) {
  const double share = std::clamp(static_cast<double>(done) / static_cast<double>(total_), 0.0, 1.0);
  if (terminal_) {
    constexpr int kWidth = 30;
    const int full = static_cast<int>(share * kWidth);
    std::string bar;
    for (int i = 0; i < kWidth; ++i) bar += i < full ? "█" : "░";
    std::fprintf(stderr, "\r\033[K%s %s %3.0f %%  %s", label_.c_str(), bar.c_str(), 100.0 * share, note.c_str());
  } else {
    std::fprintf(stderr, "%s: %.0f %%  %s\n", label_.c_str(), 100.0 * share, note.c_str());
  }
  std::fflush(stderr);
}

}  // namespace cairn::cli
