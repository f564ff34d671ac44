// Writes the map ready to be queried (ready_pages.h), or what of it has changed since it was written last.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "store/ready_pages.h"
#include "store/sqlite.h"

namespace cairn::store {

// Pages on their way into the table: in one transaction if they are few, else in several, lest the log grow as large as
// the map; then the index, without which nobody looks at the others, goes first and comes back last.
class ReadyPageWriter {
 public:
  // `mark` is called in each transaction, for what every change of the file carries.
  static absl::StatusOr<ReadyPageWriter> Begin(Database* database, Revision revision,
                                               std::function<absl::Status()> mark);

  absl::Status Put(ReadyKind kind, std::uint32_t number, absl::string_view content);
  absl::Status Remove(ReadyKind kind, std::uint32_t number);
  // The last pages; `all`: pages that were not put now are removed.
  absl::Status Finish(const ReadyIndex& index, bool all);

 private:
  ReadyPageWriter(Database* database, Revision revision, std::function<absl::Status()> mark)
      : database_(database), revision_(revision), mark_(std::move(mark)) {}
  absl::Status EnsureTransaction();

  Database* database_;
  Revision revision_;
  std::function<absl::Status()> mark_;
  std::optional<Transaction> transaction_;
  std::size_t waiting_bytes_ = 0;  // in it
  bool index_removed_ = false;
  Statement put_, remove_;
};

// The numbers of the pages on which ids are, ascending.
template <class Ids>
std::vector<std::uint32_t> PagesOf(const Ids& ids, std::uint32_t per_page) {
  std::vector<std::uint32_t> pages;
  for (const auto id : ids) pages.push_back(id.value() / per_page);
  std::sort(pages.begin(), pages.end());
  pages.erase(std::unique(pages.begin(), pages.end()), pages.end());
  return pages;
}

// All entities of a page in the map.
std::vector<const map::Keyframe*> KeyframesOfPage(const map::Snapshot& map, std::uint32_t number);
std::vector<const map::MapPoint*> PointsOfPage(const map::Snapshot& map, std::uint32_t number);

}  // namespace cairn::store
