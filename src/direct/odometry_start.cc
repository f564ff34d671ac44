#include "direct/odometry_start.h"

#include <string>

namespace cairn::direct {

OdometryStart::OdometryStart(const OdometryOptions& options, const Pinhole& camera, RetainedFrames* retained,
                             FirstWindow* first_window)
    : corners_(options, camera), retained_(retained), first_window_(first_window) {}

StartResult OdometryStart::Add(const Frame& frame, std::size_t position, const SegmentNumbers& numbers) {
  StartResult start = corners_.Add(frame);
  retained_->Add(frame, position);
  if (start.new_reference || corners_.FrameCount() == 0) retained_->MarkReference();
  retained_->Thin();
  if (!start.success) return start;
  if (alter_) alter_(&start);
  const absl::Status built = first_window_->FromMotion(start, *retained_, numbers);
  if (!built.ok()) {
    start.success = false;
    start.message = std::string(built.message());
    BeginWithNewest();  // frames before it are thinned out with the next one
  }
  return start;
}

bool OdometryStart::Redo(const StartResult& better, const SegmentNumbers& numbers) {
  if (first_window_->FromMotion(better, *retained_, numbers).ok()) return true;
  LookAgain();
  return false;
}

void OdometryStart::LookAgain() {
  BeginWithNewest();
  retained_->Thin();
}

StartResult OdometryStart::FollowAgain() {
  StartResult start = corners_.Add(retained_->start().back().frame);
  if (start.new_reference || corners_.FrameCount() == 0) retained_->MarkReference();
  retained_->Thin();
  return start;
}

void OdometryStart::BeginWithNewest() {
  corners_.Reset();
  corners_.Add(retained_->start().back().frame);
  retained_->MarkReference();
}

void OdometryStart::Reset() {
  corners_.Reset();
  retained_->ClearStart();
}

}  // namespace cairn::direct
