#include "store/write_ahead_log.h"

#include <algorithm>
#include <filesystem>
#include <random>
#include <set>
#include <vector>

#include "absl/strings/str_format.h"
#include "store/fault.h"
#include "store/file_paths.h"
#include "store/log_damage.h"
#include "store/log_frames.h"
#include "store/sqlite_record.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

constexpr std::uint8_t kTableLeaf = 0x0d;
// Table `map` is the first that a map file gets, so that its only page comes after the one of the schema; it stays
// there, also when SQLite writes the file anew.
constexpr std::uint32_t kMapPage = 2;
// Formats before 4 held the alignment of the map, too.
constexpr std::size_t kColumnsBefore4 = 26;

// The columns of the only row of a leaf page; none unless all of them are on the page.
std::vector<RecordColumn> OnlyRow(Bytes page) {
  if (page.size() < 512 || page[0] != kTableLeaf || page[3] != 0 || page[4] != 1) return {};
  const std::size_t at = BigEndian16(page.data() + 8);
  if (at >= page.size()) return {};
  const Bytes cell = page.subspan(at);
  std::size_t payload_at = 0;
  std::uint64_t payload_bytes = 0, rowid = 0;
  if (!ReadVarint(cell, &payload_at, &payload_bytes) || !ReadVarint(cell, &payload_at, &rowid)) return {};
  const Bytes rest = cell.subspan(payload_at);
  return ParseRecord(rest.first(std::min<std::size_t>(rest.size(), payload_bytes)))
      .value_or(std::vector<RecordColumn>());
}

// The changes in a log.
struct LogContent {
  // What SQLite would replay: changes up to the last one that is whole, with checksums in order.
  bool any = false;
  std::uint32_t page_bytes = 0;
  std::vector<MapState> states;    // after each change that touched the row of table `map`
  std::set<std::int64_t> cookies;  // of the schema
  // And what it passes over.
  int lost_changes = 0;        // that came to their end, the first one damaged
  Revision lost_revision = 0;  // of the newest of them, as far as that is known
};

LogContent ReadLogContent(const std::string& path) {
  LogContent content;
  std::optional<MapState> state;
  std::optional<std::int64_t> cookie;
  content.page_bytes = ForEachLogFrame(path, [&](const LogFrame& frame) {
    if (!frame.in_order) {
      content.lost_changes += frame.ends_change ? 1 : 0;
      // Of a damaged frame it is not known what it says.
      if (!frame.intact || frame.page != kMapPage) return;
      if (const auto lost = ParseMapPage(frame.bytes)) {
        content.lost_revision = std::max(content.lost_revision, lost->revision);
      }
      return;
    }
    if (frame.page == 1) cookie = BigEndian32(frame.bytes.data() + kSchemaCookieAt);
    if (frame.page == kMapPage) state = ParseMapPage(frame.bytes);
    if (!frame.ends_change) return;  // more of the same change follows
    content.any = true;
    if (state) content.states.push_back(*state);
    if (cookie) content.cookies.insert(*cookie);
    state.reset();
    cookie.reset();
  });
  // The change within which the damage begins.
  if (state && content.lost_changes > 0) content.lost_revision = std::max(content.lost_revision, state->revision);
  return content;
}

// The file by itself, without its log.
struct BaseState {
  std::uint32_t page_bytes = 0;
  std::int64_t cookie = 0;
  std::optional<MapState> map;
};

absl::StatusOr<BaseState> ReadBase(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const auto database, Database::OpenFile(path, Database::Mode::kImmutable));
  CAIRN_ASSIGN_OR_RETURN(const auto header, database->ReadHeader());
  BaseState base;
  base.page_bytes = PageBytesOf(header);
  base.cookie = BigEndian32(header.data() + kSchemaCookieAt);
  CAIRN_ASSIGN_OR_RETURN(base.map, ReadMapState(database.get()));
  return base;
}

// Why the log is not the file's; empty if it is.
std::string Contradiction(const BaseState& base, const LogContent& log) {
  if (!log.any) return {};  // nothing would be replayed
  if (log.page_bytes != base.page_bytes) return "it was written for another file";
  // The row in the file cannot be read: half of it may be in a page that was being written when the power failed. The
  // log mends that, and what it does not mend is found by the checksums.
  if (!base.map) return {};
  if (log.states.empty()) return "it holds changes that no Cairn made";
  const MapState& map = *base.map;
  const MapState& first = log.states.front();
  const MapState& last = log.states.back();
  if (last.map_id != map.map_id) return "it is of another map";
  if (map.revision > last.revision) {
    return absl::StrCat("it ends at revision ", last.revision, ", before revision ", map.revision, " of the file");
  }
  if (map.revision + 1 < first.revision) {
    return absl::StrCat("it begins with revision ", first.revision, ", and the file is at revision ", map.revision);
  }
  // Only the writer's token, or the step to a newer format, and nothing else: kills in between lose nothing.
  const bool only_opened = last.revision == map.revision;
  const bool same_writer = std::any_of(log.states.begin(), log.states.end(),
                                       [&](const MapState& state) { return state.log_token == map.log_token; });
  if (!same_writer && !(only_opened && (map.log_token.empty() || last.previous_log_token == map.log_token))) {
    return absl::StrCat("it was written for another state of this map than the one in the file, which is at revision ",
                        map.revision);
  }
  if (map.log_token.empty()) return {};
  const bool same_file = log.cookies.contains(base.cookie) ||
                         std::any_of(log.states.begin(), log.states.end(),
                                     [&](const MapState& state) { return state.schema_cookie == base.cookie; });
  return same_file ? "" : "it was written for another copy of this map";
}

absl::Status CheckJournal(const std::string& path) {
  const std::string journal = absl::StrCat(path, kJournalSuffix);
  if (!HasContent(journal)) return absl::OkStatus();
  return MakeFault(Fault::kForeignLog, absl::StrCat(journal,
                                                    " is not of this map, whose changes never go there; SQLite "
                                                    "would undo the map by it: move it away first"));
}

}  // namespace

std::string NewLogToken() {
  std::random_device random;
  std::string token;
  for (int i = 0; i < 4; ++i) absl::StrAppend(&token, absl::StrFormat("%08x", random() & 0xffffffffu));
  return token;
}

std::optional<MapState> ParseMapPage(Bytes page) {
  const std::vector<RecordColumn> columns = OnlyRow(page);
  MapState state;
  if (columns.size() == kColumnsBefore4) {
    state.revision = static_cast<Revision>(columns[19].Int());
  } else if (columns.size() > kColumnsBefore4) {
    constexpr std::size_t kRevision = 11, kToken = 18;
    state.revision = static_cast<Revision>(columns[kRevision].Int());
    state.log_token = columns[kToken].Text();
    state.previous_log_token = columns[kToken + 1].Text();
    state.schema_cookie = columns[kToken + 2].Int();
  } else {
    return std::nullopt;
  }
  state.map_id = columns[1].Text();
  if (state.map_id.size() != 32) return std::nullopt;
  return state;
}

absl::StatusOr<std::optional<MapState>> ReadMapState(Database* database) {
  CAIRN_ASSIGN_OR_RETURN(const auto header, database->ReadHeader());
  const std::uint32_t page_bytes = PageBytesOf(header);
  std::vector<std::uint8_t> page(page_bytes);
  CAIRN_RETURN_IF_ERROR(database->ReadRaw(page, std::int64_t{page_bytes} * (kMapPage - 1)));
  return ParseMapPage(page);
}

absl::Status CheckLog(const std::string& path, bool writing) {
  CAIRN_RETURN_IF_ERROR(CheckJournal(path));
  const std::string log_path = absl::StrCat(path, kLogSuffix);
  // A writer at work may put its log into the file between our looks at the two.
  constexpr int kAttempts = 20;
  std::string wrong;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    if (!HasContent(log_path)) return absl::OkStatus();
    const absl::StatusOr<BaseState> base = ReadBase(path);
    if (!base.ok()) return absl::OkStatus();  // whoever opens the file is told why it cannot be read
    wrong = Contradiction(*base, ReadLogContent(log_path));
    if (wrong.empty()) return absl::OkStatus();
    if (attempt >= 2 && (writing || !WriterLock::IsHeld(path))) break;
  }
  if (!writing && WriterLock::IsHeld(path)) {
    return MakeFault(Fault::kForeignLog,
                     absl::StrCat("another file was put in its place while it is written, so that the write-ahead log "
                                  "beside it, ",
                                  log_path, ", is of the map that was there: ", wrong,
                                  ". Leave both as they are until the writer ends: it saves its map beside this one, "
                                  "as .rescued"));
  }
  return MakeFault(Fault::kForeignLog,
                   absl::StrCat("the write-ahead log beside it, ", log_path, ", does not belong to this file: ", wrong,
                                ". Was a copy put over a map whose writer had been killed? The file is complete as it "
                                "is; to use it, move the log away: mv '",
                                log_path, "' '", log_path, ".old'"));
}

std::string DamageOfLog(const std::string& path) {
  const std::string log_path = absl::StrCat(path, kLogSuffix);
  if (!HasContent(log_path)) return {};
  const LogContent log = ReadLogContent(log_path);
  const absl::StatusOr<BaseState> base = ReadBase(path);
  Revision kept = base.ok() && base->map ? base->map->revision : 0;
  if (log.any && !log.states.empty()) kept = std::max(kept, log.states.back().revision);
  // An earlier use of the log, whose changes are in the file, and a last change that never came to its end.
  if (log.lost_changes == 0 || log.lost_revision <= kept) return {};
  if (log.lost_changes == 1) {
    return absl::StrCat("the last change in ", log_path, ", which led to revision ", log.lost_revision,
                        ", was cut off (as by a power failure) or is damaged: the map is at revision ", kept);
  }
  return absl::StrCat(log_path, " is damaged: the changes in it after revision ", kept, " up to revision ",
                      log.lost_revision, " cannot be replayed");
}

std::string LogDamageOf(const std::string& path) {
  const absl::StatusOr<std::string> resolved = ResolveExisting(path);
  if (!resolved.ok() || WriterLock::IsHeld(*resolved)) return {};
  const std::string damage = DamageOfLog(*resolved);
  return damage.empty()
             ? damage
             : absl::StrCat(damage, "; 'cairn recover' saves what is good of it, before the map is written to");
}

std::string KeepDamagedLog(const std::string& path) {
  const std::string damage = DamageOfLog(path);
  if (damage.empty()) return {};
  const std::string kept = FreePath(absl::StrCat(path, kLogSuffix, ".damaged"));
  std::error_code error;
  std::filesystem::copy_file(absl::StrCat(path, kLogSuffix), kept, error);
  if (error) return damage;
  return absl::StrCat(
      damage, ". The log is kept as ", kept,
      "; what is good of it is saved by 'cairn recover', given the map and that log beside it as it was");
}

}  // namespace cairn::store
