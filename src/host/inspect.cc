#include "host/inspect.h"

#include <filesystem>
#include <memory>
#include <utility>

#include "health/map_vocabulary.h"
#include "health/verify_map.h"
#include "host/describe.h"
#include "store/map_overview.h"
#include "store/map_store.h"
#include "store/writer_lock.h"

namespace cairn::host {

absl::StatusOr<api::MapVerification> VerifyMap(const std::string& map, const std::string& uri, api::VerifyDepth depth) {
  CAIRN_ASSIGN_OR_RETURN(health::VerifyReport report,
                         health::VerifyMap(uri, {.deep = depth == api::VerifyDepth::kDeep}));
  api::MapVerification verified;
  if (report.summary) verified.summary = SummaryOf(map, *report.summary);
  verified.findings = std::move(report.findings);
  verified.notes = std::move(report.notes);
  return verified;
}

absl::StatusOr<map::MapOverview> ReadOverview(const std::string& uri) {
  CAIRN_ASSIGN_OR_RETURN(map::MapOverview overview, store::ReadMapOverview(uri));
  std::error_code error;
  overview.being_written = store::WriterLock::IsHeld(std::filesystem::weakly_canonical(uri, error).string());
  if (overview.summary.info.vocabulary_hash == 0 || overview.has_vocabulary) return overview;
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> file, store::OpenMapStore(uri, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const health::MapVocabulary vocabulary, health::LoadVocabulary(*file));
  if (!vocabulary.note.empty()) overview.notes.push_back(vocabulary.note);
  return overview;
}

absl::StatusOr<api::MapLog> ReadMapLog(const std::string& uri, const map::ChangeQuery& query) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> map, store::OpenMapStore(uri, store::OpenMode::kRead));
  if (query.session) {
    CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, map->ReadSummary());
    if (static_cast<std::int64_t>(query.session.value()) > summary.sessions) {
      return absl::NotFoundError(absl::StrCat(uri, " has no session ", query.session.value(), ", the last is ",
                                              summary.sessions, " (cairn info)"));
    }
  }
  api::MapLog log;
  CAIRN_ASSIGN_OR_RETURN(log.changes, map->ReadChanges(query));
  CAIRN_ASSIGN_OR_RETURN(log.revision, map->ReadRevision());
  return log;
}

}  // namespace cairn::host
