#include "store/recover.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "base/version.h"
#include "store/delta_writer.h"
#include "store/file_paths.h"
#include "store/finding_limit.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/mending.h"
#include "store/ready_summary.h"
#include "store/salvage.h"
#include "store/write_ahead_log.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

class Recovery {
 public:
  explicit Recovery(const RecoverOptions& options) : options_(options) {}

  absl::StatusOr<RecoverReport> Run(const std::string& bad, const std::string& good) {
    CAIRN_RETURN_IF_ERROR(Salvage(bad));
    CAIRN_RETURN_IF_ERROR(ReadWhatIsLeft());
    CAIRN_RETURN_IF_ERROR(CountWhatIsLeft(bad));
    if (rows_.map_row.info.id.empty()) CAIRN_RETURN_IF_ERROR(MakeUpMapRow(bad));
    CAIRN_RETURN_IF_ERROR(MendRows());
    ChooseVocabulary();
    CAIRN_RETURN_IF_ERROR(Annotate(Write(bad, good), absl::StrCat("writing ", good)));
    return std::move(report_);
  }

 private:
  absl::Status Salvage(const std::string& bad) {
    std::string log = absl::StrCat(bad, kLogSuffix);
    if (!HasContent(log)) log.clear();
    if (const absl::Status own = CheckLog(bad); !log.empty() && FaultOf(own) == Fault::kForeignLog) {
      report_.notes.push_back(absl::StrCat("the log beside it is left out: ", own.message()));
      log.clear();
    }
    absl::StatusOr<Salvaged> salvaged = SalvageRows(bad, log);
    if (absl::IsDataLoss(salvaged.status())) return MakeFault(Fault::kDamaged, salvaged.status().message());
    CAIRN_RETURN_IF_ERROR(salvaged.status());
    salvaged_ = *std::move(salvaged);
    for (std::string& note : salvaged_.notes) report_.notes.push_back(std::move(note));
    return absl::OkStatus();
  }

  // Row by row; what is wrong is noted and left out.
  absl::Status ReadWhatIsLeft() {
    MapReader reader(salvaged_.rows.get(), [this](const Finding& finding) {
      if (report_.findings.size() < kMaxFindings) report_.findings.push_back(finding);
      return absl::OkStatus();
    });
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(reader.ReadEntities());
    rows_ = reader.TakeRows();
    CAIRN_ASSIGN_OR_RETURN(Statement log,
                           salvaged_.rows->Prepare(kChangesTable.SelectSql("ORDER BY revision", rows_.format)));
    CAIRN_ASSIGN_OR_RETURN(changes_, ReadLog(std::move(log)));
    expected_keyframes_ = rows_.map_row.info.id.empty() ? -1 : rows_.map_row.keyframe_count;
    expected_points_ = rows_.map_row.info.id.empty() ? -1 : rows_.map_row.point_count;
    return absl::OkStatus();
  }

  // Of small tables whose rows nothing else refers to, if the file still says how many there were.
  absl::Status CountWhatIsLeft(const std::string& bad) {
    const auto resolved = ResolveExisting(bad);
    if (!resolved.ok() || HasContent(absl::StrCat(*resolved, kLogSuffix))) return absl::OkStatus();
    const auto database = Database::OpenFile(*resolved, Database::Mode::kImmutable);
    if (!database.ok()) return absl::OkStatus();
    const std::optional<ReadySummary> summary = ReadReadySummary(database->get(), rows_.map_row.revision);
    if (!summary || rows_.format != kNewestFormat) return absl::OkStatus();
    for (const Counted which : {Counted::kDescription, Counted::kLog}) {
      CAIRN_RETURN_IF_ERROR(CompareRowCounts(*summary, salvaged_.rows.get(), which, [this](const Finding& finding) {
        if (finding.table == kTouchedTable.name) return absl::OkStatus();  // the new map begins it anew
        report_.notes.push_back(absl::StrCat("of table ", finding.table, " rows are lost: ", finding.message));
        return absl::OkStatus();
      }));
    }
    return absl::OkStatus();
  }

  absl::Status MakeUpMapRow(const std::string& bad) {
    MapRow& row = rows_.map_row;
    row.info.id = NewLogToken();  // as random as an id
    row.info.name = bad.substr(bad.find_last_of('/') + 1);
    row.info.software_version = kVersion;
    int levels = row.info.orb.num_levels;
    for (const auto& keyframe : rows_.keyframes) {
      if (!keyframe->features) continue;
      for (const image::Keypoint& keypoint : keyframe->keypoints()) levels = std::max(levels, keypoint.octave + 1);
    }
    row.info.orb.num_levels = levels;
    for (const char* table : {"keyframes", "points", "changes"}) {
      if (rows_.format < 4 && table != std::string("changes")) continue;
      CAIRN_ASSIGN_OR_RETURN(const std::int64_t newest,
                             salvaged_.rows->QueryInt(absl::StrCat("SELECT coalesce(max(revision), 1) FROM ", table)));
      row.revision = std::max(row.revision, static_cast<Revision>(newest));
    }
    report_.notes.emplace_back(
        "what was known of the map as a whole is lost: it has another id, is called by its file, and how its features "
        "were extracted is taken to be as usual");
    return absl::OkStatus();
  }

  absl::Status MendRows() {
    if (rows_.keyframes.empty() && expected_keyframes_ == 0) {
      return absl::FailedPreconditionError(
          "the map had no keyframes: there is nothing to save (cairn create makes such a map)");
    }
    absl::StatusOr<Mended> mended = Mend(&rows_);
    if (absl::IsDataLoss(mended.status())) return MakeFault(Fault::kDamaged, mended.status().message());
    CAIRN_RETURN_IF_ERROR(mended.status());
    report_.lost_keyframes = std::move(mended->lost_keyframes);
    for (std::string& note : mended->notes) report_.notes.push_back(std::move(note));
    report_.keyframes = static_cast<std::int64_t>(rows_.keyframes.size());
    report_.points = static_cast<std::int64_t>(rows_.points.size());
    if (expected_keyframes_ >= 0)
      report_.keyframes_lost = std::max<std::int64_t>(0, expected_keyframes_ - report_.keyframes);
    if (expected_points_ >= 0) report_.points_lost = std::max<std::int64_t>(0, expected_points_ - report_.points);
    return absl::OkStatus();
  }

  void ChooseVocabulary() {
    map::MapInfo& info = rows_.map_row.info;
    auto stored = salvaged_.rows->Prepare(kVocabularyTable.SelectSql("WHERE id = 1"));
    if (stored.ok()) {
      const absl::StatusOr<bool> found = stored->Step();
      if (found.ok() && *found) {
        const Bytes bytes = stored->Blob(2);
        vocabulary_.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
      }
    }
    const bool named = info.vocabulary_hash != 0 || expected_keyframes_ < 0;
    if (vocabulary_.empty() && options_.vocabulary_hash != 0 && info.vocabulary_hash == options_.vocabulary_hash) {
      vocabulary_ = options_.vocabulary;
      report_.notes.emplace_back(
          "its vocabulary is lost; the one that ships with Cairn is the same, and took its place");
    } else if (vocabulary_.empty() && named) {
      report_.notes.emplace_back("its vocabulary is lost, so that no place can be found in it");
    }
    report_.vocabulary = !vocabulary_.empty();
  }

  absl::Status Write(const std::string& bad, const std::string& good) {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveNew(good));
    CAIRN_RETURN_IF_ERROR(CheckNoCompanion(resolved));
    CAIRN_RETURN_IF_ERROR(CheckFileSystem(resolved));
    CAIRN_ASSIGN_OR_RETURN(const auto lock, WriterLock::Acquire(resolved));
    if (access(resolved.c_str(), F_OK) == 0) return MakeFault(Fault::kExists, "exists already: choose another name");
    // The change that mended it is one of the map's own, after all that it had.
    MapRow row = rows_.map_row;
    const Revision before = row.revision;
    rows_.map_row.revision = before + 1;
    row.keyframe_count = row.point_count = row.covisibility_count = 0;
    // The change gives the ids anew.
    row.next_keyframe = KeyframeId(1);
    row.next_point = PointId(1);
    row.next_camera = CameraId(1);
    row.next_session = SessionId(1);
    row.next_component = ComponentId(1);
    row.info_revision = before;
    // Who follows the map must load it anew.
    row.oldest_delta_base = before + 1;
    row.log_token.clear();
    row.previous_log_token.clear();
    CAIRN_ASSIGN_OR_RETURN(map::Delta content, AssembleMap(std::move(rows_), DamagedBy));
    content.base = before;
    content.reason = absl::StrCat("recovered from ", bad.substr(bad.find_last_of('/') + 1));
    const auto checked = map::Snapshot::Empty(row.info, before)->Apply(content);
    if (!checked.ok()) return MakeFault(Fault::kDamaged, checked.status().message());
    report_.revision = content.revision();
    return WriteFile(row, content, resolved);
  }

  absl::Status WriteFile(const MapRow& row, const map::Delta& content, const std::string& resolved) {
    const std::string fresh = absl::StrCat(resolved, kNewSuffix);
    CAIRN_RETURN_IF_ERROR(WriteMapAt(fresh, row, vocabulary_));
    const absl::Status written = [&]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(fresh, Database::Mode::kReadWrite));
      CAIRN_RETURN_IF_ERROR(PrepareForWriting(database.get(), {}));
      {
        CAIRN_ASSIGN_OR_RETURN(const auto writer, DeltaWriter::Prepare(database.get()));
        CAIRN_RETURN_IF_ERROR(writer->PutHistory(changes_));
        CAIRN_RETURN_IF_ERROR(writer->BeginLog());
        using std::chrono::nanoseconds;
        const auto now = std::chrono::system_clock::now().time_since_epoch();
        CAIRN_RETURN_IF_ERROR(writer->Commit(content, std::chrono::duration_cast<nanoseconds>(now).count()));
      }
      CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA wal_checkpoint(TRUNCATE)"));
      CAIRN_RETURN_IF_ERROR(database->Close());
      return PutInPlace(fresh, resolved);
    }();
    if (!written.ok()) {
      unlink(fresh.c_str());
      RemoveCompanions(fresh);
    }
    return written;
  }

  const RecoverOptions& options_;
  RecoverReport report_;
  Salvaged salvaged_;
  MapRows rows_;
  std::vector<LoggedChange> changes_;
  std::int64_t expected_keyframes_ = -1;
  std::int64_t expected_points_ = -1;
  std::string vocabulary_;
};

}  // namespace

absl::StatusOr<RecoverReport> RecoverMap(const std::string& bad, const std::string& good,
                                         const RecoverOptions& options) {
  auto recovered = [&]() -> absl::StatusOr<RecoverReport> {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveExisting(bad));
    return Recovery(options).Run(resolved, good);
  }();
  if (!recovered.ok()) return Annotate(recovered.status(), absl::StrCat("recovering ", bad));
  return recovered;
}

}  // namespace cairn::store
