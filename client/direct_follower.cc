#include "client/direct_follower.h"

#include <algorithm>
#include <utility>

#include "base/guarded.h"

namespace cairn::client {
namespace {

constexpr int kMaxPending = 2;  // frames that wait to be worked into the window

// As the odometry takes it.
double MedianInverseDepth(const std::vector<direct::PacketPoint>& points) {
  std::vector<float> inverse;
  for (const direct::PacketPoint& point : points) inverse.push_back(point.inverse_depth);
  const auto middle = inverse.begin() + static_cast<std::ptrdiff_t>(inverse.size() / 2);
  std::nth_element(inverse.begin(), middle, inverse.end());
  return *middle;
}

}  // namespace

absl::StatusOr<std::unique_ptr<DirectFollower>> DirectFollower::Begin(const direct::OdometryOptions& options,
                                                                      const Pinhole& pinhole,
                                                                      const direct::Frame& frame,
                                                                      const direct::KnownView& view, bool in_background,
                                                                      direct::FrameResult* begun) {
  direct::OdometryOptions live = options;
  live.keep_history = false;
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<direct::Odometry> odometry, direct::Odometry::Create(live, pinhole));
  CAIRN_ASSIGN_OR_RETURN(*begun, odometry->BeginFrom(frame, view));
  std::unique_ptr<DirectFollower> follower(new DirectFollower(std::move(odometry)));
  follower->direct_unit_ = 1.0 / MedianInverseDepth(view.points);
  follower->tracked_against_ = begun->keyframe;
  follower->AfterOptimization();
  if (in_background) {
    DirectFollower* const self = follower.get();
    CAIRN_ASSIGN_OR_RETURN(follower->thread_, StartThread(
                                                  "keyframes of the tracker", [self] { self->Run(); },
                                                  [self](const absl::Status& status) {
                                                    const std::lock_guard lock(self->mutex_);
                                                    self->status_ = status;
                                                    self->room_.notify_one();
                                                  }));
  }
  return follower;
}

DirectFollower::~DirectFollower() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    work_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
}

absl::StatusOr<direct::FrameResult> DirectFollower::Track(const direct::Frame& frame) {
  direct::FrameResult result;
  if (thread_.joinable()) {
    {
      std::unique_lock lock(mutex_);
      room_.wait(lock, [&] {
        return !status_.ok() || (odometry_->PendingFrames() < kMaxPending && !odometry_->AwaitsKeyframe());
      });
      CAIRN_RETURN_IF_ERROR(status_);
    }
    CAIRN_ASSIGN_OR_RETURN(result, odometry_->Track(frame));
    const std::lock_guard lock(mutex_);
    if (result.keyframe >= 0) tracked_against_ = result.keyframe;
    work_.notify_one();
  } else {
    CAIRN_ASSIGN_OR_RETURN(result, odometry_->Process(frame));
    if (result.keyframe >= 0) tracked_against_ = result.keyframe;
    AfterOptimization();
  }
  ended_ = ended_ || result.state == direct::TrackingState::kInitializing;
  return result;
}

std::optional<SE3> DirectFollower::Motion(const direct::FrameResult& a, const direct::FrameResult& b) const {
  return odometry_->Motion(a, b);
}

std::shared_ptr<const KeyframeDepths> DirectFollower::Depths() const {
  const std::lock_guard lock(mutex_);
  return depths_;
}

// Nobody maps the packets; the points of the keyframe that frames are tracked against are kept. By the thread that
// optimizes.
void DirectFollower::AfterOptimization() {
  odometry_->TakePackets();
  std::int64_t wanted;
  {
    const std::lock_guard lock(mutex_);
    wanted = tracked_against_;
    if (depths_ != nullptr && depths_->keyframe == wanted) return;
  }
  absl::StatusOr<direct::KeyframePacket> packet = odometry_->PacketOf(wanted);
  if (!packet.ok()) return;
  auto depths = std::make_shared<KeyframeDepths>();
  depths->keyframe = wanted;
  depths->points = std::move(packet->points);
  const std::lock_guard lock(mutex_);
  depths_ = std::move(depths);
}

void DirectFollower::Run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_.wait(lock, [&] { return ending_ || odometry_->PendingFrames() > 0; });
    if (ending_) return;
    lock.unlock();
    odometry_->OptimizeNext();
    {  // tracking need not wait for what comes now
      const std::lock_guard done(mutex_);
      room_.notify_one();
    }
    AfterOptimization();
    lock.lock();
  }
}

}  // namespace cairn::client
