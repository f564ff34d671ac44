#include "store/ready_writer.h"

#include <utility>

#include "store/ready_summary.h"
#include "store/row.h"

namespace cairn::store {
namespace {

constexpr std::size_t kTransactionBytes = 16'000'000;

}  // namespace

absl::StatusOr<ReadyPageWriter> ReadyPageWriter::Begin(Database* database, Revision revision,
                                                       std::function<absl::Status()> mark) {
  ReadyPageWriter writer(database, revision, std::move(mark));
  CAIRN_ASSIGN_OR_RETURN(writer.put_, database->Prepare("INSERT OR REPLACE INTO ready_pages "
                                                        "(id, revision, bytes_checksum, bytes) VALUES (?, ?, ?, ?)"));
  CAIRN_ASSIGN_OR_RETURN(writer.remove_, database->Prepare("DELETE FROM ready_pages WHERE id = ?"));
  return writer;
}

absl::Status ReadyPageWriter::EnsureTransaction() {
  if (transaction_ && waiting_bytes_ < kTransactionBytes) return absl::OkStatus();
  if (transaction_) {
    // Nobody is to take this revision's pages for those of the index that is there.
    if (!index_removed_) CAIRN_RETURN_IF_ERROR(remove_.RunWith(ReadyRowId(ReadyKind::kIndex, 0)));
    index_removed_ = true;
    CAIRN_RETURN_IF_ERROR(mark_());
    CAIRN_RETURN_IF_ERROR(transaction_->Commit());
    transaction_.reset();
  }
  CAIRN_ASSIGN_OR_RETURN(Transaction next, Transaction::Begin(database_, Transaction::Kind::kWrite));
  transaction_.emplace(std::move(next));
  waiting_bytes_ = 0;
  return absl::OkStatus();
}

absl::Status ReadyPageWriter::Put(ReadyKind kind, std::uint32_t number, absl::string_view content) {
  CAIRN_RETURN_IF_ERROR(EnsureTransaction());
  const std::int64_t row_id = ReadyRowId(kind, number);
  const std::string bytes = SealReadyPage(row_id, revision_, content);
  put_.Bind(1, row_id);
  put_.Bind(2, static_cast<std::int64_t>(revision_));
  put_.Bind(3, BlobChecksum(AsBytes(bytes)));
  put_.Bind(4, AsBytes(bytes));
  waiting_bytes_ += bytes.size();
  return put_.Run();
}

absl::Status ReadyPageWriter::Remove(ReadyKind kind, std::uint32_t number) {
  CAIRN_RETURN_IF_ERROR(EnsureTransaction());
  return remove_.RunWith(ReadyRowId(kind, number));
}

absl::Status ReadyPageWriter::Finish(const ReadyIndex& index, bool all) {
  CAIRN_ASSIGN_OR_RETURN(const ReadySummary summary, Summarize(database_));
  CAIRN_RETURN_IF_ERROR(Put(ReadyKind::kSummary, 0, PackReadySummary(summary)));
  CAIRN_RETURN_IF_ERROR(Put(ReadyKind::kIndex, 0, index.Pack()));
  if (all) {
    CAIRN_ASSIGN_OR_RETURN(Statement others, database_->Prepare("DELETE FROM ready_pages WHERE revision <> ?"));
    CAIRN_RETURN_IF_ERROR(others.RunWith(revision_));
  }
  CAIRN_RETURN_IF_ERROR(mark_());
  return transaction_->Commit();
}

std::vector<const map::Keyframe*> KeyframesOfPage(const map::Snapshot& map, std::uint32_t number) {
  std::vector<const map::Keyframe*> keyframes;
  for (std::uint32_t i = 0; i < kKeyframesPerPage; ++i) {
    const map::Keyframe* keyframe = map.keyframes().Find(KeyframeId(number * kKeyframesPerPage + i));
    if (keyframe != nullptr) keyframes.push_back(keyframe);
  }
  return keyframes;
}

std::vector<const map::MapPoint*> PointsOfPage(const map::Snapshot& map, std::uint32_t number) {
  std::vector<const map::MapPoint*> points;
  for (std::uint32_t i = 0; i < kPointsPerPage; ++i) {
    const map::MapPoint* point = map.points().Find(PointId(number * kPointsPerPage + i));
    if (point != nullptr) points.push_back(point);
  }
  return points;
}

}  // namespace cairn::store
