#include "engine/odometry_runner.h"

#include <chrono>
#include <utility>

#include "base/guarded.h"

namespace cairn::engine {

absl::Status OdometryRunnerOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(odometry.Validate());
  if (max_pending < 1) return absl::InvalidArgumentError("max_pending must be at least 1");
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<OdometryRunner>> OdometryRunner::Create(const OdometryRunnerOptions& options,
                                                                       const Pinhole& camera,
                                                                       AfterMapping after_mapping) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<direct::Odometry> odometry,
                         direct::Odometry::Create(options.odometry, camera));
  std::unique_ptr<OdometryRunner> runner(new OdometryRunner(options, std::move(odometry), std::move(after_mapping)));
  if (options.in_background) {
    OdometryRunner* const self = runner.get();
    CAIRN_ASSIGN_OR_RETURN(runner->thread_, StartThread(
                                                "mapping of the odometry", [self] { self->MapInBackground(); },
                                                [self](const absl::Status& status) { self->EndWith(status); }));
  }
  return runner;
}

OdometryRunner::OdometryRunner(const OdometryRunnerOptions& options, std::unique_ptr<direct::Odometry> odometry,
                               AfterMapping after_mapping)
    : options_(options), odometry_(std::move(odometry)), after_mapping_(std::move(after_mapping)) {}

OdometryRunner::~OdometryRunner() { StopThread(/*drain=*/false).IgnoreError(); }

absl::StatusOr<direct::FrameResult> OdometryRunner::AddFrame(const direct::Frame& frame) {
  const auto start = std::chrono::steady_clock::now();
  FrameTimes times = times_;
  if (const absl::Status in_order = times.Accept(frame.time_ns); !in_order.ok()) {
    times_ = times;  // remembers what it doubts
    return Annotate(in_order, absl::StrCat("frame ", frame.index));
  }
  absl::StatusOr<direct::FrameResult> result = Guarded([&] { return Process(frame); });
  if (!result.ok()) {
    // Nothing is known of an odometry that a library left in the middle.
    const absl::Status& status = result.status();
    if (!absl::IsInvalidArgument(status) && !absl::IsFailedPrecondition(status)) EndWith(status);
    return result;
  }
  times_ = times;
  recent_frames_.push_back(
      {start, std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count()});
  if (recent_frames_.size() > kRecentFrames) recent_frames_.pop_front();
  frame_ms_.Add(recent_frames_.back().ms);
  if (result->state == direct::TrackingState::kInitializing) waiting_for_.Add(result->message);
  if (!options_.in_background) {
    status_ = Guarded([&] { return after_mapping_(*odometry_); });
    CAIRN_RETURN_IF_ERROR(status_);
  }
  return result;
}

absl::StatusOr<direct::FrameResult> OdometryRunner::Process(const direct::Frame& frame) {
  if (!options_.in_background) {
    CAIRN_RETURN_IF_ERROR(status_);
    return odometry_->Process(frame);
  }
  {
    std::unique_lock lock(mutex_);
    room_.wait(lock, [&] {
      return !status_.ok() || (odometry_->PendingFrames() < options_.max_pending && !odometry_->AwaitsKeyframe());
    });
    CAIRN_RETURN_IF_ERROR(status_);
  }
  CAIRN_ASSIGN_OR_RETURN(direct::FrameResult result, odometry_->Track(frame));
  // Under the lock, so that the thread is either waiting or has not looked yet.
  std::lock_guard lock(mutex_);
  work_.notify_one();
  return result;
}

// Nothing is mapped any more, and whoever waits for it is told. The first error stays.
void OdometryRunner::EndWith(const absl::Status& status) {
  std::lock_guard lock(mutex_);
  status_.Update(status);
  room_.notify_one();
}

absl::Status OdometryRunner::GoOnFrom(direct::KnownView view) {
  CAIRN_RETURN_IF_ERROR(odometry_->GoOnFrom(std::move(view)));
  std::lock_guard lock(mutex_);
  work_.notify_one();
  return absl::OkStatus();
}

void OdometryRunner::MapInBackground() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_.wait(lock, [&] { return ending_ || odometry_->PendingFrames() > 0; });
    if (!status_.ok() || (ending_ && (!drain_ || odometry_->PendingFrames() == 0))) return;
    lock.unlock();
    odometry_->OptimizeNext();
    {  // tracking need not wait for what comes now
      const std::lock_guard mapped(mutex_);
      room_.notify_one();
    }
    const absl::Status status = after_mapping_(*odometry_);
    lock.lock();
    status_.Update(status);
    room_.notify_one();
  }
}

absl::Status OdometryRunner::StopThread(bool drain) {
  {
    std::lock_guard lock(mutex_);
    ending_ = true;
    drain_ = drain;
    work_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
  return status_;
}

absl::Status OdometryRunner::Finish() {
  CAIRN_RETURN_IF_ERROR(StopThread(/*drain=*/true));
  CAIRN_RETURN_IF_ERROR(Guarded([&] {
    odometry_->Finish();
    return absl::OkStatus();
  }));
  // The live answers were behind what mapping has found out since.
  const std::vector<direct::FrameResult> results = odometry_->FrameResults();
  if (!results.empty() && results.back().state == direct::TrackingState::kInitializing) {
    waiting_for_.Add(results.back().message);
  }
  status_ = Guarded([&] { return after_mapping_(*odometry_); });
  return status_;
}

}  // namespace cairn::engine
