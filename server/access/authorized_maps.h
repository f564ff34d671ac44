// The maps as one client may use them: the one place where a call needs a right. Whoever adds a call to
// api::MapService says here which right it needs (Require), and whether it is a change that is written down (Changing);
// it does not compile otherwise.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "api/map_service.h"
#include "base/status.h"
#include "server/access/access.h"

namespace cairn::server {

class AuthorizedMaps final : public api::MapService {
 public:
  // Both must outlive this and what it gives out.
  AuthorizedMaps(api::MapService* maps, Access* access, Client client)
      : maps_(*maps), access_(*access), client_(std::move(client)) {}

  // Only those that the client may read.
  absl::StatusOr<std::vector<api::MapSummary>> List() override;
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) override;
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& query) override;
  // The right is asked for again with every frame: a token that was revoked ends what it began.
  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTracker(const std::string& map, const Camera& camera) override;
  // Likewise, with every step.
  absl::StatusOr<std::unique_ptr<api::MapFeed>> Follow(const std::string& map,
                                                       const api::FollowRequest& request) override;
  absl::StatusOr<std::unique_ptr<api::MapSession>> StartSession(const api::SessionRequest& request) override;
  absl::StatusOr<std::unique_ptr<api::MapSession>> ResumeSession(const std::string& token) override;
  // Without names: those that the client may read.
  absl::StatusOr<api::AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                   const api::LocalizeQuery& query) override;
  // Without a name: those in maps that the client may read.
  absl::StatusOr<std::vector<api::ActiveSession>> Sessions(const std::string& map) override;

  // What keeps maps, and changes them (authorized_admin.cc).
  absl::StatusOr<api::MapSummary> Create(const std::string& map, const std::string& title) override;
  absl::StatusOr<api::MapSummary> Snapshot(const std::string& map, const std::string& as) override;
  absl::StatusOr<std::string> Delete(const std::string& map) override;
  // Only those that the client might restore.
  absl::StatusOr<std::vector<api::DeletedMap>> ListDeleted() override;
  absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) override;
  absl::StatusOr<api::MapVerification> Verify(const std::string& map, api::VerifyDepth depth) override;
  absl::StatusOr<api::AlignAnswer> Align(const std::string& map, const api::AlignRequest& request) override;
  absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session) override;
  absl::StatusOr<map::MapOverview> Overview(const std::string& map) override;
  absl::StatusOr<api::MapLog> Log(const std::string& map, const map::ChangeQuery& query) override;
  absl::Status Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) override;

 private:
  // Takes out what is of maps on which the client does not have the right. `map_of`: the name of an item's.
  template <class Item, class MapOf>
  absl::Status KeepAllowed(Right right, std::vector<Item>* items, MapOf&& map_of) {
    absl::Status failed;  // of the tokens as a whole, not of one map
    std::erase_if(*items, [&](const Item& item) {
      const absl::Status allowed = access_.Require(client_, right, map_of(item));
      if (!allowed.ok() && !absl::IsPermissionDenied(allowed)) failed = allowed;
      return !allowed.ok();
    });
    return failed;
  }
  // PermissionDenied before anybody looks whether there is such a map; InvalidArgument for what is no name.
  absl::Status Require(Right right, const std::string& map);

  // A change of one map: asks for the right, makes it, and writes down how it went, in the audit log. `change` returns
  // a StatusOr; `details` has a JSON object of what it gave, or "".
  template <class Function, class Details>
  auto Changing(Right right, const std::string& action, const std::string& map, Function&& change, Details&& details)
      -> decltype(change()) {
    const auto allowed_change = [&]() -> decltype(change()) {
      CAIRN_RETURN_IF_ERROR(Require(right, map));
      return change();
    };
    auto outcome = allowed_change();
    access_.Record(client_, {action, map, outcome.ok() ? details(*outcome) : ""}, outcome.status());
    return outcome;
  }

  api::MapService& maps_;
  Access& access_;
  const Client client_;
};

}  // namespace cairn::server
