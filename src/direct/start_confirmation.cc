#include "direct/start_confirmation.h"

namespace cairn::direct {
namespace {

constexpr int kMinDoubtedFrames = 5;  // after the start
constexpr int kMaxDoubtedFrames = 30;
constexpr double kWayRatio = 2.0;  // against the way of the start: then it is judged
constexpr double kWrongCostRatio = 2.0;
constexpr double kWrongCostPx2 = 0.3;  // and by how much more, at least

}  // namespace

StartVerdict StartConfirmation::Judge(const Frame& frame, bool tracked,
                                      const std::vector<std::optional<SE3>>& direct_from_camera, StartResult* better) {
  const bool followed = corners_->Continue(frame);
  const int after = corners_->FrameCount() - start_frames_;
  const bool last_chance = !followed || after >= kMaxDoubtedFrames;
  if (!tracked) return last_chance ? StartVerdict::kRight : StartVerdict::kOpen;  // nothing to hold against it
  if (!last_chance && (after < kMinDoubtedFrames || !MovedOn(direct_from_camera))) return StartVerdict::kOpen;
  return IsWrong(direct_from_camera, better) ? StartVerdict::kWrong : StartVerdict::kRight;
}

bool StartConfirmation::MovedOn(const std::vector<std::optional<SE3>>& direct_from_camera) const {
  const std::optional<SE3>& newest = direct_from_camera.back();
  const std::optional<SE3>& first = direct_from_camera.front();
  const std::optional<SE3>& last = direct_from_camera[static_cast<std::size_t>(start_frames_) - 1];
  if (!newest || !first || !last) return false;
  const double start_way = (last->translation() - first->translation()).norm();
  return (newest->translation() - first->translation()).norm() > kWayRatio * start_way;
}

bool StartConfirmation::IsWrong(const std::vector<std::optional<SE3>>& direct_from_camera, StartResult* better) const {
  *better = corners_->SolveAgain();
  if (!better->success || !direct_from_camera.front()) return false;  // nothing better is known
  const SE3 reference_from_direct = direct_from_camera.front()->Inverse();
  std::vector<std::optional<SE3>> camera_from_reference;
  camera_from_reference.reserve(direct_from_camera.size());
  for (const std::optional<SE3>& pose : direct_from_camera) {
    camera_from_reference.push_back(pose ? std::optional<SE3>((reference_from_direct * *pose).Inverse())
                                         : std::nullopt);
  }
  const double cost = corners_->CostOf(camera_from_reference);
  return cost < 1e299 && cost > kWrongCostRatio * better->cost && cost > better->cost + kWrongCostPx2;
}

}  // namespace cairn::direct
