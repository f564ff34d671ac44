#include "store/write_ahead_log.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <random>
#include <set>
#include <vector>

#include "absl/strings/str_format.h"
#include "store/fault.h"
#include "store/file_paths.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

// The layout of databases and logs: https://www.sqlite.org/fileformat2.html, sections 1.3, 1.6, 2.1 and 4.
constexpr std::size_t kLogHeaderBytes = 32;
constexpr std::size_t kFrameHeaderBytes = 24;
constexpr std::uint32_t kLogMagic = 0x377f0682;  // the lowest bit: checksums over big-endian words
constexpr std::size_t kPageSizeAt = 16;
constexpr std::size_t kSchemaCookieAt = 40;
constexpr std::uint8_t kTableLeaf = 0x0d;
// Table `map` is the first that a map file gets, so that its only page comes after the one of the schema; it stays
// there, also when SQLite writes the file anew.
constexpr std::uint32_t kMapPage = 2;
// Formats before 4 held the alignment of the map, too.
constexpr std::size_t kColumnsBefore4 = 26;

std::uint32_t BigEndian(const std::uint8_t* at) {
  return static_cast<std::uint32_t>(at[0]) << 24 | static_cast<std::uint32_t>(at[1]) << 16 |
         static_cast<std::uint32_t>(at[2]) << 8 | at[3];
}

std::uint32_t LittleEndian(const std::uint8_t* at) {
  return static_cast<std::uint32_t>(at[3]) << 24 | static_cast<std::uint32_t>(at[2]) << 16 |
         static_cast<std::uint32_t>(at[1]) << 8 | at[0];
}

std::uint32_t PageBytes(Bytes header) {
  const std::uint32_t bytes = static_cast<std::uint32_t>(header[kPageSizeAt]) << 8 | header[kPageSizeAt + 1];
  return bytes == 1 ? 65536 : bytes;
}

// Reads a record: a variable-length integer, or a column. False at the end of the bytes.
class RecordReader {
 public:
  explicit RecordReader(Bytes bytes) : bytes_(bytes) {}

  bool Varint(std::uint64_t* value) {
    *value = 0;
    for (int i = 0; i < 9; ++i) {
      if (at_ >= bytes_.size()) return false;
      const std::uint8_t byte = bytes_[at_++];
      if (i == 8) {
        *value = *value << 8 | byte;
        return true;
      }
      *value = *value << 7 | (byte & 0x7f);
      if ((byte & 0x80) == 0) return true;
    }
    return true;
  }
  bool Take(std::size_t size, Bytes* out) {
    if (size > bytes_.size() - at_) return false;
    *out = bytes_.subspan(at_, size);
    at_ += size;
    return true;
  }
  std::size_t at() const { return at_; }

 private:
  Bytes bytes_;
  std::size_t at_ = 0;
};

struct Column {
  std::uint64_t type = 0;
  Bytes bytes;

  std::string Text() const {
    if (type < 13 || type % 2 == 0) return {};
    return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }
  std::int64_t Int() const {
    if (type == 9) return 1;
    std::int64_t value = 0;
    if (type >= 1 && type <= 6) {
      for (const std::uint8_t byte : bytes) value = value << 8 | byte;
    }
    return value;
  }
};

std::size_t SizeOfType(std::uint64_t type) {
  constexpr std::array<std::size_t, 12> kSizes = {0, 1, 2, 3, 4, 6, 8, 8, 0, 0, 0, 0};
  return type < kSizes.size() ? kSizes[type] : static_cast<std::size_t>((type - 12) / 2);
}

// The columns of the only row of a leaf page, as far as they are on the page.
std::vector<Column> OnlyRow(Bytes page) {
  if (page.size() < 512 || page[0] != kTableLeaf || page[3] != 0 || page[4] != 1) return {};
  const std::size_t at = static_cast<std::size_t>(page[8]) << 8 | page[9];
  if (at >= page.size()) return {};
  RecordReader cell(page.subspan(at));
  std::uint64_t payload_bytes = 0, rowid = 0, header_bytes = 0;
  if (!cell.Varint(&payload_bytes) || !cell.Varint(&rowid)) return {};
  const Bytes rest = page.subspan(at + cell.at());
  const Bytes payload = rest.first(std::min<std::size_t>(rest.size(), payload_bytes));
  RecordReader header(payload);
  if (!header.Varint(&header_bytes) || header_bytes > payload.size()) return {};
  RecordReader body(payload.subspan(header_bytes));
  std::vector<Column> columns;
  while (header.at() < header_bytes) {
    Column column;
    if (!header.Varint(&column.type)) return {};
    if (!body.Take(SizeOfType(column.type), &column.bytes)) return {};
    columns.push_back(column);
  }
  return columns;
}

// The changes in a log that SQLite would replay: those up to the last frame that ends one, with checksums in order.
struct LogContent {
  bool any = false;  // whole changes
  std::uint32_t page_bytes = 0;
  std::vector<MapState> states;    // after each change that touched the row of table `map`
  std::set<std::int64_t> cookies;  // of the schema
};

class LogReader {
 public:
  explicit LogReader(const std::string& path) : in_(path, std::ios::binary) {}

  LogContent Read() {
    LogContent content;
    std::array<std::uint8_t, kLogHeaderBytes> header{};
    if (!Fill(header)) return content;
    const std::uint32_t magic = BigEndian(header.data());
    if ((magic & ~1u) != kLogMagic) return content;
    big_endian_ = (magic & 1) != 0;
    content.page_bytes = BigEndian(header.data() + 8);
    const std::uint32_t page_bytes = content.page_bytes;
    if (page_bytes < 512 || page_bytes > 65536 || (page_bytes & (page_bytes - 1)) != 0) return content;
    Sum(Bytes(header).first(24));
    if (!SumIs(header.data() + 24)) return content;

    std::vector<std::uint8_t> frame(kFrameHeaderBytes + page_bytes);
    std::optional<MapState> state;
    std::optional<std::int64_t> cookie;
    while (Fill(frame)) {
      if (std::memcmp(frame.data() + 8, header.data() + 16, 8) != 0) break;  // salts: of an earlier use of the file
      const Bytes page = Bytes(frame).subspan(kFrameHeaderBytes);
      Sum(Bytes(frame).first(8));
      Sum(page);
      if (!SumIs(frame.data() + 16)) break;
      const std::uint32_t number = BigEndian(frame.data());
      if (number == 1) cookie = BigEndian(page.data() + kSchemaCookieAt);
      if (number == kMapPage) state = ParseMapPage(page);
      if (BigEndian(frame.data() + 4) == 0) continue;  // more of the same change follows
      content.any = true;
      if (state) content.states.push_back(*state);
      if (cookie) content.cookies.insert(*cookie);
      state.reset();
      cookie.reset();
    }
    return content;
  }

 private:
  template <class Buffer>
  bool Fill(Buffer& buffer) {
    in_.read(reinterpret_cast<char*>(buffer.data()), static_cast<std::streamsize>(buffer.size()));
    return in_.gcount() == static_cast<std::streamsize>(buffer.size());
  }
  void Sum(Bytes bytes) {
    for (std::size_t i = 0; i + 8 <= bytes.size(); i += 8) {
      const std::uint8_t* at = bytes.data() + i;
      sum_[0] += (big_endian_ ? BigEndian(at) : LittleEndian(at)) + sum_[1];
      sum_[1] += (big_endian_ ? BigEndian(at + 4) : LittleEndian(at + 4)) + sum_[0];
    }
  }
  bool SumIs(const std::uint8_t* at) const { return sum_[0] == BigEndian(at) && sum_[1] == BigEndian(at + 4); }

  std::ifstream in_;
  bool big_endian_ = false;
  std::uint32_t sum_[2] = {0, 0};
};

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
  base.page_bytes = PageBytes(header);
  base.cookie = BigEndian(header.data() + kSchemaCookieAt);
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
  const std::vector<Column> columns = OnlyRow(page);
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
  const std::uint32_t page_bytes = PageBytes(header);
  std::vector<std::uint8_t> page(page_bytes);
  CAIRN_RETURN_IF_ERROR(database->ReadRaw(page, std::int64_t{page_bytes} * (kMapPage - 1)));
  return ParseMapPage(page);
}

absl::Status CheckLog(const std::string& path) {
  CAIRN_RETURN_IF_ERROR(CheckJournal(path));
  const std::string log_path = absl::StrCat(path, kLogSuffix);
  // A writer at work may put its log into the file between our looks at the two.
  constexpr int kAttempts = 20;
  std::string wrong;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    if (!HasContent(log_path)) return absl::OkStatus();
    const absl::StatusOr<BaseState> base = ReadBase(path);
    if (!base.ok()) return absl::OkStatus();  // whoever opens the file is told why it cannot be read
    wrong = Contradiction(*base, LogReader(log_path).Read());
    if (wrong.empty()) return absl::OkStatus();
    if (attempt >= 2 && !WriterLock::IsHeld(path)) break;
  }
  return MakeFault(Fault::kForeignLog,
                   absl::StrCat("the write-ahead log beside it, ", log_path, ", does not belong to this file: ", wrong,
                                ". Was a copy put over a map whose writer had been killed? The file is complete as it "
                                "is; to use it, move the log away: mv '",
                                log_path, "' '", log_path, ".old'"));
}

}  // namespace cairn::store
