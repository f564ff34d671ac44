// Puts the words of keyframes into a place index in a thread of its own, beside that which reads the file: on two
// processors a large map is there sooner. Without a second thread, in the one that reads.
#pragma once

#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "base/bounded_queue.h"
#include "base/guarded.h"
#include "tracking/place_index.h"

namespace cairn::client {

class PlacesBeside {
 public:
  // `places` is used by the thread until Finish(), or the end.
  explicit PlacesBeside(tracking::PlaceIndex::Builder* places) : places_(*places), queue_(kWaiting) {
    absl::StatusOr<std::thread> thread = StartThread(
        "the place index", [this] { Run(); }, [this](const absl::Status& status) { End(status); });
    if (thread.ok()) thread_ = *std::move(thread);
  }
  ~PlacesBeside() { (void)Finish(); }
  PlacesBeside(const PlacesBeside&) = delete;
  PlacesBeside& operator=(const PlacesBeside&) = delete;

  // The error of this or of an earlier keyframe.
  absl::Status Add(KeyframeId keyframe, const std::vector<place::WordId>& words) {
    if (!thread_.joinable()) return places_.Add(keyframe, words);
    return queue_.Push({keyframe, words}) ? absl::OkStatus() : Finish();
  }

  // Waits until all are in.
  absl::Status Finish() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
    return status_;
  }

 private:
  static constexpr std::size_t kWaiting = 64;
  struct Entry {
    KeyframeId keyframe;
    std::vector<place::WordId> words;
  };

  void Run() {
    while (const std::optional<Entry> entry = queue_.Pop()) {
      if (const absl::Status status = places_.Add(entry->keyframe, entry->words); !status.ok()) return End(status);
    }
  }
  void End(const absl::Status& status) {
    status_ = status;
    queue_.Close();
  }

  tracking::PlaceIndex::Builder& places_;
  BoundedQueue<Entry> queue_;
  absl::Status status_;  // of the thread, until it is joined
  std::thread thread_;
};

}  // namespace cairn::client
