// The head of the map as one session sees it: its own for as long as it takes a turn, in between other editors'.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "engine/live_map.h"
#include "mapping/map_head.h"

namespace cairn::engine {

// By one thread at a time.
class SessionHead final : public mapping::MapHead {
 public:
  explicit SessionHead(LiveMap* live) : live_(live) {}

  // Waits for the editor before, and has the head until it is destroyed.
  class Turn {
   public:
    explicit Turn(SessionHead* head) : head_(head) { head_->editor_.emplace(head_->live_->BeginEdit()); }
    ~Turn() { head_->editor_.reset(); }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

   private:
    SessionHead* const head_;
  };

  // All of these within a turn.
  const std::shared_ptr<const tracking::MapView>& View() const override { return editor_->View(); }
  absl::Status Commit(map::Delta delta, const mapping::KeyframeScales& scales) override {
    return editor_->Commit(std::move(delta), scales);
  }
  LiveMap::Editor& editor() { return *editor_; }

 private:
  LiveMap* const live_;
  std::optional<LiveMap::Editor> editor_;
};

}  // namespace cairn::engine
