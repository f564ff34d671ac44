#include "care/session_removal.h"

#include <map>
#include <utility>
#include <vector>

#include "base/median.h"
#include "care/adjustment.h"
#include "map/edit.h"

namespace cairn::care {
namespace {

struct Shares {
  std::vector<KeyframeId> own;
  KeyframeId oldest_other;
  std::int64_t others = 0;
};

// Removes its keyframes; the components that others remain in are those to be adjusted.
std::vector<ComponentId> TakeOut(SessionId session, map::Edit* edit, api::SessionRemoval* removal) {
  std::map<ComponentId, Shares> components;
  edit->base().keyframes().ForEach([&](const auto& keyframe) {
    Shares& shares = components[keyframe->component];
    if (keyframe->session == session) {
      shares.own.push_back(keyframe->id);
    } else {
      if (!shares.oldest_other) shares.oldest_other = keyframe->id;
      ++shares.others;
    }
  });
  std::vector<ComponentId> left;
  for (const auto& [component, shares] : components) {
    if (shares.own.empty()) continue;
    removal->keyframes += static_cast<std::int64_t>(shares.own.size());
    if (shares.others == 0) {
      edit->EraseComponent(component);
      removal->removed_components.push_back(component);
      continue;
    }
    left.push_back(component);
    bool own_root = false;
    for (const KeyframeId id : shares.own) own_root |= !edit->keyframe(id).parent;
    if (own_root) edit->MakeRoot(shares.oldest_other);
    for (const KeyframeId id : shares.own) edit->EraseKeyframe(id);
  }
  map::Session removed = edit->session(session);
  removed.removed = true;
  edit->PutSession(removed);
  return left;
}

}  // namespace

absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session, engine::LiveMap& live) {
  api::SessionRemoval removal;
  removal.session = session;
  {
    // Nobody else changes the map between what is computed and what is stored.
    engine::LiveMap::Editor editor = live.BeginEdit();
    const std::shared_ptr<const map::Snapshot> head = editor.View()->snapshot();
    const auto found = head->sessions().find(session);
    if (found == head->sessions().end()) {
      return absl::NotFoundError(absl::StrCat(map, " has no session ", session.value(), " (cairn ls MAP sessions)"));
    }
    if (found->second.removed) {
      return absl::FailedPreconditionError(
          absl::StrCat("session ", session.value(), " of ", map, " has been removed already"));
    }
    map::Edit edit(head);
    const std::vector<ComponentId> left = TakeOut(session, &edit, &removal);
    const std::string reason = absl::StrCat("remove session ", session.value());
    CAIRN_ASSIGN_OR_RETURN(AdjustedChange change, AdjustAfter(head, edit.Finish(reason), left));
    removal.points = static_cast<std::int64_t>(change.delta.removed_points.size());
    removal.adjusted_keyframes = change.keyframes;
    removal.adjustment_rmse_px = change.rmse_px;
    removal.median_move_share = Median(std::move(change.moves));
    CAIRN_RETURN_IF_ERROR(editor.Commit(std::move(change.delta), {}));
    removal.revision = editor.View()->revision();
  }
  CAIRN_RETURN_IF_ERROR(live.Flush());
  return removal;
}

}  // namespace cairn::care
