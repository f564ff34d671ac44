// Whether the map ready to be queried (ready_pages.h) says what the tables say.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "store/map_assembly.h"
#include "store/ready_pages.h"
#include "store/sqlite.h"

namespace cairn::store {

// Within one read transaction. Pages of the newest revision are compared with what would be written now; of an older
// one, which a writer that was killed left, their checksums are looked at.
class ReadyCheck {
 public:
  ReadyCheck(Database* database, FindingSink sink) : database_(database), sink_(std::move(sink)) {}

  // Every checksum, and what is needed for the rest. `newest`: the revision of the map.
  absl::Status Begin(Revision newest);
  // Of each keyframe, as they go by.
  void TakeWords(KeyframeId keyframe, const std::vector<std::uint32_t>& words);
  absl::Status Finish(const map::Snapshot& map);

  // The same page by page (CheckReadyPage), for who does not have all of the map at once; only if this is so.
  bool compares() const { return index_.has_value(); }
  // `index`: what it should say, but for the place index.
  absl::Status CheckIndex(ReadyIndex index);

 private:
  absl::Status CheckPage(ReadyKind kind, std::uint32_t number, const std::string& expected) const;
  absl::Status Report(ReadyKind kind, std::uint32_t number, absl::string_view message) const;
  // Whether there is the table, as it should be.
  absl::StatusOr<bool> CheckTable();
  absl::Status CheckChecksums();
  absl::Status ReadPlaces();
  absl::Status CheckSummary();

  Database* database_;
  FindingSink sink_;
  std::optional<ReadyIndex> index_;                     // of the newest revision
  std::vector<float> idf_;                              // by word; empty if the vocabulary cannot be read
  std::vector<std::uint32_t> counts_;                   // by word, of the keyframe that goes by; 0 else
  std::unordered_map<KeyframeId, std::uint64_t> bags_;  // what the place index says of each, in short
  std::vector<KeyframeId> wrong_;                       // of which it says something else than their words
};

// Whether this page, whose checksum is known to be good, says what is `expected`. In any connection.
absl::Status CheckReadyPage(Database* database, const FindingSink& sink, ReadyKind kind, std::uint32_t number,
                            const std::string& expected);

}  // namespace cairn::store
