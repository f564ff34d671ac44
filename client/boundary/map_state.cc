#include "client/boundary/map_state.h"

#include <utility>

namespace cairn::client {

absl::StatusOr<std::shared_ptr<MapState>> MapState::Open(const std::string& path,
                                                         const LocalLocalizerOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<LocalLocalizer> localizer, LocalLocalizer::Open(path, options));
  return std::shared_ptr<MapState>(new MapState(std::move(localizer)));
}

std::shared_lock<std::shared_mutex> MapState::LockToRead() {
  const std::lock_guard gate(gate_);
  return std::shared_lock(mutex_);
}

absl::StatusOr<bool> MapState::Refresh() {
  const std::lock_guard gate(gate_);
  const std::lock_guard lock(mutex_);
  return localizer_->Refresh();
}

absl::StatusOr<api::LocalizeAnswer> MapState::Localize(const api::LocalizeQuery& query) {
  const auto lock = LockToRead();
  return localizer_->Localize(query);
}

std::unique_ptr<MapReader> MapState::NewReader() {
  const auto lock = LockToRead();
  return localizer_->NewReader();
}

void MapState::Read(const std::function<void(const map::Snapshot&)>& read) {
  const auto lock = LockToRead();
  read(localizer_->snapshot());
}

}  // namespace cairn::client
