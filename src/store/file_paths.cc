#include "store/file_paths.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

#include "absl/strings/match.h"
#include "store/fault.h"

namespace cairn::store {
namespace {

// SQLite's own limit for a path with its companions' suffixes, of which "-new-journal" is the longest.
constexpr std::size_t kMaxPathBytes = 512 - 1;
constexpr std::size_t kLongestSuffixBytes = kNewSuffix.size() + kJournalSuffix.size();

absl::Status CheckLength(const std::string& resolved, std::size_t suffix_bytes) {
  if (resolved.size() + suffix_bytes > kMaxPathBytes) {
    return absl::InvalidArgumentError(absl::StrCat("its path has ", resolved.size(), " bytes, and SQLite takes ",
                                                   kMaxPathBytes - suffix_bytes,
                                                   ": use a shorter one (symbolic links do not shorten it)"));
  }
  const std::size_t name_bytes = resolved.size() - resolved.rfind('/') - 1;
  if (name_bytes + suffix_bytes > NAME_MAX) {
    return absl::InvalidArgumentError(absl::StrCat("its name has ", name_bytes, " bytes, and a map's may have ",
                                                   NAME_MAX - suffix_bytes, ", as files are made beside it"));
  }
  return absl::OkStatus();
}

absl::Status CheckText(const std::string& path) {
  if (path.empty()) return absl::InvalidArgumentError("the name of the map is empty");
  if (path.find('\0') != std::string::npos) return absl::InvalidArgumentError("the name of the map has a zero byte");
  return absl::OkStatus();
}

}  // namespace

std::string FolderOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

bool HasContent(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 && info.st_size > 0;
}

std::string FreePath(const std::string& path) {
  std::string free = path;
  for (int number = 2; access(free.c_str(), F_OK) == 0; ++number) free = absl::StrCat(path, "-", number);
  return free;
}

absl::Status SystemFault(absl::string_view doing, int error) {
  const std::string message = absl::StrCat(doing, ": ", std::strerror(error));
  if (error == ENOSPC || error == EDQUOT || error == EFBIG) return MakeFault(Fault::kFull, message);
  if (error == EACCES || error == EPERM || error == EROFS) return MakeFault(Fault::kReadOnly, message);
  return MakeFault(Fault::kIo, message);
}

absl::Status SyncFolder(const std::string& folder) {
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return SystemFault("opening the folder", errno);
  const int failed = fsync(descriptor) != 0 ? errno : 0;
  close(descriptor);
  // Some file systems do not sync folders; there is nothing more to be done on those.
  return failed == 0 || failed == EINVAL ? absl::OkStatus() : SystemFault("syncing the folder", failed);
}

void RemoveCompanions(const std::string& path) {
  for (const absl::string_view suffix : {kLogSuffix, kSharedMemorySuffix, kJournalSuffix}) {
    unlink(absl::StrCat(path, suffix).c_str());
  }
}

absl::StatusOr<std::string> ResolveExisting(const std::string& path, Empty empty) {
  CAIRN_RETURN_IF_ERROR(CheckText(path));
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) {
    if (errno == ENOENT || errno == ENOTDIR) return MakeFault(Fault::kNotFound, "there is no such file");
    return MakeFault(Fault::kIo, std::strerror(errno));
  }
  if (S_ISDIR(info.st_mode)) return MakeFault(Fault::kNotAMap, "it is a folder, not a Cairn map");
  if (!S_ISREG(info.st_mode)) return MakeFault(Fault::kNotAMap, "it is not a regular file, and so not a Cairn map");
  if (info.st_size == 0 && empty == Empty::kRefused) return MakeFault(Fault::kNotAMap, "it is empty, not a Cairn map");
  if (access(path.c_str(), R_OK) != 0)
    return MakeFault(Fault::kIo, absl::StrCat("cannot be read: ", std::strerror(errno)));
  std::error_code error;
  const std::filesystem::path resolved = std::filesystem::canonical(path, error);
  if (error) return MakeFault(Fault::kIo, error.message());
  CAIRN_RETURN_IF_ERROR(CheckLength(resolved.string(), kSharedMemorySuffix.size()));
  return resolved.string();
}

absl::StatusOr<std::string> ResolveNew(const std::string& path) {
  CAIRN_RETURN_IF_ERROR(CheckText(path));
  if (path.back() == '/') return absl::InvalidArgumentError(absl::StrCat("'", path, "' is not the name of a file"));
  struct stat info {};
  if (stat(path.c_str(), &info) == 0) {
    if (S_ISDIR(info.st_mode)) return MakeFault(Fault::kNotAMap, "it is a folder; give the name of a file");
    if (!S_ISREG(info.st_mode)) return MakeFault(Fault::kNotAMap, "it is not a regular file; give another name");
  }
  // Absolute first: of a relative name of which nothing exists, nothing would be resolved.
  std::error_code error;
  std::filesystem::path resolved = std::filesystem::absolute(path, error);
  if (!error) resolved = std::filesystem::weakly_canonical(resolved, error);
  if (error) {
    return error == std::errc::filename_too_long ? absl::InvalidArgumentError("its path is too long")
                                                 : MakeFault(Fault::kIo, error.message());
  }
  // A link that leads nowhere yet: the file is made where it points to.
  for (int links = 0; std::filesystem::is_symlink(resolved, error); ++links) {
    if (links > 40) return MakeFault(Fault::kIo, "too many symbolic links");
    const std::filesystem::path target = std::filesystem::read_symlink(resolved, error);
    if (!error) resolved = std::filesystem::weakly_canonical(resolved.parent_path() / target, error);
    if (error) return MakeFault(Fault::kIo, error.message());
  }
  CAIRN_RETURN_IF_ERROR(CheckLength(resolved.string(), kLongestSuffixBytes));
  if (!std::filesystem::is_directory(resolved.parent_path(), error)) {
    return MakeFault(Fault::kNotFound, absl::StrCat("there is no folder ", resolved.parent_path().string()));
  }
  return resolved.string();
}

absl::Status CheckNoCompanion(const std::string& path) {
  for (const absl::string_view suffix : {kLogSuffix, kSharedMemorySuffix, kJournalSuffix, kLockSuffix, kNewSuffix}) {
    if (!absl::EndsWith(path, suffix)) continue;
    return absl::InvalidArgumentError(absl::StrCat("a map's name must not end in ", suffix, ": such a file beside ",
                                                   path.substr(0, path.size() - suffix.size()),
                                                   " would belong to that map; choose another name"));
  }
  return absl::OkStatus();
}

bool IsNetworkType(absl::string_view type) {
  constexpr std::array<absl::string_view, 26> kTypes = {"nfs",
                                                        "nfs4",
                                                        "cifs",
                                                        "smb3",
                                                        "smbfs",
                                                        "9p",
                                                        "afs",
                                                        "ceph",
                                                        "glusterfs",
                                                        "lustre",
                                                        "beegfs",
                                                        "gpfs",
                                                        "pvfs2",
                                                        "orangefs",
                                                        "coda",
                                                        "ncpfs",
                                                        "davfs",
                                                        "fuse.sshfs",
                                                        "fuse.s3fs",
                                                        "fuse.rclone",
                                                        "fuse.gcsfuse",
                                                        "fuse.davfs2",
                                                        "fuse.ceph",
                                                        "fuse.curlftpfs",
                                                        "fuse.gvfsd-fuse",
                                                        "fuse.glusterfs"};
  return std::find(kTypes.begin(), kTypes.end(), type) != kTypes.end();
}

std::optional<std::string> NetworkFileSystem(const std::string& folder) {
  struct stat info {};
  if (stat(folder.c_str(), &info) != 0) return std::nullopt;
  const std::string device = absl::StrCat(major(info.st_dev), ":", minor(info.st_dev));
  // 36 35 98:0 / /mnt rw,noatime shared:1 - ext3 /dev/root rw
  std::ifstream mounts("/proc/self/mountinfo");
  std::string line;
  while (std::getline(mounts, line)) {
    std::istringstream words(line);
    std::string id, parent, number;
    words >> id >> parent >> number;
    const std::size_t separator = line.find(" - ");
    if (number != device || separator == std::string::npos) continue;
    std::istringstream rest(line.substr(separator + 3));
    std::string type;
    rest >> type;
    if (IsNetworkType(type)) return type;
  }
  return std::nullopt;
}

absl::StatusOr<FileIdentity> FileIdentity::Of(const std::string& path) {
  FileIdentity identity;
  identity.descriptor_ = open(path.c_str(), O_PATH | O_CLOEXEC);
  if (identity.descriptor_ < 0) return SystemFault(absl::StrCat("opening ", path), errno);
  return identity;
}

FileIdentity::FileIdentity(FileIdentity&& other) noexcept { *this = std::move(other); }

FileIdentity& FileIdentity::operator=(FileIdentity&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

FileIdentity::~FileIdentity() {
  if (descriptor_ >= 0) close(descriptor_);
}

bool FileIdentity::IsAt(const std::string& path) const {
  struct stat opened {};
  struct stat named {};
  return fstat(descriptor_, &opened) == 0 && stat(path.c_str(), &named) == 0 && opened.st_dev == named.st_dev &&
         opened.st_ino == named.st_ino;
}

std::optional<std::string> FileIdentity::CurrentPath() const {
  struct stat opened {};
  if (fstat(descriptor_, &opened) != 0 || opened.st_nlink == 0) return std::nullopt;
  std::error_code error;
  const std::filesystem::path path = std::filesystem::read_symlink(absl::StrCat("/proc/self/fd/", descriptor_), error);
  if (error || !IsAt(path.string())) return std::nullopt;
  return path.string();
}

}  // namespace cairn::store
