#include "client/boundary/map_state.h"

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/strip.h"
#include "client/remote/followed_map.h"
#include "client/remote/remote_map_service.h"

namespace cairn::client {
namespace {

constexpr absl::string_view kServerScheme = "cairn://";

// A copy of a map of a server.
absl::StatusOr<std::unique_ptr<ViewSource>> OpenServed(absl::string_view uri, const ServerAccess& access) {
  const absl::string_view where = absl::StripPrefix(uri, kServerScheme);
  const std::size_t slash = where.rfind('/');
  if (slash == absl::string_view::npos || slash == 0 || slash + 1 == where.size()) {
    return absl::InvalidArgumentError(absl::StrCat(uri, ": a map of a server is named as cairn://HOST:PORT/NAME"));
  }
  CAIRN_ASSIGN_OR_RETURN(const RemoteOptions options, RemoteOptionsFor(std::string(where.substr(0, slash)), access));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<RemoteMapService> service, RemoteMapService::Connect(options));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<FollowedMap> copy,
                         service->CopyOf(std::string(where.substr(slash + 1))));
  return copy->NewReader();
}

}  // namespace

absl::StatusOr<std::shared_ptr<MapState>> MapState::Open(const std::string& path, const LocalLocalizerOptions& options,
                                                         const ServerAccess& server) {
  if (absl::StartsWith(path, kServerScheme)) {
    CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<ViewSource> copy, OpenServed(path, server));
    CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<LocalLocalizer> localizer, LocalLocalizer::Open(std::move(copy), options));
    return std::shared_ptr<MapState>(new MapState(std::move(localizer)));
  }
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

std::unique_ptr<ViewSource> MapState::NewReader() {
  const auto lock = LockToRead();
  return localizer_->NewReader();
}

void MapState::Read(const std::function<void(const map::Snapshot&)>& read) {
  const auto lock = LockToRead();
  read(localizer_->snapshot());
}

}  // namespace cairn::client
