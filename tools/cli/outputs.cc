#include "cli/outputs.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "base/files.h"

namespace cairn::cli {
namespace {

namespace fs = std::filesystem;

// What stands beside a map while it is written.
constexpr std::array<absl::string_view, 5> kCompanions = {"-wal", "-shm", "-lock", "-journal", ".new"};

// The map to which a file of this name would belong; empty if to none.
std::string MapOf(const std::string& path) {
  for (const absl::string_view companion : kCompanions) {
    if (absl::EndsWith(path, companion)) return path.substr(0, path.size() - companion.size());
  }
  return "";
}

// A Cairn map by its header, or by the files that stand beside it while it is written; or one of these.
bool BelongsToMap(const std::string& path) {
  std::error_code error;
  for (const absl::string_view companion : kCompanions) {
    if (fs::exists(absl::StrCat(path, companion), error)) return true;
  }
  const std::string map = MapOf(path);
  if (!map.empty() && fs::exists(map, error)) return true;
  if (!fs::is_regular_file(path, error)) return false;
  char header[72] = {};
  std::ifstream file(path, std::ios::binary);
  file.read(header, sizeof(header));
  return absl::string_view(header, 15) == "SQLite format 3" && absl::string_view(header + 68, 4) == "CAIR";
}

}  // namespace

absl::Status CheckWritable(const std::string& path, bool overwrite, bool is_map) {
  if (path.empty()) return absl::OkStatus();
  std::error_code error;
  struct stat info = {};
  if (lstat(path.c_str(), &info) != 0 && errno == ENAMETOOLONG) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", std::strerror(ENAMETOOLONG)));
  }
  if (const std::string kind = WhyNoFile(path); !kind.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, " ", kind, ": name a file"));
  }
  if (!overwrite && fs::exists(path, error)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, " exists already: choose another name, or give --overwrite to replace it"));
  }
  fs::path folder = fs::path(path).parent_path();
  if (folder.empty()) folder = ".";
  if (!fs::is_directory(folder, error)) {
    return absl::NotFoundError(absl::StrCat("the folder of ", path, " does not exist: create it first"));
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

bool BelongsTo(const fs::path& file, const fs::path& map) { return !map.empty() && MapOf(file) == map; }

// A file as the disk knows it.
struct Identity {
  fs::path path;  // without links and dots
  std::optional<std::pair<dev_t, ino_t>> inode;
  bool has_other_names = false;
};

Identity Identify(const std::string& path) {
  std::error_code error;
  Identity identity;
  identity.path = fs::weakly_canonical(fs::absolute(path, error), error);
  // What has no name on the disk, as a pipe at /dev/fd/63.
  if (identity.path.empty()) identity.path = fs::absolute(path, error).lexically_normal();
  // A link to what is not there yet.
  for (int i = 0; i < 40 && fs::is_symlink(identity.path, error); ++i) {
    const fs::path target = fs::read_symlink(identity.path, error);
    identity.path = fs::weakly_canonical(identity.path.parent_path() / target, error);
  }
  struct stat info = {};
  if (stat(path.c_str(), &info) == 0) {
    identity.inode = std::pair(info.st_dev, info.st_ino);
    identity.has_other_names = S_ISREG(info.st_mode) && info.st_nlink > 1;
  }
  return identity;
}

bool Same(const Identity& a, const Identity& b) { return a.path == b.path || (a.inode && a.inode == b.inode); }

// A map, a trajectory, a drawing or a vocabulary: what cairn itself may have written there before.
bool MayBeOurs(const fs::path& path) {
  std::string start(400, '\0');
  std::ifstream(path, std::ios::binary).read(start.data(), static_cast<std::streamsize>(start.size()));
  return absl::StartsWith(start, "SQLite format 3") || absl::StartsWith(start, "CAIRNVOC") ||
         absl::StartsWith(start, "# t tx ty tz qx qy qz qw: ") || absl::StrContains(start, "<svg");
}

bool Within(const fs::path& path, const fs::path& folder) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first == folder.end();
}

// Whether a file in the folder, at any depth, is another name of this one.
bool HoldsAnotherName(const fs::path& folder, const Identity& file) {
  std::error_code error;
  const auto options = fs::directory_options::skip_permission_denied;
  for (auto it = fs::recursive_directory_iterator(folder, options, error);
       !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    struct stat info = {};
    if (stat(it->path().c_str(), &info) == 0 && file.inode == std::pair(info.st_dev, info.st_ino)) return true;
  }
  return false;
}

absl::Status CheckOutsideOf(const std::vector<fs::path>& folders, const std::string& output, const Identity& identity) {
  std::error_code error;
  if (!fs::is_regular_file(identity.path, error)) return absl::OkStatus();
  for (const fs::path& folder : folders) {
    if ((Within(identity.path, folder) && !MayBeOurs(identity.path)) ||
        (identity.has_other_names && !Within(identity.path, folder) && HoldsAnotherName(folder, identity))) {
      return absl::InvalidArgumentError(
          absl::StrCat(output, " is part of the sequence, which is never overwritten: choose another name"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckDistinct(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs) {
  std::vector<Identity> taken;
  std::vector<fs::path> folders;
  std::error_code error;
  for (const std::string& input : inputs) {
    if (input.empty()) continue;
    taken.push_back(Identify(input));
    if (fs::is_directory(input, error)) folders.push_back(taken.back().path);
  }
  for (const std::string& output : outputs) {
    if (output.empty()) continue;
    const Identity identity = Identify(output);
    CAIRN_RETURN_IF_ERROR(CheckOutsideOf(folders, output, identity));
    for (const Identity& other : taken) {
      if (Same(identity, other)) {
        return absl::InvalidArgumentError(
            absl::StrCat(output, " is named twice, or is an input: give each output a file of its own"));
      }
      if (BelongsTo(identity.path, other.path) || BelongsTo(other.path, identity.path)) {
        return absl::InvalidArgumentError(
            absl::StrCat(output, " has the name of a file that belongs to a map: choose another name"));
      }
    }
    taken.push_back(identity);
  }
  return absl::OkStatus();
}

FreshFolder::FreshFolder(const std::string& path) {
  std::error_code error;
  for (fs::path at = fs::absolute(path, error).lexically_normal(); !at.empty() && !fs::exists(at, error);
       at = at.parent_path()) {
    if (at.has_filename()) outermost_ = at.string();  // "folder/" is called as "folder"
  }
}

FreshFolder::~FreshFolder() {
  std::error_code ignored;
  if (!outermost_.empty()) fs::remove_all(outermost_, ignored);
}

absl::Status AfterError(const absl::Status& error, const std::vector<std::string>& outputs,
                        const absl::Status& written) {
  std::vector<std::string> named;
  std::copy_if(outputs.begin(), outputs.end(), std::back_inserter(named),
               [](const auto& name) { return !name.empty(); });
  if (named.empty()) return error;
  const std::string what = absl::StrJoin(named, ", ");
  absl::Status told(error.code(), absl::StrCat(error.message(), "; ",
                                               written.ok() ? absl::StrCat("what was known until then is in ", what)
                                                            : absl::StrCat("nor could all of ", what,
                                                                           " be written: ", written.message())));
  error.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) { told.SetPayload(url, payload); });
  return told;
}

absl::Status CheckPicture(const std::string& path) {
  const std::string extension = fs::path(path).extension().string();
  if (path.empty() || extension == ".png" || extension == ".svg") return absl::OkStatus();
  return UsageError(absl::StrCat(path, ": a picture's name has to end in .png or .svg"));
}

}  // namespace cairn::cli
