// What those who keep the maps ask of their host: copies, the trash, checks, alignment, history, files.
#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <filesystem>
#include <utility>

#include "absl/strings/str_format.h"
#include "base/guarded.h"
#include "base/told.h"
#include "care/session_removal.h"
#include "engine/map_alignment.h"
#include "host/export.h"
#include "host/inspect.h"
#include "host/map_host.h"
#include "place/vocabulary.h"
#include "store/map_store.h"

namespace cairn::host {

namespace {

// With what is in its log.
std::int64_t BytesOf(const std::string& path) {
  std::int64_t bytes = 0;
  for (const char* suffix : {"", "-wal"}) {
    std::error_code error;
    const auto size = std::filesystem::file_size(path + suffix, error);
    if (!error) bytes += static_cast<std::int64_t>(size);
  }
  return bytes;
}

}  // namespace

std::string MapHost::ScratchFolder(std::int64_t bytes) const {
  const bool may_write = faccessat(AT_FDCWD, options_.directory.c_str(), W_OK | X_OK, AT_EACCESS) == 0;
  if (may_write && FreeBytes() >= bytes) return options_.directory;
  std::error_code error;
  const std::filesystem::path other = std::filesystem::temp_directory_path(error);
  if (error) return options_.directory;
  const std::filesystem::space_info space = std::filesystem::space(other, error);
  const bool has_room = !error && static_cast<std::int64_t>(space.available) >= bytes;
  return may_write && !has_room ? options_.directory : other.string();
}

absl::Status MapHost::ToldOfChange(const absl::Status& status, absl::string_view undone) const {
  if (store::FaultOf(status) != store::Fault::kFull) return Told(status);
  struct statvfs disk = {};
  const bool known = statvfs(options_.directory.c_str(), &disk) == 0;
  const bool no_files = known && disk.f_files > 0 && disk.f_favail == 0;
  const std::string room =
      no_files ? "it takes no further file"
               : absl::StrFormat("%.1f MB are free, if its files may grow", static_cast<double>(FreeBytes()) / 1e6);
  spdlog::error("{}: {}", std::string(undone), std::string(status.message()));
  return store::MakeFault(
      store::Fault::kFull,
      absl::StrCat(undone, ", as the disk of the server that holds the maps is full (", room,
                   "); all else is as it was. Whoever runs the server makes room there, as by removing what is not "
                   "needed any more from .trash in the folder of the maps"));
}

absl::StatusOr<std::vector<api::ActiveSession>> MapHost::Sessions(const std::string& map) {
  std::vector<api::ActiveSession> sessions = ActiveSessions();
  if (map.empty()) return sessions;
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  std::erase_if(sessions, [&](const api::ActiveSession& session) { return session.map != map; });
  if (sessions.empty()) CAIRN_RETURN_IF_ERROR(PathOf(map).status());
  return sessions;
}

absl::StatusOr<api::MapSummary> MapHost::Create(const std::string& map, const std::string& title) {
  return Guarded([&]() -> absl::StatusOr<api::MapSummary> {
    CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
    CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const place::Vocabulary> vocabulary, DefaultVocabulary());
    const std::shared_ptr<Slot> slot = SlotOf(map);
    const std::lock_guard lock(slot->mutex);
    std::error_code error;
    if (std::filesystem::exists(std::filesystem::symlink_status(FileOf(map), error))) {
      return store::MakeFault(store::Fault::kExists, absl::StrCat("there is a map \"", map, "\" already"));
    }
    store::CreateOptions options;
    options.vocabulary = vocabulary->Serialize();
    options.at_once = true;
    auto created = store::CreateMapStore(FileOf(map), NewInfo(title.empty() ? map : title, *vocabulary), options);
    const std::string undone = absl::StrCat("map \"", map, "\" is not made");
    if (!created.ok()) return ToldOfChange(created.status(), undone);
    if (const absl::Status closed = (*created)->Close(); !closed.ok()) {
      created->reset();
      for (const char* suffix : {"", "-wal", "-shm", "-lock"}) std::filesystem::remove(FileOf(map) + suffix, error);
      return ToldOfChange(closed, undone);
    }
    return Summarize(map);
  });
}

absl::StatusOr<api::MapSummary> MapHost::Snapshot(const std::string& map, const std::string& as) {
  return Guarded([&]() -> absl::StatusOr<api::MapSummary> {
    CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
    CAIRN_RETURN_IF_ERROR(api::CheckMapName(as));
    std::error_code error;
    if (std::filesystem::exists(std::filesystem::symlink_status(FileOf(as), error))) {
      return store::MakeFault(store::Fault::kExists, absl::StrCat("there is a map \"", as, "\" already"));
    }
    const absl::Status copied = [&]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(const auto store, store::OpenMapStore(path, store::OpenMode::kRead));
      return store->CopySound(FileOf(as));
    }();
    CAIRN_RETURN_IF_ERROR(ToldOfChange(copied, absl::StrCat("map \"", map, "\" is not copied to \"", as, "\"")));
    return Summarize(as);
  });
}

absl::StatusOr<std::string> MapHost::Delete(const std::string& map) {
  return Guarded([&]() -> absl::StatusOr<std::string> {
    if (Written(map) == nullptr) CAIRN_RETURN_IF_ERROR(PathOf(map).status());
    const std::shared_ptr<Slot> slot = SlotOf(map);
    const std::lock_guard lock(slot->mutex);
    if (slot->map != nullptr && slot->map->writing()) {
      const auto sessions = Sessions(map);
      if (!sessions.ok() || sessions->empty()) {
        return store::MakeFault(store::Fault::kBusy, absl::StrCat("map \"", map, "\" is being changed: try again"));
      }
      return absl::FailedPreconditionError(
          absl::StrCat("map \"", map, "\" is being extended by ", sessions->size(),
                       " session(s): let them end first, or wait until those whose clients are gone are finished"));
    }
    CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
    Close(slot.get());
    absl::StatusOr<std::string> deleted = trash_.Take(map, path);
    if (!deleted.ok()) return ToldOfChange(deleted.status(), absl::StrCat("map \"", map, "\" is not deleted"));
    return deleted;
  });
}

absl::StatusOr<std::vector<api::DeletedMap>> MapHost::ListDeleted() {
  return Guarded([&] { return trash_.List(); });
}

absl::StatusOr<std::string> MapHost::Restore(const std::string& deleted, const std::string& as) {
  return Guarded([&]() -> absl::StatusOr<std::string> {
    CAIRN_ASSIGN_OR_RETURN(const api::DeletedName had, api::ParseDeletedName(deleted));
    const std::string name = as.empty() ? had.map : as;
    CAIRN_RETURN_IF_ERROR(api::CheckMapName(name));
    const std::shared_ptr<Slot> slot = SlotOf(name);
    const std::lock_guard lock(slot->mutex);
    const absl::Status restored = trash_.GiveBack(deleted, FileOf(name));
    if (store::FaultOf(restored) == store::Fault::kExists) {
      return store::MakeFault(store::Fault::kExists,
                              absl::StrCat("there is a map \"", name, "\" already: restore it under another name"));
    }
    CAIRN_RETURN_IF_ERROR(ToldOfChange(restored, absl::StrCat("\"", deleted, "\" stays in the trash")));
    return name;
  });
}

absl::StatusOr<api::MapVerification> MapHost::Verify(const std::string& map, api::VerifyDepth depth) {
  return Guarded([&]() -> absl::StatusOr<api::MapVerification> {
    CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
    CAIRN_ASSIGN_OR_RETURN(const WorkGate::Pass pass, gate_.Enter());
    absl::StatusOr<api::MapVerification> verified = VerifyMap(map, path, depth);
    if (!verified.ok()) return Told(verified.status());
    for (map::Finding& finding : verified->findings) finding.message = Told(finding.message);
    for (std::string& note : verified->notes) note = Told(note);
    return verified;
  });
}

absl::StatusOr<api::AlignAnswer> MapHost::Align(const std::string& map, const api::AlignRequest& request) {
  return Guarded([&]() -> absl::StatusOr<api::AlignAnswer> {
    CAIRN_RETURN_IF_ERROR(request.Validate());
    const auto align = [&]() -> absl::StatusOr<api::AlignAnswer> {
      CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<HostedMap> hosted, Use(map));
      CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<engine::LiveMap> live, hosted->Write());
      return engine::AlignMap(absl::StrCat("map \"", map, "\""), request, *live);
    };
    absl::StatusOr<api::AlignAnswer> answer = align();
    if (!answer.ok()) return ToldOfChange(answer.status(), absl::StrCat("map \"", map, "\" is not aligned"));
    return answer;
  });
}

absl::StatusOr<api::SessionRemoval> MapHost::RemoveSession(const std::string& map, SessionId session) {
  return Guarded([&]() -> absl::StatusOr<api::SessionRemoval> {
    const auto remove = [&]() -> absl::StatusOr<api::SessionRemoval> {
      CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<HostedMap> hosted, Use(map));
      for (const api::ActiveSession& active : ActiveSessions()) {
        if (active.map != map || active.progress.session != session) continue;
        return absl::FailedPreconditionError(
            absl::StrCat("session ", session.value(), " of map \"", map, "\" is running: let it end first"));
      }
      CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<engine::LiveMap> live, hosted->Write());
      return care::RemoveSession(absl::StrCat("map \"", map, "\""), session, *live);
    };
    absl::StatusOr<api::SessionRemoval> removal = remove();
    if (!removal.ok()) {
      return ToldOfChange(removal.status(),
                          absl::StrCat("session ", session.value(), " of map \"", map, "\" is not removed"));
    }
    return removal;
  });
}

absl::StatusOr<map::MapOverview> MapHost::Overview(const std::string& map) {
  return Guarded([&]() -> absl::StatusOr<map::MapOverview> {
    CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
    absl::StatusOr<map::MapOverview> overview = ReadOverview(path);
    if (!overview.ok()) return Told(overview.status());
    overview->being_written |= Written(map) != nullptr;
    for (std::string& note : overview->notes) note = Told(note);
    return overview;
  });
}

absl::StatusOr<api::MapLog> MapHost::Log(const std::string& map, const map::ChangeQuery& query) {
  return Guarded([&]() -> absl::StatusOr<api::MapLog> {
    CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
    absl::StatusOr<api::MapLog> log = ReadMapLog(path, query);
    if (!log.ok()) return Told(log.status());
    return log;
  });
}

absl::Status MapHost::Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) {
  return Guarded([&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
    // No form takes more room than the map itself.
    const std::string folder = ScratchFolder(BytesOf(path));
    const std::string scratch = absl::StrCat(folder, "/.export-", getpid(), "-", ++scratch_files_);
    const absl::Status exported = ExportMapTo(path, content, scratch, sink);
    if (folder == options_.directory) return ToldOfChange(exported, absl::StrCat("map \"", map, "\" is not exported"));
    const absl::Status told = Told(WithoutDirectory(exported, folder));
    if (store::FaultOf(told) == store::Fault::kNone) return told;
    return Annotate(told, absl::StrCat("map \"", map,
                                       "\" is not exported by way of the server's folder for temporary "
                                       "files (TMPDIR), as that of the maps may not be written or has no room"));
  });
}

}  // namespace cairn::host
