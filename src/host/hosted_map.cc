#include "host/hosted_map.h"

#include <utility>

#include "store/map_store.h"

namespace cairn::host {
namespace {

// Measured on maps of 200 to 1000 keyframes: what is in memory over what is in the store.
constexpr double kMemoryPerStoredByte = 2.0;

}  // namespace

absl::StatusOr<std::shared_ptr<HostedMap>> HostedMap::Open(const std::string& uri,
                                                           std::chrono::milliseconds refresh_interval) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::MapReader> reader, client::MapReader::Open(uri));
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, reader->ReadSummary());
  return std::shared_ptr<HostedMap>(new HostedMap(std::move(reader), summary.file_bytes, refresh_interval));
}

HostedMap::HostedMap(std::unique_ptr<client::MapReader> reader, std::int64_t stored_bytes,
                     std::chrono::milliseconds refresh_interval)
    : bytes_(static_cast<std::int64_t>(kMemoryPerStoredByte * static_cast<double>(stored_bytes))),
      refresh_interval_(refresh_interval),
      reader_(std::move(reader)),
      looked_(std::chrono::steady_clock::now()),
      view_(reader_->view()) {}

std::shared_ptr<const tracking::MapView> HostedMap::Known() const {
  const std::lock_guard lock(mutex_);
  return view_;
}

absl::StatusOr<std::shared_ptr<const tracking::MapView>> HostedMap::View() {
  const std::unique_lock reading(reading_, std::try_to_lock);
  if (!reading) return Known();
  const auto now = std::chrono::steady_clock::now();
  if (now - looked_ < refresh_interval_) return Known();
  looked_ = now;
  const absl::StatusOr<bool> newer = reader_->Refresh();
  if (store::FaultOf(newer.status()) == store::Fault::kMoved) return newer.status();
  const std::lock_guard lock(mutex_);
  view_ = reader_->view();
  return view_;
}

}  // namespace cairn::host
