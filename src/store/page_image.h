// The pages of a database file with the changes of its write-ahead log, read without SQLite, so that damage to one page
// costs that page alone (https://www.sqlite.org/fileformat2.html, sections 1.2, 1.5 and 1.6).
#pragma once

#include <cstdint>
#include <fstream>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/sqlite_record.h"

namespace cairn::store {

// One row as it lies in a page: the columns in the order of the table's definition, without the key that is the row's
// number.
struct RawRow {
  bool has_number = false;  // false: of a table WITHOUT ROWID, or an index
  std::int64_t number = 0;
  std::vector<RecordColumn> columns;
};

class PageImage {
 public:
  // `log`: of that file, or empty. Of the log everything is taken that can be, the newest of each page. Errors: the
  // file cannot be read.
  static absl::StatusOr<PageImage> Open(const std::string& path, const std::string& log);

  // Every row of every page that is not known to be free, in the order of pages; also from pages that no tree reaches
  // any more. What looks like a row need not be one.
  void ForEachRow(const std::function<void(const RawRow&)>& visit);

  // What the header says; 0 if it cannot be read.
  std::uint32_t user_version();
  // Whether all pages that are free could be told: rows that were removed may be among the others else.
  bool knows_free_pages() const { return knows_free_pages_; }

 private:
  // False beyond the end; what the end of a file cuts off reads as zeros.
  bool ReadPage(std::uint32_t number, std::vector<std::uint8_t>* page);
  void FindFreePages();
  void VisitPage(std::uint32_t number, Bytes page, const std::function<void(const RawRow&)>& visit);
  // The rows of a page read as one of the kind: table leaf, index leaf, index interior.
  void VisitCells(Bytes page, std::size_t start, std::uint8_t kind, const std::function<void(const RawRow&)>& visit);
  // A row's record that begins on the page at `at` and has so many bytes, with what lies on overflow pages.
  bool ReadPayload(Bytes page, std::size_t at, std::uint64_t size, bool is_table, std::vector<std::uint8_t>* payload);

  std::ifstream file_;
  std::uint64_t file_bytes_ = 0;
  std::map<std::uint32_t, std::vector<std::uint8_t>> from_log_;
  std::uint32_t page_bytes_ = 0;
  std::uint32_t num_pages_ = 0;
  std::vector<bool> free_;
  bool knows_free_pages_ = false;
};

}  // namespace cairn::store
