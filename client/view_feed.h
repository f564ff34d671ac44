// Following a map that is here, for who sends it elsewhere: what differs between the view that was given last and the
// newest one is found when it is asked for, at a cost in proportion to that. Nothing is kept for a follower but the one
// view, and who changes the map waits for none of them.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "api/map_feed.h"
#include "base/status.h"
#include "tracking/map_view.h"

namespace cairn::client {

// Where the views come from.
struct FeedSource {
  using Clock = std::chrono::steady_clock;

  std::function<absl::StatusOr<std::shared_ptr<const tracking::MapView>>()> newest;
  // Returns when there may be another revision than `seen`, and no later than `until`.
  std::function<void(Revision seen, Clock::time_point until)> wait;
  // MapStore::ReadChangedRows(); may be empty: then nothing is known of revisions before the first view.
  std::function<absl::StatusOr<std::optional<map::ChangedRows>>(Revision since)> changed_since;
};

class ViewFeed : public api::MapFeed {
 public:
  ViewFeed(FeedSource source, api::FollowRequest request) : source_(std::move(source)), request_(std::move(request)) {}

  absl::StatusOr<std::optional<api::MapStep>> Next(std::chrono::milliseconds timeout) override;
  std::string Vocabulary() const override;

 private:
  using Clock = FeedSource::Clock;

  absl::StatusOr<map::ChangedRows> FirstRows(const tracking::MapView& newest);
  map::ChangedRows RowsTo(const tracking::MapView& newest) const;
  // Of the whole map, to those of the region.
  void CutOut(api::MapStep* step);

  const FeedSource source_;
  const api::FollowRequest request_;
  std::shared_ptr<const tracking::MapView> sent_;
  std::vector<KeyframeId> sent_keyframes_;  // of the region
  Clock::time_point sent_at_;
};

}  // namespace cairn::client
