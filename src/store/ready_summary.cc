#include "store/ready_summary.h"

#include <algorithm>
#include <array>

#include "store/byte_stream.h"
#include "store/ready_file.h"
#include "store/row.h"
#include "store/table_spec.h"

namespace cairn::store {
namespace {

// The order is that of the page.
constexpr std::array<absl::string_view, 8> kTables = {
    "cameras", "lenses", "sessions", "loops", "reported_trajectories", "components", "changes", "touched"};
constexpr std::size_t kDescriptionTables = 6;

absl::StatusOr<std::int64_t> CountRows(Database* database, absl::string_view table) {
  return database->QueryInt(absl::StrCat("SELECT count(*) FROM ", table));
}

std::optional<ReadySummary> Unpack(Bytes content) {
  ByteReader in(content);
  ReadySummary summary;
  for (std::uint64_t left = in.VarintUpTo(in.left()); left > 0 && in.ok(); --left) {
    map::KeyframeShare& share = summary.shares.emplace_back();
    share.session = SessionId(static_cast<SessionId::Value>(in.VarintUpTo(UINT32_MAX)));
    share.component = ComponentId(static_cast<ComponentId::Value>(in.VarintUpTo(UINT32_MAX)));
    share.keyframes = static_cast<std::int64_t>(in.VarintUpTo(UINT32_MAX));
    share.first_ns = in.Zigzag();
    share.last_ns = in.Zigzag();
  }
  for (std::uint64_t left = in.VarintUpTo(in.left()); left > 0 && in.ok(); --left) {
    summary.rows.push_back(static_cast<std::int64_t>(in.VarintUpTo(INT64_MAX)));
  }
  if (!in.ok() || in.left() != 0 || summary.rows.size() != kTables.size()) return std::nullopt;
  return summary;
}

}  // namespace

absl::StatusOr<std::vector<map::KeyframeShare>> CountShares(Database* database, std::int64_t format) {
  CAIRN_ASSIGN_OR_RETURN(Statement rows,
                         database->Prepare(absl::StrCat(
                             "SELECT session, ", format >= 4 ? "component" : "0",
                             ", count(*), min(time_ns), max(time_ns) FROM keyframes GROUP BY 1, 2 ORDER BY 1, 2")));
  std::vector<map::KeyframeShare> shares;
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return shares;
    shares.push_back({SessionId(static_cast<SessionId::Value>(rows.Int(0))),
                      ComponentId(static_cast<ComponentId::Value>(rows.Int(1))), rows.Int(2), rows.Int(3),
                      rows.Int(4)});
  }
}

absl::StatusOr<ReadySummary> Summarize(Database* database) {
  ReadySummary summary;
  CAIRN_ASSIGN_OR_RETURN(summary.shares, CountShares(database, kNewestFormat));
  for (const absl::string_view table : kTables) {
    CAIRN_ASSIGN_OR_RETURN(summary.rows.emplace_back(), CountRows(database, table));
  }
  return summary;
}

std::string PackReadySummary(const ReadySummary& summary) {
  ByteWriter out;
  out.Varint(summary.shares.size());
  for (const map::KeyframeShare& share : summary.shares) {
    out.Varint(share.session.value());
    out.Varint(share.component.value());
    out.Varint(static_cast<std::uint64_t>(share.keyframes));
    out.Zigzag(share.first_ns);
    out.Zigzag(share.last_ns);
  }
  out.Varint(summary.rows.size());
  for (const std::int64_t rows : summary.rows) out.Varint(static_cast<std::uint64_t>(rows));
  return out.Take();
}

std::optional<ReadySummary> ReadReadySummary(Database* database, Revision newest) {
  Revision revision = 0;
  const auto page = ReadReadyPage(database, ReadyKind::kSummary, 0, &revision);
  if (!page.ok() || !*page || revision != newest) return std::nullopt;
  return Unpack(AsBytes(**page));
}

absl::Status CheckRowCounts(Database* database, Revision newest, Counted which, const FindingSink& sink) {
  const std::optional<ReadySummary> summary = ReadReadySummary(database, newest);
  return summary ? CompareRowCounts(*summary, database, which, sink) : absl::OkStatus();
}

absl::Status CompareRowCounts(const ReadySummary& summary, Database* database, Counted which, const FindingSink& sink) {
  const std::size_t begin = which == Counted::kDescription ? 0 : kDescriptionTables;
  const std::size_t end = which == Counted::kDescription ? kDescriptionTables : kTables.size();
  for (std::size_t i = begin; i < end; ++i) {
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t rows, CountRows(database, kTables[i]));
    if (rows == summary.rows[i]) continue;
    CAIRN_RETURN_IF_ERROR(
        sink({std::string(kTables[i]), 0, absl::StrCat("there are ", rows, " rows instead of ", summary.rows[i])}));
  }
  return absl::OkStatus();
}

}  // namespace cairn::store
