// Input and output that fail when a test wants it: a layer over SQLite's own, in between for all databases that are
// opened while it exists.
#pragma once

#include <sqlite3.h>

#include <cerrno>
#include <cstring>
#include <vector>

namespace cairn::store::testing {

class FailingVfs {
 public:
  FailingVfs() {
    the_one() = this;
    real_ = sqlite3_vfs_find(nullptr);
    vfs_ = *real_;
    vfs_.zName = "cairn_failing";
    vfs_.szOsFile = static_cast<int>(sizeof(File)) + real_->szOsFile;
    vfs_.xOpen = &Open;
    vfs_.xDelete = &Delete;
    sqlite3_vfs_register(&vfs_, /*makeDflt=*/1);
  }
  ~FailingVfs() {
    sqlite3_vfs_register(real_, 1);
    sqlite3_vfs_unregister(&vfs_);
    the_one() = nullptr;
  }
  FailingVfs(const FailingVfs&) = delete;
  FailingVfs& operator=(const FailingVfs&) = delete;

  // The n-th call from now on that changes something fails, and with `for_ever` all that follow it. 0: none does.
  void FailAt(int n, bool for_ever) {
    left_ = n;
    for_ever_ = for_ever;
    failed_ = 0;
  }
  int failed() const { return failed_; }

 private:
  struct File {
    sqlite3_file base;
    sqlite3_file* real;  // behind this, in the same memory
  };

  static FailingVfs*& the_one() {
    static FailingVfs* one = nullptr;
    return one;
  }
  static sqlite3_file* Real(sqlite3_file* file) { return reinterpret_cast<File*>(file)->real; }
  static bool Fails() {
    FailingVfs* self = the_one();
    if (self->left_ == 0) return false;
    if (self->left_ > 1) {
      --self->left_;
      return false;
    }
    if (!self->for_ever_) self->left_ = 0;
    ++self->failed_;
    return true;
  }

  static int Open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out_flags) {
    auto* wrapped = reinterpret_cast<File*>(file);
    wrapped->base.pMethods = nullptr;
    if ((flags & SQLITE_OPEN_CREATE) != 0 && Fails()) return SQLITE_CANTOPEN;
    wrapped->real = reinterpret_cast<sqlite3_file*>(wrapped + 1);
    sqlite3_vfs* real = the_one()->real_;
    const int rc = real->xOpen(real, name, wrapped->real, flags, out_flags);
    if (wrapped->real->pMethods != nullptr) wrapped->base.pMethods = Methods();
    return rc;
  }
  static int Delete(sqlite3_vfs*, const char* name, int sync_folder) {
    sqlite3_vfs* real = the_one()->real_;
    return Fails() ? SQLITE_IOERR_DELETE : real->xDelete(real, name, sync_folder);
  }

  static const sqlite3_io_methods* Methods() {
    static const sqlite3_io_methods methods = [] {
      sqlite3_io_methods m{};
      m.iVersion = 2;
      m.xClose = [](sqlite3_file* f) { return Real(f)->pMethods->xClose(Real(f)); };
      m.xRead = [](sqlite3_file* f, void* to, int n, sqlite3_int64 at) {
        return Real(f)->pMethods->xRead(Real(f), to, n, at);
      };
      m.xWrite = [](sqlite3_file* f, const void* from, int n, sqlite3_int64 at) {
        // A page that is half written, as when the power fails.
        if (Fails()) {
          Real(f)->pMethods->xWrite(Real(f), from, n / 2, at);
          return SQLITE_IOERR_WRITE;
        }
        return Real(f)->pMethods->xWrite(Real(f), from, n, at);
      };
      m.xTruncate = [](sqlite3_file* f, sqlite3_int64 size) {
        return Fails() ? SQLITE_IOERR_TRUNCATE : Real(f)->pMethods->xTruncate(Real(f), size);
      };
      m.xSync = [](sqlite3_file* f, int flags) {
        return Fails() ? SQLITE_IOERR_FSYNC : Real(f)->pMethods->xSync(Real(f), flags);
      };
      m.xFileSize = [](sqlite3_file* f, sqlite3_int64* size) { return Real(f)->pMethods->xFileSize(Real(f), size); };
      m.xLock = [](sqlite3_file* f, int level) { return Real(f)->pMethods->xLock(Real(f), level); };
      m.xUnlock = [](sqlite3_file* f, int level) { return Real(f)->pMethods->xUnlock(Real(f), level); };
      m.xCheckReservedLock = [](sqlite3_file* f, int* out) {
        return Real(f)->pMethods->xCheckReservedLock(Real(f), out);
      };
      m.xFileControl = [](sqlite3_file* f, int op, void* arg) {
        return Real(f)->pMethods->xFileControl(Real(f), op, arg);
      };
      m.xSectorSize = [](sqlite3_file* f) { return Real(f)->pMethods->xSectorSize(Real(f)); };
      m.xDeviceCharacteristics = [](sqlite3_file* f) { return Real(f)->pMethods->xDeviceCharacteristics(Real(f)); };
      m.xShmMap = [](sqlite3_file* f, int page, int size, int extend, void volatile** out) {
        return extend != 0 && Fails() ? SQLITE_IOERR_SHMSIZE
                                      : Real(f)->pMethods->xShmMap(Real(f), page, size, extend, out);
      };
      m.xShmLock = [](sqlite3_file* f, int at, int n, int flags) {
        return Real(f)->pMethods->xShmLock(Real(f), at, n, flags);
      };
      m.xShmBarrier = [](sqlite3_file* f) { Real(f)->pMethods->xShmBarrier(Real(f)); };
      m.xShmUnmap = [](sqlite3_file* f, int remove) { return Real(f)->pMethods->xShmUnmap(Real(f), remove); };
      return m;
    }();
    return &methods;
  }

  sqlite3_vfs* real_;
  sqlite3_vfs vfs_;
  int left_ = 0;
  bool for_ever_ = false;
  int failed_ = 0;
};

}  // namespace cairn::store::testing
