#include "direct/first_window.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "direct/light.h"
#include "direct/point_tracer.h"

namespace cairn::direct {
namespace {

constexpr std::size_t kMaxTraceViews = 16;
constexpr int kFirstOptimizationIterations = 25;
constexpr int kMinFirstPoints = 100;
constexpr double kMaxFirstRmsGray = 9.0;
constexpr double kKnownDepthSigma = 0.01;  // of a known point, relative
constexpr double kViewBorderPx = 4.0;

// The brightness of all others is relative to this one's.
void FixLight(Keyframe* first) { first->own_prior[6] = 1e10, first->own_prior[7] = 1e6; }

// Reference, the frame nearest to half of the way, the newest.
std::vector<std::size_t> ChooseKeyframes(const std::vector<SE3>& camera_from_reference) {
  const std::size_t count = camera_from_reference.size();
  std::vector<std::size_t> chosen = {0};
  const double way = camera_from_reference.back().Inverse().translation().norm();
  std::size_t middle = 0;
  double middle_off = 1e300;
  for (std::size_t f = 1; f + 1 < count; ++f) {
    const double off = std::abs(camera_from_reference[f].Inverse().translation().norm() - 0.5 * way);
    if (off < middle_off) middle_off = off, middle = f;
  }
  if (middle > 0) chosen.push_back(middle);
  chosen.push_back(count - 1);
  return chosen;
}

// The keyframes, and others evenly spread.
std::vector<std::size_t> ChooseViews(std::size_t count, const std::vector<std::size_t>& keyframes) {
  std::vector<std::size_t> chosen = keyframes;
  const std::size_t spread = std::min(count, kMaxTraceViews);
  for (std::size_t i = 0; i < spread; ++i) chosen.push_back(spread > 1 ? (i * (count - 1)) / (spread - 1) : 0);
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  return chosen;
}

std::size_t Distance(std::size_t a, std::size_t b) { return a > b ? a - b : b - a; }

void MeanAndSigma(const std::vector<double>& values, double* mean, double* sigma) {
  double sum = 0.0, squares = 0.0;
  for (double value : values) sum += value;
  *mean = sum / static_cast<double>(values.size());
  for (double value : values) squares += (value - *mean) * (value - *mean);
  *sigma = std::sqrt(squares / static_cast<double>(values.size()));
}

double MedianInverseDepth(const std::vector<PacketPoint>& points) {
  std::vector<float> inverse;
  for (const PacketPoint& point : points) inverse.push_back(point.inverse_depth);
  const auto middle = inverse.begin() + static_cast<std::ptrdiff_t>(inverse.size() / 2);
  std::nth_element(inverse.begin(), middle, inverse.end());
  return *middle;
}

}  // namespace

FirstWindow::FirstWindow(const OdometryOptions& options, const Pinhole& camera, const PyramidGeometry& geometry,
                         Window* window, CandidatePoints* candidates, MakeFrameData make_data)
    : options_(options),
      camera_(camera),
      geometry_(geometry),
      window_(window),
      candidates_(candidates),
      make_data_(std::move(make_data)) {}

absl::Status FirstWindow::FromMotion(const StartResult& start, const RetainedFrames& frames,
                                     const SegmentNumbers& numbers) {
  const std::vector<std::size_t> chosen = ChooseKeyframes(start.camera_from_reference);
  const std::vector<View> views = MakeViews(start, frames, chosen);
  std::int64_t next_id = numbers.keyframe;
  for (std::size_t at : chosen) {
    std::unique_ptr<Keyframe> keyframe = TracedKeyframe(start, frames, views, at);
    keyframe->id = next_id++;
    keyframe->segment = numbers.segment;
    window_->AddKeyframe(std::move(keyframe));
  }
  candidates_->ResetSpacing();
  candidates_->Activate(std::vector<bool>(chosen.size(), false));
  absl::Status status = CheckOptimized(window_->Optimize(kFirstOptimizationIterations));
  if (!status.ok()) {
    window_->Clear();
    return status;
  }
  for (ActivePoint& point : window_->points()) {
    for (int t = 0; t < window_->size(); ++t) point.good_residuals += point.residuals[t].state == ResidualState::kGood;
  }
  return absl::OkStatus();
}

// Pyramids are large: only those of the keyframes are kept, the others are built again when they are traced in.
std::vector<FirstWindow::View> FirstWindow::MakeViews(const StartResult& start, const RetainedFrames& frames,
                                                      const std::vector<std::size_t>& keyframes) const {
  std::vector<View> views;
  for (std::size_t at : ChooseViews(start.camera_from_reference.size(), keyframes)) {
    View view;
    view.at = at;
    std::shared_ptr<FrameData> data = make_data_(frames.SinceReference(at).frame);
    if (at > 0) view.light = MatchLight(start, *views.front().data, *data, start.camera_from_reference[at]);
    if (std::find(keyframes.begin(), keyframes.end(), at) != keyframes.end()) view.data = std::move(data);
    views.push_back(std::move(view));
  }
  return views;
}

// Gain (beyond that of the exposure times) and offset that take intensities at the corners from the reference to the
// view: matched mean and spread. None where they are known.
AffineLight FirstWindow::MatchLight(const StartResult& start, const FrameData& reference, const FrameData& view,
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
  double mean_before, sigma_before, mean_after, sigma_after;
  MeanAndSigma(before, &mean_before, &sigma_before);
  MeanAndSigma(after, &mean_after, &sigma_after);
  if (sigma_before < 1.0 || sigma_after < 1.0) return {};
  const double gain = std::clamp(sigma_after / sigma_before, 0.5, 2.0);
  const double ratio = ExposureRatio(view.frame.exposure_gain, reference.frame.exposure_gain);
  return {std::log(gain / ratio), mean_after - gain * mean_before};
}

// With candidates that are traced in all the other views, near ones first: the interval narrows as the baseline grows.
std::unique_ptr<Keyframe> FirstWindow::TracedKeyframe(const StartResult& start, const RetainedFrames& frames,
                                                      const std::vector<View>& views, std::size_t at) {
  auto keyframe = std::make_unique<Keyframe>();
  std::vector<const View*> others;
  for (const View& view : views) {
    if (view.at != at) {
      others.push_back(&view);
      continue;
    }
    keyframe->data = view.data;
    keyframe->light = view.light;
  }
  keyframe->camera_from_direct = start.camera_from_reference[at];
  if (at == 0) FixLight(keyframe.get());
  candidates_->Select(keyframe.get());
  std::stable_sort(others.begin(), others.end(),
                   [&](const View* a, const View* b) { return Distance(a->at, at) < Distance(b->at, at); });
  for (const View* view : others) {
    const std::shared_ptr<const FrameData> data =
        view->data ? view->data : make_data_(frames.SinceReference(view->at).frame);
    const double gain = ExposureRatio(data->frame.exposure_gain, keyframe->data->frame.exposure_gain) *
                        std::exp(view->light.a - keyframe->light.a);
    const PairProjection pair = MakePairProjection(
        geometry_.camera[0], start.camera_from_reference[view->at] * keyframe->camera_from_direct.Inverse(), gain,
        view->light.b, keyframe->light.b);
    candidates_->TraceOne(data->pyramid, pair, keyframe.get());
  }
  return keyframe;
}

absl::Status FirstWindow::CheckOptimized(const OptimizationReport& report) const {
  const int points = static_cast<int>(window_->points().size());
  if (points < kMinFirstPoints) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "only %d points have a depth after the first reconstruction, %d are needed", points, kMinFirstPoints));
  }
  if (report.rms_gray > kMaxFirstRmsGray || report.residuals < points / 2) {
    return absl::FailedPreconditionError(
        absl::StrFormat("the first reconstruction does not match the images: %.1f gray levels, at most %.1f",
                        report.rms_gray, kMaxFirstRmsGray));
  }
  return absl::OkStatus();
}

bool FirstWindow::FromKnownView(const Frame& frame, const KnownView& view, const SegmentNumbers& numbers) {
  auto keyframe = std::make_unique<Keyframe>();
  keyframe->id = numbers.keyframe;
  keyframe->segment = numbers.segment;
  keyframe->data = make_data_(frame);
  FixLight(keyframe.get());
  candidates_->Select(keyframe.get());
  const ImagePyramid& pyramid = keyframe->data->pyramid;
  const Pinhole& camera = geometry_.camera[0];
  window_->AddKeyframe(std::move(keyframe));
  const double unit = MedianInverseDepth(view.points);
  const double scale = geometry_.half ? 0.5 : 1.0, offset = geometry_.half ? -0.25 : 0.0;
  ImmaturePoint pattern;
  for (const PacketPoint& known : view.points) {
    const int x = static_cast<int>(std::lround(scale * known.x_px + offset));
    const int y = static_cast<int>(std::lround(scale * known.y_px + offset));
    if (!camera.Contains(Vector2d(x, y), kViewBorderPx)) continue;
    if (!MakeImmaturePoint(pyramid, x, y, options_.gradient_constant_gray, options_.outlier_gray, &pattern)) continue;
    ActivePoint point;
    point.x = pattern.x, point.y = pattern.y, point.host = 0;
    std::copy(pattern.color, pattern.color + kPatternSize, point.color);
    std::copy(pattern.weight, pattern.weight + kPatternSize, point.weight);
    point.inverse_depth = static_cast<float>(known.inverse_depth / unit);
    const double sigma = kKnownDepthSigma * point.inverse_depth;
    point.hessian = static_cast<float>(1.0 / (sigma * sigma));
    point.good_residuals = 1;
    window_->AddPoint(point);
    ++window_->newest().points_made;
  }
  if (window_->points().size() < kMinKnownPoints) {
    window_->Clear();
    return false;
  }
  candidates_->ResetSpacing();
  return true;
}

}  // namespace cairn::direct
