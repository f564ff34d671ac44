#include "engine/odometry_runner.h"

#include <chrono>
#include <utility>

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
  return std::unique_ptr<OdometryRunner>(new OdometryRunner(options, std::move(odometry), std::move(after_mapping)));
}

OdometryRunner::OdometryRunner(const OdometryRunnerOptions& options, std::unique_ptr<direct::Odometry> odometry,
                               AfterMapping after_mapping)
    : options_(options), odometry_(std::move(odometry)), after_mapping_(std::move(after_mapping)) {
  if (options_.in_background) thread_ = std::thread([this] { MapInBackground(); });
}

OdometryRunner::~OdometryRunner() { StopThread(/*drain=*/false).IgnoreError(); }

absl::StatusOr<direct::FrameResult> OdometryRunner::AddFrame(const direct::Frame& frame) {
  const auto start = std::chrono::steady_clock::now();
  direct::FrameResult result;
  if (options_.in_background) {
    {
      std::unique_lock lock(mutex_);
      room_.wait(lock, [&] {
        return !status_.ok() || (odometry_->PendingFrames() < options_.max_pending && !odometry_->AwaitsKeyframe());
      });
      CAIRN_RETURN_IF_ERROR(status_);
    }
    CAIRN_ASSIGN_OR_RETURN(result, odometry_->Track(frame));
    // Under the lock, so that the thread is either waiting or has not looked yet.
    std::lock_guard lock(mutex_);
    work_.notify_one();
  } else {
    CAIRN_RETURN_IF_ERROR(status_);
    CAIRN_ASSIGN_OR_RETURN(result, odometry_->Process(frame));
  }
  frame_begins_.push_back(start);
  frame_ms_.push_back(std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count());
  if (result.state == direct::TrackingState::kInitializing && !result.message.empty()) waiting_for_ = result.message;
  if (!options_.in_background) {
    status_ = after_mapping_(*odometry_);
    CAIRN_RETURN_IF_ERROR(status_);
  }
  return result;
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
    odometry_->MapNext();
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
  odometry_->Finish();
  // The live answers were behind what mapping has found out since.
  const std::vector<direct::FrameResult> results = odometry_->FrameResults();
  if (!results.empty() && !results.back().message.empty()) waiting_for_ = results.back().message;
  status_ = after_mapping_(*odometry_);
  return status_;
}

}  // namespace cairn::engine
