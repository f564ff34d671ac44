#include "store/writer_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "store/fault.h"

namespace cairn::store {
namespace {

absl::Status CannotCreate(const std::string& path, int error) {
  const std::string what = absl::StrCat("cannot create the lock file ", path, ": ", std::strerror(error));
  switch (error) {
    case ENOENT:
    case ENOTDIR:
      return MakeFault(Fault::kNotFound, absl::StrCat(what, "; does the folder exist?"));
    case EACCES:
    case EPERM:
    case EROFS:
      return MakeFault(Fault::kReadOnly, absl::StrCat(what, "; a map is written in a folder that can be written"));
    case ENOSPC:
    case EDQUOT:
      return MakeFault(Fault::kFull, what);
    default:
      return MakeFault(Fault::kIo, what);
  }
}

// Whether the descriptor's file is still the one that the name leads to: its last holder may have removed it meanwhile.
bool IsStillNamed(int descriptor, const std::string& path) {
  struct stat opened {};
  struct stat named {};
  return fstat(descriptor, &opened) == 0 && stat(path.c_str(), &named) == 0 && opened.st_dev == named.st_dev &&
         opened.st_ino == named.st_ino;
}

// Whoever is refused wants to know by whom. Nothing depends on it: on a full disk the file stays empty.
void NoteHolder(int descriptor) {
  const std::string text = absl::StrCat(getpid(), "\n");
  if (ftruncate(descriptor, 0) != 0 || pwrite(descriptor, text.data(), text.size(), 0) < 0) return;
}

std::string HolderOf(const std::string& path) {
  char text[32] = {};
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor >= 0) {
    if (read(descriptor, text, sizeof(text) - 1) < 0) text[0] = '\0';
    close(descriptor);
  }
  const long pid = std::strtol(text, nullptr, 10);
  if (pid <= 0) return "another process";
  return pid == getpid() ? "this process already" : absl::StrCat("another process (", pid, ")");
}

}  // namespace

absl::StatusOr<std::unique_ptr<WriterLock>> WriterLock::Acquire(const std::string& map_path) {
  constexpr int kAttempts = 100;
  std::string path = map_path + "-lock";
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const int descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor < 0) return CannotCreate(path, errno);
    if (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
      const int error = errno;
      close(descriptor);
      if (error == EINTR) continue;
      if (error != EWOULDBLOCK)
        return MakeFault(Fault::kIo, absl::StrCat("locking ", path, ": ", std::strerror(error)));
      return MakeFault(Fault::kBusy,
                       absl::StrCat("it is being written by ", HolderOf(path), "; try again when that has finished"));
    }
    if (IsStillNamed(descriptor, path)) {
      NoteHolder(descriptor);
      return std::unique_ptr<WriterLock>(new WriterLock(std::move(path), descriptor));
    }
    close(descriptor);
  }
  return MakeFault(Fault::kBusy, "other processes keep taking the right to write it; try again later");
}

bool WriterLock::IsHeld(const std::string& map_path) {
  const int descriptor = open((map_path + "-lock").c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool held = flock(descriptor, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  close(descriptor);
  return held;
}

WriterLock::~WriterLock() {
  if (IsStillNamed(descriptor_, path_)) unlink(path_.c_str());
  close(descriptor_);
}

}  // namespace cairn::store
