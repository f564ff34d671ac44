#include "host/hosted_map.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>
#include <utility>

#include "store/map_store.h"

namespace cairn::host {
namespace {

// What a tracker holds of a map that is served here.
class HostedReader final : public client::ViewSource {
 public:
  HostedReader(std::shared_ptr<HostedMap> map, std::shared_ptr<const tracking::MapView> view)
      : map_(std::move(map)), view_(std::move(view)) {}

  const std::shared_ptr<const tracking::MapView>& view() const override { return view_; }
  absl::StatusOr<bool> Refresh() override {
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const tracking::MapView> newest, map_->View());
    if (newest == view_) return false;
    view_ = std::move(newest);
    return true;
  }
  std::unique_ptr<client::ViewSource> Another() const override { return std::make_unique<HostedReader>(map_, view_); }

 private:
  const std::shared_ptr<HostedMap> map_;
  std::shared_ptr<const tracking::MapView> view_;
};

}  // namespace

absl::StatusOr<std::shared_ptr<HostedMap>> HostedMap::Open(const std::string& uri,
                                                           std::chrono::milliseconds refresh_interval, Hurry hurry) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::MapReader> reader, client::MapReader::Open(uri));
  auto map = std::shared_ptr<HostedMap>(new HostedMap(uri, refresh_interval, std::move(hurry)));
  map->view_ = reader->view();
  map->reader_ = std::move(reader);
  map->looked_ = std::chrono::steady_clock::now();
  return map;
}

std::shared_ptr<HostedMap> HostedMap::Over(const std::string& uri, std::unique_ptr<engine::LiveMap> live,
                                           std::chrono::milliseconds refresh_interval,
                                           std::shared_ptr<engine::LiveMap>* shared, Hurry hurry) {
  auto map = std::shared_ptr<HostedMap>(new HostedMap(uri, refresh_interval, std::move(hurry)));
  *shared = map->Adopt(std::move(live));
  return map;
}

std::shared_ptr<engine::LiveMap> HostedMap::Adopt(std::unique_ptr<engine::LiveMap> live) {
  const auto close = [map = weak_from_this(), hurry = hurry_](engine::LiveMap* closing) {
    const std::unique_ptr<engine::LiveMap> owned(closing);
    const absl::Status closed = hurry != nullptr && *hurry ? owned->Flush() : owned->Close();
    if (!closed.ok()) spdlog::error("closing a map: {}", std::string(closed.message()));
    const std::shared_ptr<HostedMap> hosted = map.lock();
    if (hosted != nullptr && owned->exists()) hosted->Keep(owned->Published()).IgnoreError();
  };
  std::shared_ptr<engine::LiveMap> shared(live.release(), close);
  const std::lock_guard lock(mutex_);
  live_ = shared;
  return shared;
}

std::shared_ptr<const tracking::MapView> HostedMap::Known() const {
  const std::shared_ptr<engine::LiveMap> live = Live();
  if (live != nullptr && live->exists()) return live->Published();
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
  // Who was slower does not set it back.
  if (view_ == nullptr || view->map().info().id != view_->map().info().id || view->revision() >= view_->revision()) {
    view_ = std::move(view);
  }
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
    CAIRN_ASSIGN_OR_RETURN(reader_, OpenReader());
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

// From what is known of it on, if it is known.
absl::StatusOr<std::unique_ptr<client::MapReader>> HostedMap::OpenReader() const {
  const std::shared_ptr<const tracking::MapView> known = Known();
  return known != nullptr ? client::MapReader::OpenFrom(uri_, known) : client::MapReader::Open(uri_);
}

absl::StatusOr<std::unique_ptr<client::ViewSource>> HostedMap::NewReader() {
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const tracking::MapView> view, View());
  return std::make_unique<HostedReader>(shared_from_this(), std::move(view));
}

absl::StatusOr<std::shared_ptr<engine::LiveMap>> HostedMap::Write() {
  const std::lock_guard reading(reading_);
  if (std::shared_ptr<engine::LiveMap> live = Live()) return live;
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<engine::LiveMap> opened, engine::LiveMap::Open(uri_));
  reader_.reset();
  return Adopt(std::move(opened));
}

}  // namespace cairn::host
