// Keyframes: what OptimizeNext() makes of a frame, optimization, marginalization.
#include <algorithm>
#include <cmath>

#include "direct/odometry_impl.h"

namespace cairn::direct {

SE3 Odometry::Impl::KeyframePoseOf(std::int64_t id) const {
  std::lock_guard lock(mutex_);
  return poses_.keyframe(id).direct_from_camera;
}

bool Odometry::Impl::OptimizeNext() {
  Job job;
  bool starting;
  {
    std::lock_guard lock(mutex_);
    if (jobs_.empty()) return false;
    job = std::move(jobs_.front());
    jobs_.erase(jobs_.begin());
    starting = mode_ == Mode::kStarting;
  }
  if (job.known) {
    BeginAt(*job.known);
    return true;
  }
  if (job.lost) {
    retained_.AddLost(job.frame, job.position);
    DoubtStart(job.frame, job.position, false);
    if (job.restart) {
      FlushWindow();
      RequeueLost();
    }
    return true;
  }
  if (!job.data) {
    if (starting) {
      AddToStart(job);
    } else {
      // Handed over before the start succeeded.
      const std::lock_guard track_lock(track_mutex_);
      Job tracked;
      TrackFrame(job.frame, job.position, &tracked);
      std::lock_guard lock(mutex_);
      if (tracked.restart) mode_ = Mode::kStarting, ++untracked_jobs_;
      keyframe_queued_ |= tracked.keyframe;
      if (tracked.data || tracked.lost) jobs_.insert(jobs_.begin(), std::move(tracked));
    }
    std::lock_guard lock(mutex_);
    --untracked_jobs_;
    return true;
  }
  retained_.ClearLost();
  last_frame_ = {};
  const Frame frame = job.data->frame;
  const std::size_t position = job.position;
  if (job.keyframe) {
    MakeKeyframe(job);
    std::lock_guard lock(mutex_);
    keyframe_queued_ = false;
  } else if (!window_.empty()) {
    const Timer timer(this, &statistics_.trace);
    candidates_.Trace(*job.data, (KeyframePoseOf(job.reference) * job.keyframe_from_camera).Inverse(), job.light,
                      job.covered);
    last_frame_ = std::move(job);
  }
  DoubtStart(frame, position, true);
  return true;
}

void Odometry::Impl::MakeKeyframe(const Job& job) {
  auto keyframe = std::make_unique<Keyframe>();
  keyframe->segment = segment_;
  keyframe->data = job.data;
  keyframe->camera_from_direct = (KeyframePoseOf(job.reference) * job.keyframe_from_camera).Inverse();
  keyframe->light = job.light;
  {
    const Timer timer(this, &statistics_.trace);
    candidates_.Trace(*job.data, keyframe->camera_from_direct, keyframe->light, job.covered);
  }
  {
    std::lock_guard lock(mutex_);
    keyframe->id = poses_.next_keyframe();
    const Frame& frame = job.data->frame;
    poses_.AddKeyframe({keyframe->id, segment_, frame.index, frame.time_ns, keyframe->camera_from_direct.Inverse(),
                        true, job.reference, job.keyframe_from_camera});
    poses_.frame(job.position).keyframe = keyframe->id;
    poses_.frame(job.position).keyframe_from_camera = SE3();
  }
  window_.AddKeyframe(std::move(keyframe));
  window_.ConnectNewest();
  FindCover();
  const std::vector<bool> goes = ChooseMarginalized();
  {
    const Timer timer(this, &statistics_.activate);
    candidates_.Activate(goes);
  }
  {
    const Timer timer(this, &statistics_.optimize);
    window_.Optimize(options_.max_iterations);
  }
  const int newest = window_.size() - 1;
  for (ActivePoint& point : window_.points()) {
    if (point.residuals[newest].state == ResidualState::kGood) ++point.good_residuals;
  }
  PublishPoses();
  SetReference(BuildReference(newest));
  const Timer timer(this, &statistics_.marginalize);
  candidates_.Select(&window_.newest());
  Marginalize(goes);
}

// Keyframes that see too little of the newest, and by the distance score of DSO Sec. 3.1 while the window is too large.
std::vector<bool> Odometry::Impl::ChooseMarginalized() const {
  const int n = window_.size();
  std::vector<bool> goes(n, false);
  const Keyframe& newest = window_.keyframe(n - 1);
  const Pinhole& camera = geometry_.camera[0];
  int left = n;
  for (int k = 0; k < n - 2; ++k) {
    const Keyframe& keyframe = window_.keyframe(k);
    const SE3 newest_from_host = newest.camera_from_direct * keyframe.camera_from_direct.Inverse();
    int all = 0, visible = 0;
    const auto count = [&](float x, float y, float inverse_depth) {
      ++all;
      const Vector3d p = newest_from_host.rotation() * camera.Unproject(Vector2d(x, y)) +
                         static_cast<double>(inverse_depth) * newest_from_host.translation();
      if (p.z() > 1e-3 && camera.Contains(camera.Project(p), 3.0)) ++visible;
    };
    for (const ActivePoint& point : window_.points()) {
      if (point.host == k) count(point.x, point.y, point.inverse_depth);
    }
    for (const SettledPoint& point : keyframe.settled) count(point.x, point.y, point.inverse_depth);
    for (const ImmaturePoint& point : keyframe.immature) {
      if (point.max_inverse_depth > 0.0f) {
        count(point.x, point.y, 0.5f * (point.min_inverse_depth + point.max_inverse_depth));
      }
    }
    const bool unseen = visible < options_.min_visible_share * all || all == 0;
    const bool light = std::abs(newest.light.a - keyframe.light.a) > options_.max_affine_change;
    if ((unseen || light) && left > options_.min_keyframes) {
      goes[k] = true;
      --left;
    }
  }
  while (left > options_.max_keyframes) {
    const auto centre = [&](int k) { return window_.keyframe(k).camera_from_direct.Inverse().translation(); };
    int worst = -1;
    double worst_score = -1.0;
    for (int k = 0; k < n - 2; ++k) {
      if (goes[k]) continue;
      double sum = 0.0;
      for (int j = 0; j < n - 2; ++j) {
        if (j != k && !goes[j]) sum += 1.0 / (1e-5 + (centre(k) - centre(j)).norm());
      }
      const double score = std::sqrt((centre(k) - centre(n - 1)).norm()) * sum;
      if (score > worst_score) worst_score = score, worst = k;
    }
    if (worst < 0) break;
    goes[worst] = true;
    --left;
  }
  return goes;
}

std::shared_ptr<const TrackingReference> Odometry::Impl::BuildReference(int index) {
  const Keyframe& keyframe = window_.keyframe(index);
  auto reference = std::make_shared<TrackingReference>();
  reference->keyframe = keyframe.id;
  reference->light = keyframe.light;
  reference->exposure_gain = keyframe.data->frame.exposure_gain;
  reference->thumbnail = MakeThumbnail(keyframe.data->pyramid, geometry_);
  std::vector<ReferencePoint> points;
  points.reserve(window_.points().size());
  std::vector<PairProjection> to_index(window_.size());
  for (int h = 0; h < window_.size(); ++h) {
    if (h != index) to_index[h] = window_.Projection(h, index);
  }
  for (const ActivePoint& point : window_.points()) {
    const float weight = std::sqrt(1e-3f * std::max(point.hessian, 1e-3f));
    if (point.host == index) {
      points.push_back({point.x, point.y, point.inverse_depth, weight});
      continue;
    }
    if (point.residuals[index].state != ResidualState::kGood) continue;
    float u, v;
    const float z = ProjectInto(to_index[point.host], point.x, point.y, point.inverse_depth, &u, &v);
    if (z >= kMinDepthRatio) points.push_back({u, v, point.inverse_depth / z, weight});
  }
  reference_builder_.BuildReference(keyframe.data->pyramid, points, reference.get());
  return reference;
}

void Odometry::Impl::Marginalize(const std::vector<bool>& goes) {
  window_.MarginalizePoints(goes);
  for (int k = window_.size() - 1; k >= 0; --k) {
    if (!goes[k]) continue;
    {
      std::lock_guard lock(mutex_);
      packets_.push_back(MakePacket(window_.keyframe(k), false));
      KeyframePose& pose = poses_.keyframe(window_.keyframe(k).id);
      pose.direct_from_camera = packets_.back().direct_from_camera;
      pose.still_active = false;
    }
    window_.MarginalizeKeyframe(k);
  }
}

void Odometry::Impl::FlushWindow() {
  last_frame_ = {};
  {
    std::lock_guard lock(mutex_);
    for (int k = 0; k < window_.size(); ++k) {
      packets_.push_back(MakePacket(window_.keyframe(k), false));
      poses_.keyframe(window_.keyframe(k).id).still_active = false;
    }
    references_.clear();
    start_doubted_ = false;
  }
  if (!window_.empty()) ++segment_;
  looks_again_ = false;
  window_.Clear();
  start_.Reset();
  cover_.Reset();
}

}  // namespace cairn::direct
