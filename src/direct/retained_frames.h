// Frames that are kept with their images until they can be tracked, oldest first, in two rows:
//  - start: all that wait for a start, and those that followed it while it is doubted. The start's reference is one of
//    them; what is older than the reference is thinned out, so that a long wait costs no more than a short one.
//  - lost: since the last frame with a pose. They end the wait for a known view, or become the first of the next start.
//    The odometry gives up after OdometryOptions::max_lost_frames of them.
//
// Only the thread that calls Odometry::OptimizeNext() uses it: no lock. An image is shared with whoever else has it.
#pragma once

#include <cstddef>
#include <deque>

#include "direct/packet.h"

namespace cairn::direct {

struct RetainedFrame {
  Frame frame;
  std::size_t position = 0;  // in the PoseTable
  cv::Mat thumbnail = {};    // of the start's row: CV_32FC1 without its mean; empty without an image
};

class RetainedFrames {
 public:
  // As many are kept before the start's reference, at least 1.
  explicit RetainedFrames(int max_before_reference)
      : max_before_reference_(static_cast<std::size_t>(max_before_reference)) {}

  // The start's row.
  void Add(const Frame& frame, std::size_t position);
  // The newest becomes the start's reference.
  void MarkReference() { reference_ = start_.size() - 1; }
  // Drops frames before the reference until no more than the bound are left: each time the one whose neighbours look
  // most alike, and are closest in time where several do. The oldest stays, and of the others those by which a motion
  // can be followed: a camera that stood for long before it moved has not lost the moment when it did.
  void Thin();
  void ClearStart();
  const std::deque<RetainedFrame>& start() const { return start_; }
  std::size_t reference() const { return reference_; }  // in start()
  // The frame so many after the reference.
  const RetainedFrame& SinceReference(std::size_t count) const { return start_[reference_ + count]; }

  // The row of the lost.
  void AddLost(const Frame& frame, std::size_t position) { lost_.push_back({frame, position}); }
  template <class Iterator>
  void SetLost(Iterator begin, Iterator end) {
    lost_.assign(begin, end);
  }
  void ClearLost() { lost_.clear(); }
  const std::deque<RetainedFrame>& lost() const { return lost_; }

  // The row in which frames without a pose are while the odometry has none: once it starts anew, the lost ones have
  // gone over to the start.
  const std::deque<RetainedFrame>& Waiting() const { return lost_.empty() ? start_ : lost_; }

 private:
  std::size_t max_before_reference_;
  std::deque<RetainedFrame> start_;
  std::size_t reference_ = 0;
  std::deque<RetainedFrame> lost_;
};

}  // namespace cairn::direct
