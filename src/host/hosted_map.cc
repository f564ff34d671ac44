#include "host/hosted_map.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>
#include <utility>

#include "store/map_store.h"

namespace cairn::host {
namespace {

// Measured on maps of 200 to 1000 keyframes: what is in memory over what is in the store.
constexpr double kMemoryPerStoredByte = 2.0;

}  // namespace

std::shared_ptr<engine::LiveMap> ClosedAtTheEnd(std::unique_ptr<engine::LiveMap> live) {
  return {live.release(), [](engine::LiveMap* closing) {
            const std::unique_ptr<engine::LiveMap> owned(closing);
            const absl::Status closed = owned->Close();
            if (!closed.ok()) spdlog::error("closing a map: {}", std::string(closed.message()));
          }};
}

absl::StatusOr<std::shared_ptr<HostedMap>> HostedMap::Open(const std::string& uri,
                                                           std::chrono::milliseconds refresh_interval) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::MapReader> reader, client::MapReader::Open(uri));
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, reader->ReadSummary());
  auto map = std::shared_ptr<HostedMap>(new HostedMap(uri, summary.file_bytes, refresh_interval));
  map->view_ = reader->view();
  map->reader_ = std::move(reader);
  map->looked_ = std::chrono::steady_clock::now();
  return map;
}

std::shared_ptr<HostedMap> HostedMap::Over(const std::string& uri, std::shared_ptr<engine::LiveMap> live,
                                           std::chrono::milliseconds refresh_interval) {
  auto map = std::shared_ptr<HostedMap>(new HostedMap(uri, 0, refresh_interval));
  map->live_ = live;
  return map;
}

HostedMap::HostedMap(std::string uri, std::int64_t stored_bytes, std::chrono::milliseconds refresh_interval)
    : uri_(std::move(uri)),
      bytes_(static_cast<std::int64_t>(kMemoryPerStoredByte * static_cast<double>(stored_bytes))),
      refresh_interval_(refresh_interval) {}

std::shared_ptr<const tracking::MapView> HostedMap::Known() const {
  const std::lock_guard lock(mutex_);
  return view_;
}

std::shared_ptr<engine::LiveMap> HostedMap::Live() const {
  const std::lock_guard lock(mutex_);
  return live_.lock();
}

void HostedMap::WaitForChange(std::chrono::steady_clock::time_point until,
                              std::shared_ptr<engine::Subscription>* news) const {
  using std::chrono::milliseconds;
  const auto left = std::chrono::ceil<milliseconds>(until - std::chrono::steady_clock::now());
  if (left <= milliseconds(0)) return;
  if (*news != nullptr) {
    if (!(*news)->Next(left).ok()) news->reset();  // it is not written here any more
    return;
  }
  if (const std::shared_ptr<engine::LiveMap> live = Live()) {
    *news = live->Subscribe(engine::LiveMap::Backlog::kNewest);
    return;  // there may have been a change before
  }
  // Another process writes it, or nobody does.
  constexpr milliseconds kLeast(10);
  std::this_thread::sleep_for(std::min(left, std::max(refresh_interval_, kLeast)));
}

bool HostedMap::writing() const { return Live() != nullptr; }

absl::StatusOr<std::shared_ptr<const tracking::MapView>> HostedMap::Keep(
    std::shared_ptr<const tracking::MapView> view) {
  const std::lock_guard lock(mutex_);
  view_ = std::move(view);
  return view_;
}

absl::StatusOr<std::shared_ptr<const tracking::MapView>> HostedMap::View() {
  if (const std::shared_ptr<engine::LiveMap> live = Live()) {
    if (!live->exists()) {
      return store::MakeFault(store::Fault::kNotFound, absl::StrCat(uri_, ": it has no keyframe yet"));
    }
    return Keep(live->Published());
  }
  const std::unique_lock reading(reading_, std::try_to_lock);
  if (!reading) {
    if (auto known = Known()) return known;
    return absl::UnavailableError(absl::StrCat(uri_, ": it is being opened: ask again"));
  }
  if (reader_ == nullptr) {  // it was written here
    CAIRN_ASSIGN_OR_RETURN(reader_, client::MapReader::Open(uri_));
    looked_ = std::chrono::steady_clock::now();
    return Keep(reader_->view());
  }
  const auto now = std::chrono::steady_clock::now();
  if (now - looked_ < refresh_interval_) return Known();
  looked_ = now;
  const absl::StatusOr<bool> newer = reader_->Refresh();
  if (store::FaultOf(newer.status()) == store::Fault::kMoved) return newer.status();
  return Keep(reader_->view());
}

absl::StatusOr<std::unique_ptr<client::ViewSource>> HostedMap::NewReader() {
  const std::lock_guard reading(reading_);
  if (reader_ != nullptr) return reader_->Another();
  return client::MapReader::Open(uri_);
}

absl::StatusOr<std::shared_ptr<engine::LiveMap>> HostedMap::Write() {
  const std::lock_guard reading(reading_);
  if (std::shared_ptr<engine::LiveMap> live = Live()) return live;
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<engine::LiveMap> opened, engine::LiveMap::Open(uri_));
  std::shared_ptr<engine::LiveMap> live = ClosedAtTheEnd(std::move(opened));
  reader_.reset();
  const std::lock_guard lock(mutex_);
  live_ = live;
  return live;
}

}  // namespace cairn::host
