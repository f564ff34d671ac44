#include "engine/live_map.h"

#include <algorithm>
#include <utility>

#include "base/guarded.h"
#include "health/map_vocabulary.h"

namespace cairn::engine {

absl::StatusOr<std::unique_ptr<LiveMap>> LiveMap::Create(const std::string& uri, const map::MapInfo& info,
                                                         std::shared_ptr<const place::Vocabulary> vocabulary,
                                                         store::CreateOptions options) {
  if (vocabulary != nullptr) options.vocabulary = vocabulary->Serialize();
  CAIRN_ASSIGN_OR_RETURN(auto store, store::CreateMapStore(uri, info, std::move(options)));
  return Over(std::move(store), map::Snapshot::Empty(info), std::move(vocabulary));
}

absl::StatusOr<std::unique_ptr<LiveMap>> LiveMap::Open(const std::string& uri, const store::WriteOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(auto store, store::OpenMapStore(uri, store::OpenMode::kWrite, options));
  CAIRN_ASSIGN_OR_RETURN(auto map, store->LoadSnapshot());
  CAIRN_ASSIGN_OR_RETURN(health::MapVocabulary vocabulary, health::LoadVocabulary(*store));
  CAIRN_ASSIGN_OR_RETURN(auto live, Over(std::move(store), std::move(map), std::move(vocabulary.words)));
  if (!vocabulary.note.empty()) live->notes_.push_back(std::move(vocabulary.note));
  return live;
}

absl::StatusOr<std::unique_ptr<LiveMap>> LiveMap::Over(std::unique_ptr<store::MapStore> store,
                                                       std::shared_ptr<const map::Snapshot> map,
                                                       std::shared_ptr<const place::Vocabulary> vocabulary) {
  auto view = tracking::MapView::Create(std::move(map), std::move(vocabulary));
  CAIRN_RETURN_IF_ERROR(Annotate(view.status(), store->uri()));
  return std::unique_ptr<LiveMap>(new LiveMap(std::move(store), *std::move(view)));
}

LiveMap::LiveMap(std::unique_ptr<store::MapStore> store, std::shared_ptr<const tracking::MapView> view)
    : store_(std::move(store)),
      notes_(store_->notes()),
      head_(view),
      published_(std::move(view)),
      exists_(store_->exists()) {}

LiveMap::~LiveMap() {
  StopThread();
  const std::lock_guard lock(mutex_);
  for (const auto& weak : subscriptions_) {
    if (const auto subscription = weak.lock()) subscription->End();
  }
}

void LiveMap::StopThread() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    changed_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
}

absl::Status LiveMap::Close() {
  const std::lock_guard editing(edit_mutex_);
  const absl::Status flushed = Flush();
  StopThread();
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(closed_, true)) return flushed;
    for (const auto& weak : subscriptions_) {
      if (const auto subscription = weak.lock()) subscription->End();
    }
  }
  const absl::Status closed = store_->Close();
  return flushed.ok() ? closed : flushed;
}

std::shared_ptr<const tracking::MapView> LiveMap::Published() const {
  const std::lock_guard lock(mutex_);
  return published_;
}

bool LiveMap::exists() const {
  const std::lock_guard lock(mutex_);
  return exists_;
}

absl::Status LiveMap::Editor::Commit(map::Delta delta, const mapping::KeyframeScales& scales) {
  return live_->Commit(std::move(delta), scales);
}

absl::Status LiveMap::Commit(map::Delta delta, const mapping::KeyframeScales& scales) {
  // One change at most is under way. Once one could not be stored, what came after it is lost with it.
  if (const absl::Status flushed = Flush(); !flushed.ok()) {
    head_ = Published();
    return flushed;
  }
  if (closed_) return absl::FailedPreconditionError(absl::StrCat("map ", uri(), " has been closed"));
  CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const tracking::MapView> next, head_->After(delta));
  const Pending change{std::make_shared<const map::Delta>(std::move(delta)), head_, next};
  if (thread_.joinable()) {
    const std::lock_guard lock(mutex_);
    under_way_ = change;
    changed_.notify_all();
  } else {
    CAIRN_RETURN_IF_ERROR(Store(change));
  }
  head_ = std::move(next);
  for (Listener* listener : listeners_) listener->OnChange(*change.before, *change.delta, head_, scales);
  return absl::OkStatus();
}

absl::StatusOr<Revision> LiveMap::Edit(
    const std::function<absl::StatusOr<std::optional<map::Delta>>(const map::Snapshot& head)>& make) {
  Editor editor = BeginEdit();
  CAIRN_ASSIGN_OR_RETURN(std::optional<map::Delta> delta, make(editor.View()->map()));
  if (delta) {
    CAIRN_RETURN_IF_ERROR(editor.Commit(*std::move(delta), {}));
    CAIRN_RETURN_IF_ERROR(Flush());
  }
  return editor.View()->revision();
}

absl::Status LiveMap::Store(Pending change) {
  // Its exceptions, memory that runs out above all, as its errors.
  const absl::Status stored = Guarded([&] { return store_->Commit(*change.delta); });
  const std::lock_guard lock(mutex_);
  failure_.Update(stored);
  if (!failure_.ok()) return failure_;
  exists_ = store_->exists();
  unpublished_.push_back(std::move(change));
  // A store that keeps nothing yet has made nothing durable.
  while (exists_ && !unpublished_.empty()) {
    Publish(std::move(unpublished_.front()));
    unpublished_.pop_front();
  }
  return absl::OkStatus();
}

// With the lock held, so that everyone hears of revisions in their order.
void LiveMap::Publish(Pending change) {
  published_ = change.after;
  std::erase_if(subscriptions_, [](const auto& weak) { return weak.expired(); });
  for (const auto& weak : subscriptions_) {
    if (const auto subscription = weak.lock()) subscription->Tell({change.before, change.delta, change.after});
  }
}

absl::Status LiveMap::StoreInBackground() {
  const std::lock_guard editing(edit_mutex_);
  if (thread_.joinable()) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(thread_, StartThread(
                                      "storing changes of the map", [this] { StoreChanges(); },
                                      [this](const absl::Status& status) {
                                        const std::lock_guard lock(mutex_);
                                        failure_.Update(status);
                                        under_way_.reset();
                                        changed_.notify_all();
                                      }));
  return absl::OkStatus();
}

void LiveMap::StoreChanges() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return stop_ || under_way_; });
    if (!under_way_) return;
    const Pending change = *under_way_;
    lock.unlock();
    Store(change).IgnoreError();  // kept as failure_
    lock.lock();
    under_way_.reset();
    changed_.notify_all();
  }
}

absl::Status LiveMap::Flush() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !under_way_; });
  return failure_;
}

std::shared_ptr<Subscription> LiveMap::Subscribe(Backlog backlog) {
  const std::lock_guard lock(mutex_);
  std::shared_ptr<Subscription> subscription(
      new Subscription(published_, backlog == Backlog::kNewest ? 1 : Subscription::kMaxWaiting));
  if (closed_) subscription->End();
  subscriptions_.push_back(subscription);
  return subscription;
}

// --- Subscription ---

void Subscription::Tell(const MapChange& change) {
  const std::lock_guard lock(mutex_);
  if (max_waiting_ == 1) waiting_.clear();
  waiting_.push_back(change);
  if (waiting_.size() > max_waiting_) {
    // The two newest become one: the older ones are what a subscriber that wakes up wants first.
    MapChange& into = waiting_[waiting_.size() - 2];
    absl::StatusOr<map::Delta> merged = map::MergeDeltas(into.before->map(), *into.delta, *change.delta);
    if (merged.ok()) {
      into.delta = std::make_shared<const map::Delta>(*std::move(merged));
      into.after = change.after;
      waiting_.pop_back();
    }
  }
  told_.notify_all();
}

void Subscription::End() {
  const std::lock_guard lock(mutex_);
  ended_ = true;
  told_.notify_all();
}

absl::StatusOr<std::optional<MapChange>> Subscription::Next(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  told_.wait_for(lock, timeout, [&] { return ended_ || !waiting_.empty(); });
  if (waiting_.empty()) {
    if (ended_) return absl::CancelledError("the map has been closed");
    return std::nullopt;
  }
  MapChange change = std::move(waiting_.front());
  waiting_.pop_front();
  return change;
}

}  // namespace cairn::engine
