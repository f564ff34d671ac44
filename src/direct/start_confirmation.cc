#include "direct/start_confirmation.h"

namespace cairn::direct {
namespace {

constexpr int kMinDoubtedFrames = 5;  // after the start
constexpr int kMaxDoubtedFrames = 30;
constexpr double kWayRatio = 2.0;  // against the way of the start: then it is judged
constexpr double kWrongCostRatio = 2.0;
constexpr double kWrongCostPx2 = 0.3;  // and by how much more, at least
// Of the parallax that corners see: what they misfit their own motion by. As much is open in the depths; corners with
// more prove nothing.
constexpr double kMaxWitnessMisfit = 0.05;

// Camera from the reference, which has a pose.
std::vector<std::optional<SE3>> SinceReference(const std::vector<std::optional<SE3>>& direct_from_camera) {
  const SE3 reference_from_direct = direct_from_camera.front()->Inverse();
  std::vector<std::optional<SE3>> camera_from_reference;
  camera_from_reference.reserve(direct_from_camera.size());
  for (const std::optional<SE3>& pose : direct_from_camera) {
    camera_from_reference.push_back(pose ? std::optional<SE3>((reference_from_direct * *pose).Inverse())
                                         : std::nullopt);
  }
  return camera_from_reference;
}

}  // namespace

bool ExplainsClearlyWorse(double squared_px2, double than_px2) {
  return squared_px2 > kWrongCostRatio * than_px2 && squared_px2 > than_px2 + kWrongCostPx2;
}

StartVerdict StartConfirmation::Judge(const Frame& frame, bool tracked,
                                      const std::vector<std::optional<SE3>>& direct_from_camera, StartResult* better) {
  const bool followed = corners_->Continue(frame);
  const int after = corners_->FrameCount() - start_frames_;
  const bool last_chance = !followed || after >= kMaxDoubtedFrames;
  const bool moved_on = tracked && MovedOn(direct_from_camera);
  if (!followed && !moved_on) {
    return tracked && IsWrong(direct_from_camera, better) ? StartVerdict::kWrong : StartVerdict::kUnproven;
  }
  if (!tracked) return last_chance ? StartVerdict::kRight : StartVerdict::kOpen;  // nothing to hold against it
  if (!last_chance && (after < kMinDoubtedFrames || !moved_on)) return StartVerdict::kOpen;
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
  return IsWorse(direct_from_camera, *better);
}

bool StartConfirmation::IsWorse(const std::vector<std::optional<SE3>>& direct_from_camera,
                                const StartResult& better) const {
  const double cost = corners_->CostOf(SinceReference(direct_from_camera));
  return cost < 1e299 && ExplainsClearlyWorse(cost, better.cost);
}

// Something that moves by itself through the view makes a second motion of its own, or with the rest, that costs less;
// but the corners that the odometry explains it then explains as well as ever. A wrong odometry explains none well.
StartVerdict StartConfirmation::Compare(const StartResult& second,
                                        const std::vector<std::optional<SE3>>& direct_from_camera) const {
  if (!direct_from_camera.front() || second.misfit_share > kMaxWitnessMisfit) return StartVerdict::kUnproven;
  if (!IsWorse(direct_from_camera, second)) return StartVerdict::kRight;
  const double rms_px = corners_->InlierRmsPxOf(SinceReference(direct_from_camera));
  return ExplainsClearlyWorse(rms_px * rms_px, second.rms_px * second.rms_px) ? StartVerdict::kWrong
                                                                              : StartVerdict::kUnproven;
}

}  // namespace cairn::direct
