// The maps of one directory, served to many at once. A map is opened when it is first asked for, once, whoever asks
// meanwhile; it leaves memory when nobody has used it for a while, or when others need the room (the one that was used
// longest ago first). Each is what its file `NAME.cairn` holds, also while another process writes it. Sessions make
// maps and extend them, several at once in one.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "api/map_service.h"
#include "base/status.h"
#include "client/local_tracker_options.h"
#include "client/view_localizer.h"
#include "host/hosted_map.h"
#include "host/session_table.h"
#include "host/trash.h"
#include "host/work_gate.h"
#include "place/vocabulary.h"
#include "store/summary_cache.h"

namespace cairn::host {

struct MapHostOptions {
  std::string directory;
  // Of all open maps together, roughly. The map that is asked for is opened in any case.
  std::int64_t memory_budget_bytes = 4'000'000'000;
  double idle_close_s = 600.0;      // a map that nobody has asked for so long is closed
  double refresh_interval_s = 0.1;  // between looks for what another process has changed
  int workers = 0;                  // images that are located at the same time; 0: as many as there are processors
  int max_waiting = 64;             // ... and that wait for their turn; more are refused
  int max_sessions = 16;            // at the same time
  int max_client_sessions = 8;      // ... of one client (api::SessionRequest::client)
  double session_wait_s = 60.0;  // a session that its client has let go of waits so long for it, and is then finished
  client::LocalLocalizerOptions localizer;
  client::LocalTrackerOptions tracker;
  // Told of every session that is ended because its client did not come back; by who calls CloseIdle().
  std::function<void(const SessionTable::Abandoned&)> on_abandoned;

  absl::Status Validate() const;
};

class MapHost : public api::MapService {
 public:
  using Clock = std::chrono::steady_clock;

  // NotFound if the directory does not exist. Reads no map.
  static absl::StatusOr<std::unique_ptr<MapHost>> Open(const MapHostOptions& options);

  absl::StatusOr<std::vector<api::MapSummary>> List() override;
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) override;
  // ResourceExhausted if too many images wait already.
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& query) override;

  absl::StatusOr<api::AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                   const api::LocalizeQuery& query) override;

  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTracker(const std::string& map, const Camera& camera) override;
  absl::StatusOr<std::unique_ptr<api::MapSession>> StartSession(const api::SessionRequest& request) override;
  absl::StatusOr<std::unique_ptr<api::MapSession>> ResumeSession(const std::string& token) override {
    return sessions_.Resume(token);
  }
  absl::StatusOr<std::vector<api::ActiveSession>> Sessions(const std::string& map) override;

  absl::StatusOr<api::MapSummary> Create(const std::string& map, const std::string& title) override;
  absl::StatusOr<api::MapSummary> Snapshot(const std::string& map, const std::string& as) override;
  absl::StatusOr<std::string> Delete(const std::string& map) override;
  absl::StatusOr<std::vector<api::DeletedMap>> ListDeleted() override;
  absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) override;
  // Waits for its turn among the images that are located.
  absl::StatusOr<api::MapVerification> Verify(const std::string& map, api::VerifyDepth depth) override;
  absl::StatusOr<api::AlignAnswer> Align(const std::string& map, const api::AlignRequest& request) override;
  absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session) override;
  absl::StatusOr<map::MapOverview> Overview(const std::string& map) override;
  absl::StatusOr<api::MapLog> Log(const std::string& map, const map::ChangeQuery& query) override;
  absl::Status Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) override;

  absl::StatusOr<std::unique_ptr<api::MapFeed>> Follow(const std::string& map,
                                                       const api::FollowRequest& request) override;

  // Finishes the sessions that nobody came back to and closes the maps that have been idle at `now`, for as long as the
  // options say. For who owns the host to call now and then.
  void CloseIdle(Clock::time_point now);

  // The process is to end soon: from now on maps are closed without what only makes them open faster.
  void Hurry() { *hurry_ = true; }

  // Of the maps in memory, for those who watch.
  struct OpenMap {
    std::string name;
    Revision revision = 0;
    std::int64_t bytes = 0;
    bool writing = false;
    std::int64_t log_bytes = 0;  // its write-ahead log on the disk
  };
  std::vector<OpenMap> OpenMaps();
  std::int64_t FreeBytes() const;  // on the disk of the maps; 0 if it does not say
  SessionTable::Counts sessions() const { return sessions_.counts(); }
  std::vector<api::ActiveSession> ActiveSessions() const { return sessions_.Active(Clock::now()); }
  std::int64_t waiting() const { return gate_.waiting(); }  // images that wait for their turn
  int followers() const { return followers_; }              // feeds that have been given out by Follow()
  // As the file system knows it, without links.
  const std::string& directory() const { return options_.directory; }
  // Whether the directory can be read; NotFound if it is gone.
  absl::Status Ready() const;

 private:
  // Kept while there is such a map. Whoever opens it holds its own lock, not the host's.
  struct Slot {
    std::mutex mutex;
    std::shared_ptr<HostedMap> map;       // null: not open
    std::atomic<Clock::duration> used{};  // since the clock's epoch
    std::atomic<std::int64_t> bytes{0};   // of the map in memory, roughly; 0: not open
  };

  explicit MapHost(const MapHostOptions& options);
  // Where a map of this name would be.
  std::string FileOf(const std::string& map) const;
  // Where files are made and removed again: beside the maps, or where the system has such files if that is not allowed.
  std::string ScratchFolder(std::int64_t bytes) const;
  // The names of what look like maps, ascending.
  std::vector<std::string> Names() const;
  map::MapInfo NewInfo(const std::string& title, const place::Vocabulary& vocabulary) const;
  // Where the map is. InvalidArgument for what is no name, NotFound if there is no such file in this directory.
  absl::StatusOr<std::string> PathOf(const std::string& map) const;
  std::shared_ptr<Slot> SlotOf(const std::string& map);
  std::vector<std::pair<std::string, std::shared_ptr<Slot>>> Slots();
  // The slot of a map that is being written here, whether its file exists yet or not; null: it is not.
  std::shared_ptr<HostedMap> Written(const std::string& map);
  absl::StatusOr<std::shared_ptr<engine::LiveMap>> CreateMap(const api::SessionRequest& request);
  absl::StatusOr<std::shared_ptr<const place::Vocabulary>> DefaultVocabulary();
  absl::StatusOr<std::shared_ptr<HostedMap>> Use(const std::string& map);
  absl::StatusOr<std::shared_ptr<const tracking::MapView>> ViewOf(const std::string& map);
  absl::StatusOr<api::MapSummary> Summarize(const std::string& map);
  void MakeRoom(const Slot* keep);
  // What it takes in memory now, by the size of what is in the store. With the slot's lock.
  void Measure(const std::string& map, Slot* slot);
  // Unless it is being written.
  static void Close(Slot* slot);
  // Without the directory's name, which is nobody's business.
  absl::Status Told(const absl::Status& status) const;
  // The same of a change: of a full disk also which one that is, and what to do. `undone`: what there is not now, as
  // "map \"hall\" is not made".
  absl::Status ToldOfChange(const absl::Status& status, absl::string_view undone) const;
  std::string Told(absl::string_view message) const;

  const MapHostOptions options_;
  const std::shared_ptr<std::atomic<bool>> hurry_ = std::make_shared<std::atomic<bool>>(false);
  WorkGate gate_;
  client::ViewLocalizer localizer_;
  const Trash trash_;
  store::SummaryCache summaries_;
  std::atomic<int> scratch_files_ = 0;  // made so far
  std::atomic<int> followers_ = 0;

  std::mutex vocabulary_mutex_;
  std::shared_ptr<const place::Vocabulary> vocabulary_;  // of new maps; null: not needed yet

  std::mutex mutex_;  // guards what follows; never held while a map is read
  std::map<std::string, std::shared_ptr<Slot>> slots_;

  SessionTable sessions_;  // last: it ends first
};

}  // namespace cairn::host
