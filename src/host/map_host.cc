#include "host/map_host.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/strip.h"
#include "base/guarded.h"
#include "base/told.h"
#include "base/version.h"
#include "client/local_tracker.h"
#include "client/view_feed.h"
#include "host/describe.h"
#include "place/default_vocabulary.h"
#include "store/map_store.h"
#include "store/writer_lock.h"

namespace cairn::host {
namespace {

constexpr absl::string_view kSuffix = ".cairn";
// What is in memory of a map, roughly. Measured on maps of 200 to 10000 keyframes over what is in the store: all of one
// that is written here, or was, and of another but for features, of which some are kept.
std::int64_t BytesInMemory(std::int64_t stored_bytes, bool with_features) {
  constexpr double kPerStoredByte = 2.0, kWithoutFeatures = 0.6;
  const auto stored = static_cast<double>(stored_bytes);
  if (with_features) return std::llround(kPerStoredByte * stored);
  const auto features = static_cast<std::int64_t>(client::MapReaderOptions().feature_budget_bytes);
  return std::llround(kWithoutFeatures * stored) + std::min(stored_bytes, features);
}

// The same of one that need not be loaded (docs/map-format.md, "Ready pages"): its place index, and what was looked at.
std::int64_t BytesInMemory(const map::Snapshot& ready) {
  constexpr std::int64_t kPerKeyframe = 8'000;
  return kPerKeyframe * static_cast<std::int64_t>(ready.keyframes().size()) +
         static_cast<std::int64_t>(ready.entities()->bytes() + ready.feature_cache()->bytes());
}

int WorkersOf(const MapHostOptions& options) {
  if (options.workers > 0) return options.workers;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

std::chrono::milliseconds RefreshInterval(const MapHostOptions& options) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * options.refresh_interval_s));
}

MapHost::Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<MapHost::Clock::duration>(std::chrono::duration<double>(seconds));
}

// Tells without the name of the directory.
class ToldTracker final : public api::Tracker {
 public:
  ToldTracker(std::unique_ptr<api::Tracker> tracker, std::string directory)
      : tracker_(std::move(tracker)), directory_(std::move(directory)) {}

  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override {
    absl::StatusOr<api::TrackAnswer> answer = tracker_->Track(frame);
    if (!answer.ok()) return WithoutDirectory(answer.status(), directory_);
    for (std::string* text : {&answer->reason, &answer->note}) {
      if (!text->empty()) *text = WithoutDirectory(*text, directory_);
    }
    return answer;
  }

 private:
  const std::unique_ptr<api::Tracker> tracker_;
  const std::string directory_;
};

absl::Status NoMap(const std::string& map) {
  return store::MakeFault(store::Fault::kNotFound, absl::StrCat("there is no map \"", map, "\" here"));
}

}  // namespace

absl::Status MapHostOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("maps: ", what)); };
  if (directory.empty()) return bad("name their directory");
  if (memory_budget_bytes < 0) return bad("memory_budget_bytes must not be negative");
  if (!(idle_close_s > 0.0)) return bad("idle_close_s must be positive");
  if (!(refresh_interval_s >= 0.0)) return bad("refresh_interval_s must not be negative");
  if (workers < 0) return bad("workers must not be negative");
  if (max_waiting < 0) return bad("max_waiting must not be negative");
  if (max_sessions < 1) return bad("max_sessions must be at least 1");
  if (max_client_sessions < 1) return bad("max_client_sessions must be at least 1");
  if (!(session_wait_s >= 0.0)) return bad("session_wait_s must not be negative");
  CAIRN_RETURN_IF_ERROR(tracker.Validate());
  return localizer.Validate();
}

absl::StatusOr<std::unique_ptr<MapHost>> MapHost::Open(const MapHostOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  std::error_code error;
  const std::filesystem::path directory = std::filesystem::canonical(options.directory, error);
  if (error || !std::filesystem::is_directory(directory, error)) {
    return absl::NotFoundError(absl::StrCat(options.directory, " is no directory: name the one that holds the maps"));
  }
  MapHostOptions resolved = options;
  resolved.directory = directory.string();
  return std::unique_ptr<MapHost>(new MapHost(resolved));
}

MapHost::MapHost(const MapHostOptions& options)
    : options_(options),
      gate_(WorkersOf(options), options.max_waiting),
      localizer_(options.localizer),
      trash_(options.directory),
      sessions_(options.max_sessions, options.max_client_sessions, Seconds(options.session_wait_s)) {}

std::string MapHost::FileOf(const std::string& map) const {
  return absl::StrCat(options_.directory, "/", map, kSuffix);
}

absl::StatusOr<std::string> MapHost::PathOf(const std::string& map) const {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  const std::filesystem::path path = FileOf(map);
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(path, error);
  // A link may lead elsewhere in the directory, not out of it.
  if (error || real.parent_path() != options_.directory || !std::filesystem::is_regular_file(real, error)) {
    return NoMap(map);
  }
  return path.string();
}

std::shared_ptr<MapHost::Slot> MapHost::SlotOf(const std::string& map) {
  const std::lock_guard lock(mutex_);
  std::shared_ptr<Slot>& slot = slots_[map];
  if (slot == nullptr) slot = std::make_shared<Slot>();
  slot->used = Clock::now().time_since_epoch();
  return slot;
}

std::shared_ptr<HostedMap> MapHost::Written(const std::string& map) {
  std::shared_ptr<Slot> slot;
  {
    const std::lock_guard lock(mutex_);
    const auto found = slots_.find(map);
    if (found == slots_.end()) return nullptr;
    slot = found->second;
  }
  const std::lock_guard lock(slot->mutex);
  return slot->map != nullptr && slot->map->writing() ? slot->map : nullptr;
}

absl::StatusOr<std::shared_ptr<HostedMap>> MapHost::Use(const std::string& map) {
  if (std::shared_ptr<HostedMap> written = Written(map)) return written;
  const absl::StatusOr<std::string> path = PathOf(map);
  if (!path.ok()) {
    const std::lock_guard lock(mutex_);
    slots_.erase(map);
    return path.status();
  }
  const std::shared_ptr<Slot> slot = SlotOf(map);
  const std::lock_guard lock(slot->mutex);
  if (slot->map == nullptr) {
    CAIRN_ASSIGN_OR_RETURN(slot->map, HostedMap::Open(*path, RefreshInterval(options_), hurry_));
    slot->bytes = 1;
    Measure(map, slot.get());
    MakeRoom(slot.get());
  }
  return slot->map;
}

absl::StatusOr<std::shared_ptr<const tracking::MapView>> MapHost::ViewOf(const std::string& map) {
  for (bool again = false;; again = true) {
    CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<HostedMap> open, Use(map));
    absl::StatusOr<std::shared_ptr<const tracking::MapView>> view = open->View();
    if (view.ok() || again) return view;
    // Another file lies there now.
    const std::shared_ptr<Slot> slot = SlotOf(map);
    const std::lock_guard lock(slot->mutex);
    if (slot->map == open) Close(slot.get());
  }
}

void MapHost::Close(Slot* slot) {
  if (slot->map != nullptr && slot->map->writing()) return;
  slot->map.reset();
  slot->bytes = 0;
}

void MapHost::Measure(const std::string& map, Slot* slot) {
  if (slot->map == nullptr) return;
  const std::shared_ptr<const tracking::MapView> known = slot->map->Known();
  if (known == nullptr) return;
  std::error_code error;
  const auto stored = std::filesystem::file_size(FileOf(map), error);  // opening it would take much longer
  if (error) return;  // it is not there yet, or not any more: whoever asks for the map is told
  if (known->map().entities() != nullptr) {
    slot->bytes = std::max<std::int64_t>(1, BytesInMemory(known->map()));
    return;
  }
  const bool with_features = known->map().feature_cache() == nullptr;
  slot->bytes = std::max<std::int64_t>(1, BytesInMemory(static_cast<std::int64_t>(stored), with_features));
}

// With the lock of `keep`, which stays; slots that somebody else is using are left alone.
void MapHost::MakeRoom(const Slot* keep) {
  std::vector<std::shared_ptr<Slot>> open;
  for (const auto& [name, slot] : Slots()) {
    if (slot->bytes > 0) open.push_back(slot);
  }
  std::int64_t bytes = 0;
  for (const auto& slot : open) bytes += slot->bytes;
  std::ranges::sort(open, {}, [](const auto& slot) { return slot->used.load(); });
  for (const auto& slot : open) {
    if (bytes <= options_.memory_budget_bytes) return;
    const std::unique_lock lock =
        slot.get() == keep ? std::unique_lock<std::mutex>() : std::unique_lock(slot->mutex, std::try_to_lock);
    if (!lock) continue;
    bytes -= slot->bytes;
    Close(slot.get());
    bytes += slot->bytes;  // it stays while it is being written
  }
}

void MapHost::CloseIdle(Clock::time_point now) {
  for (const SessionTable::Abandoned& session : sessions_.FinishAbandoned(now)) {
    if (options_.on_abandoned) options_.on_abandoned(session);
  }
  const Clock::duration idle = Seconds(options_.idle_close_s);
  for (const auto& [name, slot] : Slots()) {
    const std::unique_lock lock(slot->mutex, std::try_to_lock);
    if (!lock) continue;
    if (now.time_since_epoch() - slot->used.load() >= idle) Close(slot.get());
    Measure(name, slot.get());  // sessions make it grow
  }
  MakeRoom(nullptr);
}

std::vector<std::pair<std::string, std::shared_ptr<MapHost::Slot>>> MapHost::Slots() {
  const std::lock_guard lock(mutex_);
  return {slots_.begin(), slots_.end()};
}

std::vector<MapHost::OpenMap> MapHost::OpenMaps() {
  std::vector<OpenMap> open;
  for (const auto& [name, slot] : Slots()) {
    const std::unique_lock lock(slot->mutex, std::try_to_lock);  // one that is being opened is not open
    if (!lock || slot->map == nullptr) continue;
    Measure(name, slot.get());
    const std::shared_ptr<const tracking::MapView> known = slot->map->Known();
    std::error_code error;
    // A new map of a session that could store nothing never was one.
    if (!slot->map->writing() && !std::filesystem::exists(FileOf(name), error)) continue;
    const std::uintmax_t log_bytes = std::filesystem::file_size(FileOf(name) + "-wal", error);
    open.push_back({name, known != nullptr ? known->revision() : 0, slot->bytes, slot->map->writing(),
                    error ? 0 : static_cast<std::int64_t>(log_bytes)});
  }
  return open;
}

std::int64_t MapHost::FreeBytes() const {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(options_.directory, error);
  return error ? 0 : static_cast<std::int64_t>(space.available);
}

absl::Status MapHost::Ready() const {
  std::error_code error;
  const std::filesystem::directory_iterator entries(options_.directory, error);
  return error ? absl::NotFoundError(absl::StrCat("the directory of the maps cannot be read: ", error.message()))
               : absl::OkStatus();
}

std::string MapHost::Told(absl::string_view message) const { return WithoutDirectory(message, options_.directory); }

absl::Status MapHost::Told(const absl::Status& status) const { return WithoutDirectory(status, options_.directory); }

absl::StatusOr<api::MapSummary> MapHost::Summarize(const std::string& map) {
  CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, summaries_.Read(path));
  return SummaryOf(map, summary);
}

std::vector<std::string> MapHost::Names() const {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(options_.directory)) {
    const std::string file = entry.path().filename().string();
    const std::string name(absl::StripSuffix(file, kSuffix));
    if (name != file && PathOf(name).ok()) names.push_back(name);
  }
  std::ranges::sort(names);
  return names;
}

absl::StatusOr<std::vector<api::MapSummary>> MapHost::List() {
  return Guarded([&]() -> absl::StatusOr<std::vector<api::MapSummary>> {
    const std::vector<std::string> names = Names();
    const std::vector<OpenMap> open = OpenMaps();
    std::vector<api::MapSummary> summaries;
    for (const std::string& name : names) {
      absl::StatusOr<api::MapSummary> summary = Summarize(name);
      if (absl::IsNotFound(summary.status())) continue;  // removed meanwhile
      const absl::Status told = Told(summary.status());
      summaries.push_back(summary.ok() ? *std::move(summary) : api::MapSummary());
      summaries.back().name = name;
      summaries.back().status = told;
      const auto held = std::ranges::find(open, name, &OpenMap::name);
      summaries.back().open = held != open.end();
      summaries.back().writing = held != open.end() ? held->writing : store::WriterLock::IsHeld(FileOf(name));
    }
    return summaries;
  });
}

absl::StatusOr<api::MapDescription> MapHost::Describe(const std::string& map) {
  return Guarded([&]() -> absl::StatusOr<api::MapDescription> {
    const absl::StatusOr<std::shared_ptr<const tracking::MapView>> view = ViewOf(map);
    if (!view.ok()) return Told(view.status());
    absl::StatusOr<api::MapSummary> stored = Summarize(map);
    if (!stored.ok()) return Told(stored.status());
    api::MapDescription description = DescriptionOf((*view)->map());
    description.summary.name = map;
    description.summary.format_version = stored->format_version;
    description.summary.file_bytes = stored->file_bytes;
    description.summary.open = true;
    description.summary.writing = Written(map) != nullptr;
    return description;
  });
}

absl::StatusOr<api::LocalizeAnswer> MapHost::Localize(const std::string& map, const api::LocalizeQuery& query) {
  return Guarded([&]() -> absl::StatusOr<api::LocalizeAnswer> {
    const absl::StatusOr<std::shared_ptr<const tracking::MapView>> view = ViewOf(map);
    if (!view.ok()) return Told(view.status());
    CAIRN_ASSIGN_OR_RETURN(const WorkGate::Pass pass, gate_.Enter());
    absl::StatusOr<api::LocalizeAnswer> answer = localizer_.Localize(**view, query);
    if (!answer.ok()) return Told(answer.status());
    return answer;
  });
}

absl::StatusOr<api::AcrossAnswer> MapHost::LocalizeAcross(const std::vector<std::string>& maps,
                                                          const api::LocalizeQuery& query) {
  return Guarded([&]() -> absl::StatusOr<api::AcrossAnswer> {
    if (query.prior) return absl::InvalidArgumentError("localize: a prior is of one map, not of several");
    std::vector<std::string> names = maps.empty() ? Names() : maps;
    std::ranges::sort(names);
    names.erase(std::unique(names.begin(), names.end()), names.end());
    if (names.size() > api::kMaxMapsAcross) {
      return absl::InvalidArgumentError(absl::StrCat("localize: ", names.size(), " maps are too many at once, at most ",
                                                     api::kMaxMapsAcross, ": name those that it may be"));
    }
    std::vector<api::AnswerOfMap> answers;
    absl::Status missing;
    bool all_missing = true;
    for (const std::string& name : names) {
      absl::StatusOr<api::LocalizeAnswer> answer = Localize(name, query);
      const store::Fault fault = store::FaultOf(answer.status());
      const bool removed = fault == store::Fault::kNotFound;
      if (removed && maps.empty()) continue;
      // What is wrong with the question is wrong with it everywhere.
      const bool of_question = fault == store::Fault::kNone &&
                               (absl::IsInvalidArgument(answer.status()) || absl::IsResourceExhausted(answer.status()));
      if (of_question) return answer.status();
      if (removed) missing = answer.status();
      all_missing = all_missing && removed;
      answers.push_back({name, answer.status(), answer.ok() ? *std::move(answer) : api::LocalizeAnswer()});
    }
    if (!answers.empty() && all_missing) return missing;
    return api::JudgeAcross(std::move(answers), options_.localizer.relocalizer.max_rival_share);
  });
}

absl::StatusOr<std::unique_ptr<api::Tracker>> MapHost::NewTracker(const std::string& map, const Camera& camera) {
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<api::Tracker>> {
    const auto open = [&]() -> absl::StatusOr<std::unique_ptr<api::Tracker>> {
      CAIRN_RETURN_IF_ERROR(ViewOf(map).status());  // the file that lies there now
      CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<HostedMap> hosted, Use(map));
      CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::ViewSource> reader, hosted->NewReader());
      return client::LocalTracker::Open(std::move(reader), camera, options_.tracker);
    };
    absl::StatusOr<std::unique_ptr<api::Tracker>> tracker = open();
    if (!tracker.ok()) return Told(tracker.status());
    return std::make_unique<ToldTracker>(*std::move(tracker), options_.directory);
  });
}

absl::StatusOr<std::unique_ptr<api::MapFeed>> MapHost::Follow(const std::string& map,
                                                              const api::FollowRequest& request) {
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<api::MapFeed>> {
    client::FeedSource source;
    source.newest = [this, map]() -> absl::StatusOr<std::shared_ptr<const tracking::MapView>> {
      absl::StatusOr<std::shared_ptr<const tracking::MapView>> view = ViewOf(map);
      if (!view.ok()) return Told(view.status());
      if ((*view)->revision() == 0) {
        return absl::UnavailableError(absl::StrCat("there is nothing in map \"", map, "\" yet to be followed"));
      }
      return view;
    };
    source.wait = [this, map, news = std::shared_ptr<engine::Subscription>()](Revision /*seen*/,
                                                                              Clock::time_point until) mutable {
      const absl::StatusOr<std::shared_ptr<HostedMap>> hosted = Use(map);
      if (hosted.ok()) (*hosted)->WaitForChange(until, &news);
    };
    source.changed_since = [this, map](Revision since) -> absl::StatusOr<std::optional<map::ChangedRows>> {
      CAIRN_ASSIGN_OR_RETURN(const std::string path, PathOf(map));
      CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                             store::OpenMapStore(path, store::OpenMode::kRead));
      auto rows = store->ReadChangedRows(since);
      if (!rows.ok()) return Told(rows.status());
      return rows;
    };
    CAIRN_RETURN_IF_ERROR(source.newest().status());
    // Counted for as long as the feed holds its source.
    ++followers_;
    const std::shared_ptr<void> counted(nullptr, [this](void*) { --followers_; });
    source.newest = [counted, newest = std::move(source.newest)] { return newest(); };
    return std::make_unique<client::ViewFeed>(std::move(source), request);
  });
}

absl::StatusOr<std::shared_ptr<const place::Vocabulary>> MapHost::DefaultVocabulary() {
  const std::lock_guard lock(vocabulary_mutex_);
  if (vocabulary_ == nullptr) {
    absl::StatusOr<place::Vocabulary> loaded = place::LoadDefaultVocabulary();
    if (!loaded.ok()) {  // it names files of this machine
      spdlog::error("no map can be made: {}", std::string(loaded.status().message()));
      return absl::Status(loaded.status().code(),
                          "the vocabulary of new maps cannot be read: whoever runs this finds more in its log");
    }
    vocabulary_ = std::make_shared<const place::Vocabulary>(*std::move(loaded));
  }
  return vocabulary_;
}

map::MapInfo MapHost::NewInfo(const std::string& title, const place::Vocabulary& vocabulary) const {
  map::MapInfo info;
  info.id = engine::NewMapId(std::nullopt);
  info.name = title;
  info.software_version = kVersion;
  info.created_unix_ns = engine::UnixNowNs();
  info.vocabulary_hash = vocabulary.hash();
  return info;
}

absl::StatusOr<std::shared_ptr<engine::LiveMap>> MapHost::CreateMap(const api::SessionRequest& request) {
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const place::Vocabulary> vocabulary, DefaultVocabulary());
  const std::string path = FileOf(request.map);
  const map::MapInfo info = NewInfo(request.title.empty() ? request.source : request.title, *vocabulary);
  const std::shared_ptr<Slot> slot = SlotOf(request.map);
  const std::lock_guard lock(slot->mutex);
  // Files that are no map, links that lead elsewhere: the name is taken.
  std::error_code error;
  if ((slot->map != nullptr && slot->map->writing()) ||
      std::filesystem::exists(std::filesystem::symlink_status(path, error))) {
    return store::MakeFault(store::Fault::kExists, absl::StrCat("there is a map \"", request.map, "\" already"));
  }
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<engine::LiveMap> created, engine::LiveMap::Create(path, info, vocabulary));
  std::shared_ptr<engine::LiveMap> live;
  slot->map = HostedMap::Over(path, std::move(created), RefreshInterval(options_), &live, hurry_);
  slot->bytes = 1;
  return live;
}

absl::StatusOr<std::unique_ptr<api::MapSession>> MapHost::StartSession(const api::SessionRequest& request) {
  return Guarded([&]() -> absl::StatusOr<std::unique_ptr<api::MapSession>> {
    CAIRN_RETURN_IF_ERROR(api::CheckMapName(request.map));
    CAIRN_RETURN_IF_ERROR(Annotate(request.camera.Validate(), "session"));
    const auto start = [&]() -> absl::StatusOr<std::unique_ptr<HostedSession>> {
      std::shared_ptr<engine::LiveMap> live;
      if (request.policy == map::SessionPolicy::kCreate) {
        CAIRN_ASSIGN_OR_RETURN(live, CreateMap(request));
      } else {
        CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<HostedMap> map, Use(request.map));
        CAIRN_ASSIGN_OR_RETURN(live, map->Write());
      }
      const auto tell = [this, map = request.map](const absl::Status& error, Revision revision) {
        if (revision == 0) return ToldOfChange(error, absl::StrCat("map \"", map, "\" is not made"));
        return ToldOfChange(error, absl::StrCat("map \"", map, "\" is at revision ", revision,
                                                ", and what this session has mapped since then is not kept"));
      };
      return HostedSession::Start(request, std::move(live), tell);
    };
    absl::StatusOr<std::unique_ptr<api::MapSession>> session = sessions_.Start(request, start);
    if (!session.ok()) {
      const bool makes = request.policy == map::SessionPolicy::kCreate;
      return ToldOfChange(session.status(),
                          absl::StrCat("map \"", request.map, makes ? "\" is not made" : "\" is not extended"));
    }
    return session;
  });
}

}  // namespace cairn::host
