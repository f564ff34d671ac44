#include "store/ready_check.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_replace.h"
#include "place/posting_segment.h"
#include "place/vocabulary.h"
#include "store/map_reader.h"
#include "store/ready_file.h"
#include "store/ready_summary.h"
#include "store/ready_writer.h"
#include "store/row.h"

namespace cairn::store {
namespace {

// Of a word and how often it is there, to be added up: the order does not matter.
std::uint64_t BagPart(std::uint32_t word, std::uint32_t count) {
  std::uint64_t x = (static_cast<std::uint64_t>(word) << 32 | count) + 0x9E3779B97F4A7C15ull;
  x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ x >> 27) * 0x94D049BB133111EBull;
  return x ^ x >> 31;
}

absl::Status ReportPage(const FindingSink& sink, ReadyKind kind, std::uint32_t number, absl::string_view message) {
  return sink(Finding{std::string(kReadyTable), ReadyRowId(kind, number), std::string(message)});
}

}  // namespace

absl::Status ReadyCheck::Report(ReadyKind kind, std::uint32_t number, absl::string_view message) const {
  return ReportPage(sink_, kind, number, message);
}

absl::Status ReadyCheck::Begin(Revision newest) {
  CAIRN_ASSIGN_OR_RETURN(const bool there, CheckTable());
  if (!there) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(CheckChecksums());
  auto index = ReadReadyIndex(database_);
  if (!index.ok()) return Report(ReadyKind::kIndex, 0, index.status().message());
  if (!*index) return absl::OkStatus();
  if ((*index)->revision > newest) return Report(ReadyKind::kIndex, 0, "it is of a later revision than the map");
  if ((*index)->revision < newest) return absl::OkStatus();
  index_ = *std::move(index);
  return ReadPlaces();
}

absl::StatusOr<bool> ReadyCheck::CheckTable() {
  // Also under a name, or with columns, that a damaged byte has changed.
  CAIRN_ASSIGN_OR_RETURN(
      Statement rows,
      database_->Prepare(
          "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND (name = 'ready_pages' OR sql LIKE "
          "'%revision INTEGER NOT NULL,%bytes_checksum INTEGER NOT NULL,%bytes BLOB NOT NULL%')"));
  CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
  if (!found) return false;
  const std::string expected = absl::StrReplaceAll(kReadyTableSql, {{"IF NOT EXISTS ", ""}});
  if (rows.Text(0) == kReadyTable && rows.Text(1) == expected) return true;
  CAIRN_RETURN_IF_ERROR(sink_(Finding{std::string(rows.Text(0)), 0, "is not defined as it should be"}));
  return false;
}

absl::Status ReadyCheck::CheckChecksums() {
  CAIRN_ASSIGN_OR_RETURN(Statement rows,
                         database_->Prepare("SELECT id, revision, bytes_checksum, bytes FROM ready_pages ORDER BY id"));
  while (true) {
    const absl::StatusOr<bool> found = rows.Step();
    if (!found.ok()) {
      if (!IsDamaged(found.status())) return found.status();
      return sink_(Finding{std::string(kReadyTable), 0, std::string(found.status().message())});
    }
    if (!*found) return absl::OkStatus();
    const auto content = OpenReadyPage(rows.Int(0), static_cast<Revision>(rows.Int(1)), rows.Int(2), rows.Blob(3));
    if (content.ok()) continue;
    CAIRN_RETURN_IF_ERROR(
        sink_(Finding{std::string(kReadyTable), rows.Int(0), std::string(content.status().message())}));
  }
}

absl::Status ReadyCheck::ReadPlaces() {
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kVocabularyTable.SelectSql("WHERE id = 1")));
  CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
  if (!found) return absl::OkStatus();
  const Bytes bytes = rows.Blob(2);
  const auto vocabulary =
      place::Vocabulary::Parse(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  if (!vocabulary.ok()) return absl::OkStatus();  // told by who checks that table
  for (place::WordId word = 0; word < vocabulary->num_words(); ++word) idf_.push_back(vocabulary->weight(word));
  counts_.assign(idf_.size(), 0);
  for (std::uint32_t number = 0; number < index_->segments.size(); ++number) {
    const std::vector<KeyframeId>& keyframes = index_->segments[number];
    auto segment = [&]() -> absl::StatusOr<place::PostingSegment> {
      CAIRN_ASSIGN_OR_RETURN(auto page, ReadReadyPage(database_, ReadyKind::kPlaces, number));
      if (!page) return absl::DataLossError("it is missing");
      CAIRN_ASSIGN_OR_RETURN(auto unpacked,
                             place::PostingSegment::Unpack(0, idf_.size(), SharedBytes(*std::move(page))));
      if (unpacked.num_entries() != keyframes.size()) return absl::DataLossError("it is of other keyframes");
      return unpacked;
    }();
    if (!segment.ok()) {
      CAIRN_RETURN_IF_ERROR(Report(ReadyKind::kPlaces, number, segment.status().message()));
      continue;
    }
    std::vector<std::uint64_t> bags(keyframes.size(), 0);
    for (place::WordId word = 0; word < idf_.size(); ++word) {
      segment->ForEachCount(word,
                            [&](std::uint32_t entry, std::uint32_t count) { bags[entry] += BagPart(word, count); });
    }
    for (std::size_t i = 0; i < keyframes.size(); ++i) {
      if (bags_.try_emplace(keyframes[i], bags[i]).second) continue;
      CAIRN_RETURN_IF_ERROR(Report(ReadyKind::kPlaces, number, "a keyframe is there twice"));
    }
  }
  return absl::OkStatus();
}

void ReadyCheck::TakeWords(KeyframeId keyframe, const std::vector<std::uint32_t>& words) {
  if (!index_ || idf_.empty()) return;
  for (const std::uint32_t word : words) {
    if (word < counts_.size()) ++counts_[word];
  }
  std::uint64_t bag = 0;
  for (const std::uint32_t word : words) {
    if (word >= counts_.size() || counts_[word] == 0) continue;
    if (place::TermWeight(counts_[word], idf_[word]) > 0.0) bag += BagPart(word, counts_[word]);
    counts_[word] = 0;  // it may be there again, and is counted
  }
  const auto said = bags_.find(keyframe);
  if (said == bags_.end() || said->second != bag) wrong_.push_back(keyframe);
}

absl::Status CheckReadyPage(Database* database, const FindingSink& sink, ReadyKind kind, std::uint32_t number,
                            const std::string& expected) {
  const auto page = ReadReadyPage(database, kind, number);
  if (!page.ok()) return absl::OkStatus();  // told already
  if (!*page) return ReportPage(sink, kind, number, "it is missing");
  return **page == expected ? absl::OkStatus() : ReportPage(sink, kind, number, "it does not say what the tables say");
}

absl::Status ReadyCheck::CheckPage(ReadyKind kind, std::uint32_t number, const std::string& expected) const {
  return CheckReadyPage(database_, sink_, kind, number, expected);
}

absl::Status ReadyCheck::CheckIndex(ReadyIndex index) {
  for (const KeyframeId id : wrong_) {
    CAIRN_RETURN_IF_ERROR(Report(ReadyKind::kPlaces, 0,
                                 absl::StrCat("the place index does not have the words of keyframe ", id.value())));
  }
  index.segments = index_->segments;
  CAIRN_RETURN_IF_ERROR(CheckPage(ReadyKind::kIndex, 0, index.Pack()));
  return CheckSummary();
}

// Maps that were closed before there was this page have none, or an old one, which nobody asks.
absl::Status ReadyCheck::CheckSummary() {
  Revision revision = 0;
  const auto page = ReadReadyPage(database_, ReadyKind::kSummary, 0, &revision);
  if (!page.ok() || !*page || revision != index_->revision) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(const ReadySummary expected, Summarize(database_));
  return CheckPage(ReadyKind::kSummary, 0, PackReadySummary(expected));
}

absl::Status ReadyCheck::Finish(const map::Snapshot& map) {
  if (!index_) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(std::optional<ReadyIndex> expected, IndexOf(map));
  if (!expected) return Report(ReadyKind::kIndex, 0, "the map's ids are too scattered for one");
  CAIRN_RETURN_IF_ERROR(CheckIndex(*std::move(expected)));
  for (std::uint32_t page = 0; page * kKeyframesPerPage < map.next_keyframe().value(); ++page) {
    const auto keyframes = KeyframesOfPage(map, page);
    if (keyframes.empty()) continue;
    CAIRN_RETURN_IF_ERROR(CheckPage(ReadyKind::kKeyframes, page, PackReadyKeyframes(keyframes)));
  }
  for (std::uint32_t page = 0; page * std::uint64_t{kPointsPerPage} < map.next_point().value(); ++page) {
    const auto points = PointsOfPage(map, page);
    if (points.empty()) continue;
    CAIRN_RETURN_IF_ERROR(CheckPage(ReadyKind::kPoints, page, PackReadyPoints(points)));
  }
  return absl::OkStatus();
}

}  // namespace cairn::store
