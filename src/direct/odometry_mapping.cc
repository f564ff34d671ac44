// Keyframes: tracing, activation, optimization, marginalization.
#include <algorithm>
#include <cmath>

#include "direct/odometry_impl.h"

namespace cairn::direct {
namespace {

constexpr int kCandidateBorderPx = 4;
constexpr float kMaxActivationIntervalPx = 8.0f;
constexpr double kMaxSpacingPx = 12.0;
constexpr double kPassSpacing[3] = {1.0, 1.5, 2.0};

}  // namespace

SE3 Odometry::Impl::KeyframePoseOf(std::int64_t id) const {
  std::lock_guard lock(mutex_);
  return keyframes_[static_cast<std::size_t>(id)].direct_from_camera;
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
    lost_.push_back({job.frame, job.position});
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
  lost_.clear();
  last_frame_ = {};
  const Frame frame = job.data->frame;
  const std::size_t position = job.position;
  if (job.keyframe) {
    MakeKeyframe(job);
    std::lock_guard lock(mutex_);
    keyframe_queued_ = false;
  } else if (!window_.empty()) {
    const Timer timer(this, &statistics_.trace);
    TraceFrame(*job.data, (KeyframePoseOf(job.reference) * job.keyframe_from_camera).Inverse(), job.light, job.covered);
    last_frame_ = std::move(job);
  }
  DoubtStart(frame, position, true);
  return true;
}

// Whether a candidate is behind an obstacle, where it is expected by what is known of its depth.
bool Odometry::Impl::Hidden(const Pinhole& camera, const PairProjection& pair, const ImmaturePoint& point,
                            const CellSet& covered) const {
  const float inverse_depth = point.max_inverse_depth > 0.0f
                                  ? 0.5f * (point.min_inverse_depth + point.max_inverse_depth)
                                  : point.min_inverse_depth;
  float u, v;
  if (ProjectInto(pair, point.x, point.y, inverse_depth, &u, &v) < kMinDepthRatio) return false;
  return camera.Contains(Vector2d(u, v), 0.0) &&
         (cover_.Covered(u, v) || covered[CellOf(camera, static_cast<double>(u), static_cast<double>(v))]);
}

void Odometry::Impl::TraceFrame(const FrameData& data, const SE3& camera_from_direct, const AffineLight& light,
                                const CellSet& covered) {
  const Pinhole& camera = geometry_.camera[0];
  const bool any = cover_.any() || covered != CellSet{};
  for (int k = 0; k < window_.size(); ++k) {
    Keyframe& host = window_.keyframe(k);
    const double gain =
        ExposureRatio(data.frame.exposure_gain, host.data->frame.exposure_gain) * std::exp(light.a - host.light.a);
    const PairProjection pair = MakePairProjection(
        geometry_.camera[0], camera_from_direct * host.camera_from_direct.Inverse(), gain, light.b, host.light.b);
    for (ImmaturePoint& point : host.immature) {
      if (any && Hidden(camera, pair, point, covered)) continue;
      TracePoint(data.pyramid, pair, trace_options_, &point);
    }
  }
}

void Odometry::Impl::MakeKeyframe(const Job& job) {
  auto keyframe = std::make_unique<Keyframe>();
  keyframe->segment = segment_;
  keyframe->data = job.data;
  keyframe->camera_from_direct = (KeyframePoseOf(job.reference) * job.keyframe_from_camera).Inverse();
  keyframe->light = job.light;
  {
    const Timer timer(this, &statistics_.trace);
    TraceFrame(*job.data, keyframe->camera_from_direct, keyframe->light, job.covered);
  }
  {
    std::lock_guard lock(mutex_);
    keyframe->id = static_cast<std::int64_t>(keyframes_.size());
    const Frame& frame = job.data->frame;
    keyframes_.push_back({keyframe->id, segment_, frame.index, frame.time_ns, keyframe->camera_from_direct.Inverse(),
                          true, job.reference, job.keyframe_from_camera});
    results_[job.position].keyframe = keyframe->id;
    results_[job.position].keyframe_from_camera = SE3();
  }
  window_.AddKeyframe(std::move(keyframe));
  window_.ConnectNewest();
  FindCover();
  const std::vector<bool> goes = ChooseMarginalized();
  {
    const Timer timer(this, &statistics_.activate);
    ActivatePoints(goes);
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
  SelectCandidates(&window_.newest());
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

void Odometry::Impl::ActivatePoints(const std::vector<bool>& goes) {
  // The spacing steers the number of points.
  const auto seen = [n = window_.size() - 1](const ActivePoint& point) {
    return point.residuals[n].state != ResidualState::kCovered;
  };
  const double have = static_cast<double>(std::count_if(window_.points().begin(), window_.points().end(), seen)) /
                      options_.max_active_points;
  const double change = have < 0.66   ? -0.8
                        : have < 0.8  ? -0.5
                        : have < 0.9  ? -0.2
                        : have < 1.0  ? -0.1
                        : have > 1.5  ? 0.8
                        : have > 1.3  ? 0.5
                        : have > 1.15 ? 0.2
                                      : 0.1;
  spacing_px_ = std::clamp(spacing_px_ + 2.0 * change, 0.0, kMaxSpacingPx);

  const int newest = window_.size() - 1;
  const Pinhole& camera = geometry_.camera[0];
  spacing_.Reset(camera.width_px, camera.height_px);
  std::vector<PairProjection> to_newest(window_.size());
  for (int h = 0; h < newest; ++h) to_newest[h] = window_.Projection(h, newest);
  const auto project = [&](int host, float x, float y, float inverse_depth, float* u, float* v) {
    if (ProjectInto(to_newest[host], x, y, inverse_depth, u, v) < kMinDepthRatio) return false;
    return *u > 2.0f && *v > 2.0f && *u < static_cast<float>(camera.width_px - 3) &&
           *v < static_cast<float>(camera.height_px - 3);
  };
  float u, v;
  for (const ActivePoint& point : window_.points()) {
    if (point.host < newest && project(point.host, point.x, point.y, point.inverse_depth, &u, &v)) spacing_.Add(u, v);
  }
  // With only a start's few keyframes one agreeing image must do.
  const int min_good = 1;
  ActivePoint active;
  for (int h = 0; h < newest; ++h) {
    std::vector<ImmaturePoint>& immature = window_.keyframe(h).immature;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < immature.size(); ++i) {
      const ImmaturePoint& point = immature[i];
      if (point.status == TraceStatus::kOutOfImage) continue;  // an outlier twice
      const bool known = point.max_inverse_depth > 0.0f && point.interval_px < kMaxActivationIntervalPx &&
                         point.quality > options_.min_trace_quality && point.status != TraceStatus::kOutlier &&
                         point.status != TraceStatus::kNew;
      const float middle = 0.5f * (point.min_inverse_depth + point.max_inverse_depth);
      bool keep = !goes[h];
      if (known && project(h, point.x, point.y, middle, &u, &v) && !cover_.Covered(u, v) &&
          !spacing_.HasNeighbour(u, v, static_cast<float>(spacing_px_ * kPassSpacing[point.pass]))) {
        keep = false;
        if (window_.RefineCandidate(point, h, options_.min_activation_hessian, min_good, &active)) {
          window_.AddPoint(active);
          ++window_.keyframe(h).points_made;
          spacing_.Add(u, v);
        }
      }
      if (keep) {
        if (kept != i) immature[kept] = immature[i];
        ++kept;
      }
    }
    immature.resize(kept);
  }
}

void Odometry::Impl::SelectCandidates(Keyframe* keyframe) {
  const ImagePyramid& pyramid = keyframe->data->pyramid;
  selector_.Select(pyramid, options_.candidates_per_keyframe, options_.gradient_offset_gray, kCandidateBorderPx,
                   &selected_);
  keyframe->immature.clear();
  keyframe->immature.reserve(selected_.size());
  ImmaturePoint point;
  for (const SelectedPixel& pixel : selected_) {
    if (cover_.Covered(pixel.x, pixel.y)) continue;
    if (!MakeImmaturePoint(pyramid, pixel.x, pixel.y, options_.gradient_constant_gray, options_.outlier_gray, &point))
      continue;
    point.pass = pixel.pass;
    keyframe->immature.push_back(point);
  }
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
      KeyframePose& pose = keyframes_[static_cast<std::size_t>(window_.keyframe(k).id)];
      pose.direct_from_camera = packets_.back().direct_from_camera;
      pose.still_active = false;
    }
    window_.MarginalizeKeyframe(k);
  }
}

// The frames since the last tracked one wait for the next start, before all that were handed over since.
void Odometry::Impl::RequeueLost() {
  std::lock_guard lock(mutex_);
  for (auto it = lost_.rbegin(); it != lost_.rend(); ++it) {
    Job job;
    job.frame = it->frame;
    job.position = it->position;
    jobs_.insert(jobs_.begin(), std::move(job));
    ++untracked_jobs_;
  }
  --untracked_jobs_;  // the frame that gave up is counted and among them
  lost_.clear();
}

void Odometry::Impl::FlushWindow() {
  last_frame_ = {};
  {
    std::lock_guard lock(mutex_);
    for (int k = 0; k < window_.size(); ++k) {
      packets_.push_back(MakePacket(window_.keyframe(k), false));
      keyframes_[static_cast<std::size_t>(window_.keyframe(k).id)].still_active = false;
    }
    references_.clear();
    start_doubted_ = false;
  }
  if (!window_.empty()) ++segment_;
  window_.Clear();
  start_.Reset();
  cover_.Reset();
  clear_reference_ = nullptr;
  retained_.clear();
  start_reference_ = 0;
}

}  // namespace cairn::direct
