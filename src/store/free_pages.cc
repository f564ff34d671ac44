#include "store/free_pages.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "store/fault.h"
#include "store/file_paths.h"
#include "store/sqlite_record.h"

namespace cairn::store {
namespace {

// SQLite's file format, "The Database Header" and "The Freelist".
constexpr std::size_t kFirstTrunkAt = 32, kFreeCountAt = 36;
constexpr std::int64_t kLockByte = 1 << 30;  // its page is never used

absl::Status Report(const FindingSink& sink, absl::string_view message) {
  return sink(Finding{"", 0, absl::StrCat("SQLite's list of free pages: ", message)});
}

// By SQLite: PRAGMA integrity_check, which is to look at the list as well, leaves it out where the first object of the
// schema that it comes to is a view (3.40).
absl::StatusOr<bool> ListIsSound(Database* database, const FindingSink& sink) {
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database->Prepare("PRAGMA integrity_check(sqlite_master)"));
  bool sound = true;
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return sound;
    if (rows.Text(0) == "ok") continue;
    sound = false;
    CAIRN_RETURN_IF_ERROR(Report(sink, rows.Text(0)));
  }
}

// Of a sound list.
absl::StatusOr<std::vector<std::uint32_t>> FreePages(Database* database) {
  CAIRN_ASSIGN_OR_RETURN(const auto header, database->ReadHeader());
  const std::uint32_t page_bytes = PageBytesOf(header);
  std::vector<std::uint8_t> page(page_bytes);
  std::vector<std::uint32_t> free;
  const std::uint32_t all = BigEndian32(header.data() + kFreeCountAt);
  for (std::uint32_t trunk = BigEndian32(header.data() + kFirstTrunkAt); trunk != 0 && free.size() < all;) {
    CAIRN_RETURN_IF_ERROR(database->ReadRaw(page, std::int64_t{page_bytes} * (trunk - 1)));
    free.push_back(trunk);
    const std::size_t count = std::min<std::size_t>(BigEndian32(page.data() + 4), page_bytes / 4 - 2);
    for (std::size_t i = 0; i < count; ++i) free.push_back(BigEndian32(page.data() + 8 + 4 * i));
    trunk = BigEndian32(page.data());
  }
  return free;
}

absl::Status CompareWithUse(Database* database, const FindingSink& sink) {
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t pages, database->QueryInt("PRAGMA page_count"));
  CAIRN_ASSIGN_OR_RETURN(const auto header, database->ReadHeader());
  CAIRN_ASSIGN_OR_RETURN(const std::vector<std::uint32_t> free, FreePages(database));
  // Without this module of SQLite's it cannot be known.
  auto used = database->Prepare("SELECT pageno FROM dbstat");
  if (!used.ok()) return absl::OkStatus();
  std::vector<bool> in_use(static_cast<std::size_t>(pages) + 1);
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, used->Step());
    if (!found) break;
    if (used->Int(0) >= 1 && used->Int(0) <= pages) in_use[static_cast<std::size_t>(used->Int(0))] = true;
  }
  for (const std::uint32_t page : free) {
    if (page > pages) return Report(sink, absl::StrCat("page ", page, " is not in the file"));
    if (in_use[page]) CAIRN_RETURN_IF_ERROR(Report(sink, absl::StrCat("page ", page, " is in use")));
    in_use[page] = true;
  }
  const std::int64_t lock_page = kLockByte / PageBytesOf(header) + 1;
  for (std::int64_t page = 1; page <= pages; ++page) {
    if (in_use[static_cast<std::size_t>(page)] || page == lock_page) continue;
    CAIRN_RETURN_IF_ERROR(Report(sink, absl::StrCat("page ", page, " is neither free nor in use")));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckFreePages(Database* database, const FindingSink& sink) {
  CAIRN_ASSIGN_OR_RETURN(const bool sound, ListIsSound(database, sink));
  if (!sound) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(const std::string path,
                         database->QueryText("SELECT file FROM pragma_database_list WHERE name = 'main'"));
  if (path.empty() || HasContent(absl::StrCat(path, kLogSuffix))) return absl::OkStatus();
  return CompareWithUse(database, sink);
}

}  // namespace cairn::store
