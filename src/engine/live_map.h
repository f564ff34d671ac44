// The head of one map: its newest revision, and the only way to the next. Whoever changes the map does it through an
// Editor, one at a time: a session, a loop's adjustment, an alignment, an administrator. A change is validated, made
// durable, published, and then told to those who subscribed: each revision once, in order, none left out. Nobody but
// the editors ever sees a revision that a crash could take back.
//
// A view is made from the one before and the change (tracking/map_view.h), so that publishing costs what has changed.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/fair_mutex.h"
#include "base/status.h"
#include "map/delta.h"
#include "mapping/map_head.h"
#include "place/vocabulary.h"
#include "store/map_store.h"
#include "tracking/map_view.h"

namespace cairn::engine {

// A change that is durable: `delta` leads from `before` to `after`. For a subscriber that fell behind, several as one.
struct MapChange {
  std::shared_ptr<const tracking::MapView> before;
  std::shared_ptr<const map::Delta> delta;
  std::shared_ptr<const tracking::MapView> after;
};

class Subscription;

class LiveMap {
 public:
  // A new map at `uri`, which appears there with its first keyframe (store::CreateMapStore). The vocabulary, which may
  // be null, is stored with it.
  static absl::StatusOr<std::unique_ptr<LiveMap>> Create(const std::string& uri, const map::MapInfo& info,
                                                         std::shared_ptr<const place::Vocabulary> vocabulary,
                                                         store::CreateOptions options = {});
  // One that is there, to be changed further; with the vocabulary that is in it.
  static absl::StatusOr<std::unique_ptr<LiveMap>> Open(const std::string& uri, const store::WriteOptions& options = {});
  // Over a store that is open for writing and holds `map`.
  static absl::StatusOr<std::unique_ptr<LiveMap>> Over(std::unique_ptr<store::MapStore> store,
                                                       std::shared_ptr<const map::Snapshot> map,
                                                       std::shared_ptr<const place::Vocabulary> vocabulary);

  // What is under way is stored; subscriptions end. All editors must be gone.
  ~LiveMap();
  LiveMap(const LiveMap&) = delete;
  LiveMap& operator=(const LiveMap&) = delete;

  // Waits until all changes are durable and closes the store; the map can be read on, not changed. Its error, or that
  // of a change that could not be stored.
  absl::Status Close();

  // The newest revision that is durable. Any thread; costs the copy of a pointer.
  std::shared_ptr<const tracking::MapView> Published() const;

  // Those who keep references into the map, told of every change as it is made, before it is durable, in the thread of
  // the editor.
  class Listener {
   public:
    virtual ~Listener() = default;
    virtual void OnChange(const tracking::MapView& before, const map::Delta& delta,
                          const std::shared_ptr<const tracking::MapView>& after,
                          const mapping::KeyframeScales& scales) = 0;
  };

  // The right to change the map, until it is destroyed: nobody else changes it meanwhile. By the thread that asked for
  // it.
  class Editor final : public mapping::MapHead {
   public:
    Editor(Editor&&) = default;
    // With what is not durable yet.
    const std::shared_ptr<const tracking::MapView>& View() const override { return live_->head_; }
    // The change need not be durable on return, if changes are stored in the background: one at most is under way, and
    // the call waits for the one before. After an error of the store the head is what is durable, and the error is
    // returned by every call from then on.
    absl::Status Commit(map::Delta delta, const mapping::KeyframeScales& scales) override;
    // Until RemoveListener(), which the listener's owner must call before the listener goes.
    void AddListener(Listener* listener) { live_->listeners_.push_back(listener); }
    void RemoveListener(Listener* listener) { std::erase(live_->listeners_, listener); }

   private:
    friend class LiveMap;
    explicit Editor(LiveMap* live) : live_(live), lock_(live->edit_mutex_) {}
    LiveMap* live_;
    std::unique_lock<FairMutex> lock_;
  };
  // Waits for the editors that came before. An error of the store shows with Commit().
  Editor BeginEdit() { return Editor(this); }

  // One change, made from the head by `make`, which may return none; durable on return. The revision that it led to, or
  // the head's if there was none.
  absl::StatusOr<Revision> Edit(
      const std::function<absl::StatusOr<std::optional<map::Delta>>(const map::Snapshot& head)>& make);

  // From now on a thread makes changes durable, while editors go on. ResourceExhausted if none can be had.
  absl::Status StoreInBackground();
  // Waits until all changes so far are durable; the error if they cannot be.
  absl::Status Flush();

  // All changes from the view that it begins with, or of these that wait the newest one only, for who looks for
  // himself what else has changed. Ends with the map.
  enum class Backlog { kAll, kNewest };
  std::shared_ptr<Subscription> Subscribe(Backlog backlog = Backlog::kAll);

  // False: nothing is kept yet, as there is no keyframe.
  bool exists() const;
  const std::string& uri() const { return store_->uri(); }
  // What a user should be told of opening the map.
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  struct Pending {
    std::shared_ptr<const map::Delta> delta;
    std::shared_ptr<const tracking::MapView> before, after;
  };

  LiveMap(std::unique_ptr<store::MapStore> store, std::shared_ptr<const tracking::MapView> view);
  absl::Status Commit(map::Delta delta, const mapping::KeyframeScales& scales);
  absl::Status Store(Pending change);
  void Publish(Pending change);
  void StoreChanges();
  void StopThread();

  const std::unique_ptr<store::MapStore> store_;  // used under edit_mutex_ or by thread_
  std::vector<std::string> notes_;

  FairMutex edit_mutex_;  // held by an Editor; guards what follows
  std::shared_ptr<const tracking::MapView> head_;
  std::vector<Listener*> listeners_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  std::shared_ptr<const tracking::MapView> published_;
  std::deque<Pending> unpublished_;   // stored by a store that keeps nothing yet
  std::optional<Pending> under_way_;  // for thread_
  absl::Status failure_;              // of the store; stays
  std::vector<std::weak_ptr<Subscription>> subscriptions_;
  bool exists_ = false;
  bool stop_ = false;
  bool closed_ = false;
  std::thread thread_;
};

// The changes of a map, one after the other. One thread at a time.
class Subscription {
 public:
  // Where it begins: the newest durable revision when it was made.
  const std::shared_ptr<const tracking::MapView>& first() const { return first_; }

  // The next change; waits for it at most so long. None if there was none by then; Cancelled once the map is closed and
  // everything has been told. Changes that pile up beyond kMaxWaiting are merged, none is left out, unless only the
  // newest is kept.
  absl::StatusOr<std::optional<MapChange>> Next(std::chrono::milliseconds timeout);

  static constexpr std::size_t kMaxWaiting = 64;

 private:
  friend class LiveMap;
  Subscription(std::shared_ptr<const tracking::MapView> first, std::size_t max_waiting)
      : first_(std::move(first)), max_waiting_(max_waiting) {}
  void Tell(const MapChange& change);
  void End();

  const std::shared_ptr<const tracking::MapView> first_;
  const std::size_t max_waiting_;  // 1: older ones are dropped
  std::mutex mutex_;
  std::condition_variable told_;
  std::deque<MapChange> waiting_;
  bool ended_ = false;
};

}  // namespace cairn::engine
