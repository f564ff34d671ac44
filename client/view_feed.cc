#include "client/view_feed.h"

#include <algorithm>
#include <thread>
#include <utility>

namespace cairn::client {

std::string ViewFeed::Vocabulary() const {
  return sent_ != nullptr && sent_->places() != nullptr ? sent_->places()->vocabulary().Serialize() : "";
}

absl::StatusOr<map::ChangedRows> ViewFeed::FirstRows(const tracking::MapView& newest) {
  if (request_.map_id != newest.map().info().id || request_.revision == 0) return map::AllRows(newest.map());
  if (request_.revision == newest.revision()) {
    map::ChangedRows none;
    none.base = newest.revision();
    return none;
  }
  if (!source_.changed_since) return map::AllRows(newest.map());
  CAIRN_ASSIGN_OR_RETURN(std::optional<map::ChangedRows> rows, source_.changed_since(request_.revision));
  return rows && request_.revision < newest.revision() ? *std::move(rows) : map::AllRows(newest.map());
}

map::ChangedRows ViewFeed::RowsTo(const tracking::MapView& newest) const {
  // Another file under the same name, or an older one.
  if (sent_->map().info().id != newest.map().info().id || newest.revision() < sent_->revision()) {
    return map::AllRows(newest.map());
  }
  return map::RowsBetween(sent_->map(), newest.map());
}

void ViewFeed::CutOut(api::MapStep* step) {
  const std::vector<KeyframeId> had = step->rows.whole   ? std::vector<KeyframeId>()
                                      : sent_ != nullptr ? sent_keyframes_
                                                         : request_.held;
  step->only = map::KeyframesAround(*step->map, *request_.region);
  step->rows = map::RowsOfRegion(had, step->rows, *step->map, *step->only);
  sent_keyframes_ = *step->only;
}

absl::StatusOr<std::optional<api::MapStep>> ViewFeed::Next(std::chrono::milliseconds timeout) {
  const Clock::time_point until = Clock::now() + timeout;
  if (sent_ != nullptr) std::this_thread::sleep_until(std::min(until, sent_at_ + request_.min_interval));
  for (;;) {
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const tracking::MapView> newest, source_.newest());
    if (sent_ == nullptr || newest->revision() != sent_->revision() ||
        newest->map().info().id != sent_->map().info().id) {
      if (sent_ != nullptr && Clock::now() < sent_at_ + request_.min_interval) return std::nullopt;
      api::MapStep step{newest->snapshot(), {}, {}};
      if (sent_ != nullptr) {
        step.rows = RowsTo(*newest);
      } else {
        CAIRN_ASSIGN_OR_RETURN(step.rows, FirstRows(*newest));
      }
      if (request_.region) CutOut(&step);
      sent_ = std::move(newest);
      sent_at_ = Clock::now();
      return step;
    }
    sent_ = std::move(newest);  // the same revision may have been loaded anew: one of the two is enough
    if (Clock::now() >= until) return std::nullopt;
    source_.wait(sent_->revision(), until);
  }
}

}  // namespace cairn::client
