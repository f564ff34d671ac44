#include "geometry/pose_spread.h"

namespace cairn {

SE3 Between(const SE3& from, const SE3& to, double share) {
  return {from.rotation().slerp(share, to.rotation()), (1.0 - share) * from.translation() + share * to.translation()};
}

SE3 SpreadDifference(const SE3& pose, const SE3& predicted, const SE3& actual, double share) {
  const SE3 moved = Between(predicted, actual, share);
  return SE3(moved.rotation() * predicted.rotation().conjugate() * pose.rotation(),
             pose.translation() + moved.translation() - predicted.translation());
}

}  // namespace cairn
