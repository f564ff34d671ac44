// From two-view geometry to the first window of keyframes, and the poses of the frames that waited for it.
#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"
#include "direct/odometry_impl.h"
#include "geometry/pose_spread.h"

namespace cairn::direct {
namespace {

constexpr int kMaxTraceViews = 16;
constexpr int kFirstOptimizationIterations = 25;
constexpr int kMinFirstPoints = 100;
constexpr double kMaxFirstRmsGray = 9.0;
constexpr double kInterpolatedQuality = 0.3;

}  // namespace

void Odometry::Impl::AddToStart(const Job& job) {
  StartResult start;
  {
    const Timer timer(this, &statistics_.start);
    start = start_.Add(job.frame);
    retained_.push_back({job.frame, job.position});
    if (start.new_reference || start_.FrameCount() == 0) start_reference_ = retained_.size() - 1;
    while (start_reference_ > static_cast<std::size_t>(options_.max_retained_frames)) ThinRetained();
    if (start.success) {
      if (alter_start_) alter_start_(&start);
      std::string message;
      if (!BuildFirstWindow(start, start_reference_, &message)) {
        start.success = false;
        start.message = message;
        window_.Clear();
        start_.Reset();
        start_.Add(job.frame);
        start_reference_ = retained_.size() - 1;
      }
    }
  }
  if (!start.success) {
    std::lock_guard lock(mutex_);
    start_message_ = start.message;
    results_[job.position].message = start.message;
    return;
  }
  const std::lock_guard track_lock(track_mutex_);
  AdoptStart(start);
}

// The first window stands: poses for the frames that waited. track_mutex_ held.
void Odometry::Impl::AdoptStart(const StartResult& start) {
  ResetTracking();
  RetrackRetained(start, start_reference_);
  InterpolateThinned(retained_.front().position, retained_[start_reference_].position);
  last_light_ = window_.newest().light;
  start_frames_ = start_.FrameCount();
  std::lock_guard lock(mutex_);
  mode_ = Mode::kTracking;
  start_doubted_ = true;
  // The start needed many pyramids at once, tracking needs few.
  pool_.Trim();
  start_message_.clear();
  ++statistics_.segments;
}

// Of the frames before the reference one goes: where they lie closest in time, so that a long wait keeps the oldest and
// evenly spread others. The frames that went get poses between those of their neighbours after the start.
void Odometry::Impl::ThinRetained() {
  std::size_t goes = 1;
  TimeNs closest = std::numeric_limits<TimeNs>::max();
  for (std::size_t i = 1; i < start_reference_; ++i) {
    const TimeNs between = retained_[i + 1].frame.time_ns - retained_[i - 1].frame.time_ns;
    if (between < closest) closest = between, goes = i;
  }
  retained_.erase(retained_.begin() + static_cast<std::ptrdiff_t>(goes));
  --start_reference_;
}

void Odometry::Impl::InterpolateThinned(std::size_t first, std::size_t last) {
  std::lock_guard lock(mutex_);
  std::size_t before = first;
  for (std::size_t after = first; after <= last; ++after) {
    if (results_[after].keyframe < 0) continue;
    const FrameResult &from = results_[before], &to = results_[after];
    const double step_s = ToSeconds(to.time_ns - from.time_ns);
    for (std::size_t i = before + 1; from.keyframe >= 0 && step_s > 0.0 && i < after; ++i) {
      FrameResult& result = results_[i];
      const double share = ToSeconds(result.time_ns - from.time_ns) / step_s;
      const SE3 pose = Between(DirectFromCamera(from), DirectFromCamera(to), share);
      result.keyframe = to.keyframe;
      result.keyframe_from_camera =
          keyframes_[static_cast<std::size_t>(to.keyframe)].direct_from_camera.Inverse() * pose;
      result.direct_from_camera = pose;
      result.quality = kInterpolatedQuality;
      result.state = TrackingState::kPoor;
      result.message = "between its neighbours: its image was dropped during a long wait for the start";
    }
    before = after;
  }
}

// Gain (beyond that of the exposure times) and offset that take intensities at the corners from the reference to the
// view: matched mean and spread. None where they are known.
AffineLight Odometry::Impl::MatchLight(const StartResult& start, const FrameData& reference, const FrameData& view,
                                       const SE3& view_from_reference) const {
  const LightPrior prior = PriorOf(view.frame, options_.affine_a_sigma, options_.affine_b_sigma_gray);
  if (prior.a > 0.0 && prior.b > 0.0) return {};
  const int level = std::min(2, geometry_.levels - 1);
  const Pinhole& camera = geometry_.camera[level];
  std::vector<double> before, after;
  for (std::size_t i = 0; i < start.reference_px.size(); ++i) {
    const Vector3d ray = camera_.Unproject(start.reference_px[i]);
    const Vector3d moved =
        view_from_reference.rotation() * ray + start.inverse_depth[i] * view_from_reference.translation();
    if (moved.z() < 1e-3) continue;
    const Vector2d a = camera.Project(ray), b = camera.Project(moved);
    if (!camera.Contains(a, 1.0) || !camera.Contains(b, 1.0)) continue;
    before.push_back(reference.pyramid.At(level, static_cast<int>(a.x() + 0.5), static_cast<int>(a.y() + 0.5))[0]);
    after.push_back(view.pyramid.At(level, static_cast<int>(b.x() + 0.5), static_cast<int>(b.y() + 0.5))[0]);
  }
  if (before.size() < 20) return {};
  const auto moments = [](const std::vector<double>& values, double* mean, double* sigma) {
    double sum = 0.0, squares = 0.0;
    for (double value : values) sum += value;
    *mean = sum / static_cast<double>(values.size());
    for (double value : values) squares += (value - *mean) * (value - *mean);
    *sigma = std::sqrt(squares / static_cast<double>(values.size()));
  };
  double mean_before, sigma_before, mean_after, sigma_after;
  moments(before, &mean_before, &sigma_before);
  moments(after, &mean_after, &sigma_after);
  if (sigma_before < 1.0 || sigma_after < 1.0) return {};
  const double gain = std::clamp(sigma_after / sigma_before, 0.5, 2.0);
  const double ratio = ExposureRatio(view.frame.exposure_gain, reference.frame.exposure_gain);
  return {std::log(gain / ratio), mean_after - gain * mean_before};
}

bool Odometry::Impl::BuildFirstWindow(const StartResult& start, std::size_t reference_at, std::string* message) {
  const int count = static_cast<int>(start.camera_from_reference.size());
  // Keyframes: reference, the frame nearest to half of the way, the newest.
  std::vector<int> chosen = {0};
  const double way = start.camera_from_reference.back().Inverse().translation().norm();
  int middle = -1;
  double middle_off = 1e300;
  for (int f = 1; f + 1 < count; ++f) {
    const double off = std::abs(start.camera_from_reference[f].Inverse().translation().norm() - 0.5 * way);
    if (off < middle_off) middle_off = off, middle = f;
  }
  if (middle > 0) chosen.push_back(middle);
  chosen.push_back(count - 1);
  std::vector<int> views;
  const int view_count = std::min(count, kMaxTraceViews);
  for (int i = 0; i < view_count; ++i) views.push_back(view_count > 1 ? (i * (count - 1)) / (view_count - 1) : 0);
  for (int k : chosen) views.push_back(k);
  std::sort(views.begin(), views.end());
  views.erase(std::unique(views.begin(), views.end()), views.end());

  // Pyramids are large: only those of the keyframes are kept, the others are built again when they are traced in.
  std::vector<std::shared_ptr<FrameData>> data;
  std::vector<AffineLight> light;
  const auto build = [&](int view) {
    return NewFrameData(retained_[reference_at + static_cast<std::size_t>(view)].frame);
  };
  for (int v : views) {
    std::shared_ptr<FrameData> view = build(v);
    light.push_back(v == 0 ? AffineLight() : MatchLight(start, *data.front(), *view, start.camera_from_reference[v]));
    const bool keep = std::find(chosen.begin(), chosen.end(), v) != chosen.end();
    data.push_back(keep ? std::move(view) : nullptr);
  }
  std::int64_t next_id;
  {
    std::lock_guard lock(mutex_);
    next_id = static_cast<std::int64_t>(keyframes_.size());
  }
  for (int k : chosen) {
    const std::size_t at = static_cast<std::size_t>(std::find(views.begin(), views.end(), k) - views.begin());
    auto keyframe = std::make_unique<Keyframe>();
    keyframe->id = next_id++;
    keyframe->segment = segment_;
    keyframe->data = data[at];
    keyframe->camera_from_direct = start.camera_from_reference[k];
    keyframe->light = light[at];
    if (k == 0) keyframe->own_prior[6] = 1e10, keyframe->own_prior[7] = 1e6;  // the brightness is relative to this one
    SelectCandidates(keyframe.get());
    // Near views first: the interval narrows as the baseline grows.
    std::vector<std::size_t> order;
    for (std::size_t v = 0; v < views.size(); ++v) {
      if (views[v] != k) order.push_back(v);
    }
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return std::abs(views[a] - k) < std::abs(views[b] - k); });
    for (std::size_t v : order) {
      const std::shared_ptr<const FrameData> view = data[v] ? data[v] : build(views[v]);
      const PairProjection pair = MakePairProjection(
          geometry_.camera[0], start.camera_from_reference[views[v]] * keyframe->camera_from_direct.Inverse(),
          ExposureRatio(view->frame.exposure_gain, keyframe->data->frame.exposure_gain) *
              std::exp(light[v].a - keyframe->light.a),
          light[v].b, keyframe->light.b);
      for (ImmaturePoint& point : keyframe->immature) TracePoint(view->pyramid, pair, trace_options_, &point);
    }
    window_.AddKeyframe(std::move(keyframe));
  }
  spacing_px_ = 4.0;
  ActivatePoints(std::vector<bool>(chosen.size(), false));
  const OptimizationReport report = window_.Optimize(kFirstOptimizationIterations);
  if (static_cast<int>(window_.points().size()) < kMinFirstPoints) {
    *message = absl::StrFormat("only %d points have a depth after the first reconstruction, %d are needed",
                               window_.points().size(), kMinFirstPoints);
    return false;
  }
  if (report.rms_gray > kMaxFirstRmsGray || report.residuals < static_cast<int>(window_.points().size()) / 2) {
    *message = absl::StrFormat("the first reconstruction does not match the images: %.1f gray levels, at most %.1f",
                               report.rms_gray, kMaxFirstRmsGray);
    return false;
  }
  for (ActivePoint& point : window_.points()) {
    for (int t = 0; t < window_.size(); ++t) point.good_residuals += point.residuals[t].state == ResidualState::kGood;
  }
  {
    std::lock_guard lock(mutex_);
    for (int k = 0; k < window_.size(); ++k) {
      const Keyframe& keyframe = window_.keyframe(k);
      const Frame& frame = keyframe.data->frame;
      keyframes_.push_back(
          {keyframe.id, segment_, frame.index, frame.time_ns, keyframe.camera_from_direct.Inverse(), true});
      if (k == 0) continue;
      // What the frames between are retracked by.
      keyframes_.back().reference = window_.keyframe(k - 1).id;
      keyframes_.back().reference_from_camera =
          window_.keyframe(k - 1).camera_from_direct * keyframe.camera_from_direct.Inverse();
    }
  }
  return true;
}

void Odometry::Impl::StoreRetracked(std::size_t position, std::int64_t keyframe, const SE3& keyframe_from_camera,
                                    double quality) {
  std::lock_guard lock(mutex_);
  FrameResult& result = results_[position];
  result.keyframe = keyframe;
  result.keyframe_from_camera = keyframe_from_camera;
  result.direct_from_camera = DirectFromCamera(result);
  result.quality = quality;
  result.state = quality >= 0.6 ? TrackingState::kGood : TrackingState::kPoor;
  result.message.clear();
}

void Odometry::Impl::RetrackRetained(const StartResult& start, std::size_t reference_at) {
  {
    std::lock_guard lock(mutex_);
    references_.clear();
  }
  std::vector<std::shared_ptr<const TrackingReference>> references;
  std::vector<std::size_t> at;  // of the keyframes, in retained_
  for (int k = 0; k < window_.size(); ++k) {
    references.push_back(BuildReference(k));
    for (std::size_t i = 0; i < retained_.size(); ++i) {
      if (retained_[i].frame.index == window_.keyframe(k).data->frame.index) at.push_back(i);
    }
    SetReference(references.back());
    StoreRetracked(retained_[at.back()].position, window_.keyframe(k).id, SE3(), 1.0);
  }
  const double never[kMaxLevels] = {};
  double rms[kMaxLevels] = {};
  // Between the keyframes: from the adjusted pose, against the nearest keyframe.
  for (std::size_t i = reference_at; i < retained_.size(); ++i) {
    if (std::find(at.begin(), at.end(), i) != at.end()) continue;
    std::size_t nearest = 0;
    for (std::size_t k = 1; k < at.size(); ++k) {
      const auto distance = [&](std::size_t other) { return i > at[other] ? i - at[other] : at[other] - i; };
      if (distance(k) < distance(nearest)) nearest = k;
    }
    const auto adjusted = [&](std::size_t frame) { return start.camera_from_reference[frame - reference_at]; };
    const SE3 guess = adjusted(i) * adjusted(at[nearest]).Inverse();
    const std::shared_ptr<FrameData> data = NewFrameData(retained_[i].frame);
    const TrackingReference& reference = *references[nearest];
    const TrackingOutcome outcome =
        tracker_.Align(reference, *data, {guess}, reference.light,
                       PriorOf(data->frame, options_.affine_a_sigma, options_.affine_b_sigma_gray), never, rms);
    const bool good = Plausible(reference, *data, outcome);
    // All hang on the keyframe before them, so that they follow both (direct/frame_spread.h).
    std::size_t before = nearest;
    SE3 pose = (good ? outcome.new_from_reference : guess).Inverse();
    if (at[nearest] > i && nearest > 0) {
      before = nearest - 1;
      pose = window_.keyframe(static_cast<int>(before)).camera_from_direct *
             window_.keyframe(static_cast<int>(nearest)).camera_from_direct.Inverse() * pose;
    }
    StoreRetracked(retained_[i].position, references[before]->keyframe, pose,
                   good ? Quality(outcome) : kInterpolatedQuality);
  }
  const std::vector<Retained> before(retained_.begin(), retained_.begin() + static_cast<std::ptrdiff_t>(reference_at));
  TrackBackwards(before, *references.front());
}

}  // namespace cairn::direct
