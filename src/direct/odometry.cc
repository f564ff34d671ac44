#include "direct/odometry.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "direct/frame_spread.h"
#include "direct/odometry_impl.h"

namespace cairn::direct {
namespace {

WindowOptions MakeWindowOptions(const OdometryOptions& options) {
  WindowOptions window;
  window.huber_gray = options.huber_gray;
  window.outlier_gray = options.outlier_gray;
  window.outlier_median_factor = options.outlier_median_factor;
  window.affine_a_sigma = options.affine_a_sigma;
  window.affine_b_sigma_gray = options.affine_b_sigma_gray;
  window.min_marginalization_hessian = options.min_marginalization_hessian;
  return window;
}

}  // namespace

Odometry::Impl::Timer::~Timer() {
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin_).count();
  std::lock_guard lock(impl_->mutex_);
  stage_->samples_ms.Add(static_cast<float>(ms));
}

Odometry::Impl::Impl(const OdometryOptions& options, const Pinhole& camera)
    : options_(options),
      camera_(camera),
      geometry_(
          PyramidGeometry::Make(camera, options.full_resolution, options.max_pyramid_levels, options.min_level_pixels)),
      tracker_(geometry_, options.huber_gray, options.coarse_cutoff_gray),
      window_(geometry_, MakeWindowOptions(options)),
      reference_builder_(geometry_, options.huber_gray, options.coarse_cutoff_gray),
      cover_(geometry_.camera[0]),
      candidates_(options, geometry_, &window_, &cover_.mask),
      first_window_(options, camera, geometry_, &window_, &candidates_,
                    [this](const Frame& frame) { return NewFrameData(frame); }),
      retained_(options.max_retained_frames),
      start_(options, camera, &retained_, &first_window_),
      confirmation_(&start_.corners()) {}

absl::Status Odometry::Impl::CheckFrame(const Frame& frame) const {
  const auto describe = [](const cv::Mat& image) {
    return absl::StrFormat("%d x %d px with %d channels of OpenCV depth %d", image.cols, image.rows, image.channels(),
                           image.depth());
  };
  if (frame.image.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat("frame %d has an empty image", frame.index));
  }
  const cv::Size size(camera_.width_px, camera_.height_px);
  if (frame.image.size() != size || frame.image.type() != CV_8UC1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the image of frame %d is %s; the camera needs 8-bit gray of %d x %d px", frame.index,
                        describe(frame.image), size.width, size.height));
  }
  if (!frame.corrected.empty() && (frame.corrected.size() != size || frame.corrected.type() != CV_32FC1)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the corrected image of frame %d is %s; the camera needs 32-bit float of %d x %d px",
                        frame.index, describe(frame.corrected), size.width, size.height));
  }
  std::lock_guard lock(mutex_);
  if (finished_) return absl::FailedPreconditionError("the odometry is finished; no more frames");
  if (!poses_.frames().empty() && frame.index <= poses_.frames().back().index) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d comes after frame %d: indices must grow", frame.index, poses_.frames().back().index));
  }
  return absl::OkStatus();
}

// Pyramids are large: one that nobody reads any more is used again.
std::shared_ptr<FrameData> Odometry::Impl::NewFrameData(const Frame& frame) {
  std::shared_ptr<FrameData> data = pool_.Take();
  data->frame = frame;
  const Timer timer(this, &statistics_.pyramid);
  data->pyramid.Build(frame, geometry_);
  return data;
}

FrameResult Odometry::Impl::Result(std::size_t position) const {
  std::lock_guard lock(mutex_);
  FrameResult result = poses_.Composed(position);
  if (result.state == TrackingState::kInitializing) result.message = start_message_;
  return result;
}

// Copied in parts, so that a long history holds nobody up. Frames come first: what they refer to is there when the
// keyframes are copied, unless a start was undone between, which replaces keyframes.
PoseHistory Odometry::Impl::Poses() const {
  constexpr std::size_t kPart = 2048;
  PoseHistory history;
  if (!options_.keep_history) return history;
  for (bool consistent = false; !consistent;) {
    std::size_t count, keyframes;
    std::int64_t undone;
    {
      std::lock_guard lock(mutex_);
      count = poses_.frames().size();
      keyframes = poses_.keyframes().size();
      undone = statistics_.starts_undone;
    }
    history.frames.resize(count);
    for (std::size_t begin = 0; begin < count; begin += kPart) {
      std::lock_guard lock(mutex_);
      const std::size_t end = std::min(begin + kPart, count);
      std::copy(poses_.frames().begin() + static_cast<std::ptrdiff_t>(begin),
                poses_.frames().begin() + static_cast<std::ptrdiff_t>(end),
                history.frames.begin() + static_cast<std::ptrdiff_t>(begin));
    }
    history.keyframes.resize(keyframes + kMaxWindow);  // so that no memory is asked for under the lock
    std::lock_guard lock(mutex_);
    history.keyframes.assign(poses_.keyframes().begin(), poses_.keyframes().end());
    consistent = undone == statistics_.starts_undone;
  }
  for (FrameResult& result : history.frames) {
    SpreadCorrection(history.keyframes, &result);
    if (result.keyframe < 0) continue;
    const KeyframePose& keyframe = history.keyframes[static_cast<std::size_t>(result.keyframe)];
    result.segment = keyframe.segment;
    result.direct_from_camera = keyframe.direct_from_camera * result.keyframe_from_camera;
  }
  return history;
}

std::vector<KeyframePose> Odometry::Impl::KeyframeTrajectory() const {
  if (!options_.keep_history) return {};
  std::lock_guard lock(mutex_);
  return poses_.keyframes();
}

OdometryStatistics Odometry::Impl::Statistics() const {
  std::lock_guard lock(mutex_);
  OdometryStatistics statistics = statistics_;
  statistics.frames = static_cast<std::int64_t>(poses_.end_position());
  statistics.keyframes = poses_.next_keyframe();
  statistics.frames_tracked = poses_.CountTracked();
  return statistics;
}

std::optional<SE3> Odometry::Impl::Motion(const FrameResult& a, const FrameResult& b) const {
  std::lock_guard lock(mutex_);
  if (!poses_.KnowsKeyframe(a.keyframe) || !poses_.KnowsKeyframe(b.keyframe)) return std::nullopt;
  if (poses_.keyframe(a.keyframe).segment != poses_.keyframe(b.keyframe).segment) return std::nullopt;
  return poses_.DirectFromCamera(a).Inverse() * poses_.DirectFromCamera(b);
}

int Odometry::Impl::PendingFrames() const {
  std::lock_guard lock(mutex_);
  return static_cast<int>(jobs_.size());
}

std::vector<KeyframePacket> Odometry::Impl::TakePackets() {
  std::lock_guard lock(mutex_);
  if (start_doubted_) return {};
  std::vector<KeyframePacket> packets(std::make_move_iterator(packets_.begin()),
                                      std::make_move_iterator(packets_.end()));
  packets_.clear();
  return packets;
}

absl::StatusOr<KeyframePacket> Odometry::Impl::PacketOf(std::int64_t keyframe) const {
  std::lock_guard lock(mutex_);
  for (int k = 0; k < window_.size(); ++k) {
    if (window_.keyframe(k).id == keyframe) return MakePacket(window_.keyframe(k), true);
  }
  return absl::NotFoundError(absl::StrFormat("direct keyframe %d is not in the window", keyframe));
}

// Every settled and active point of the window that projects into the keyframe. Call with mutex_ held.
KeyframePacket Odometry::Impl::MakePacket(const Keyframe& keyframe, bool still_active) const {
  KeyframePacket packet;
  packet.keyframe = keyframe.id;
  packet.segment = keyframe.segment;
  packet.frame = keyframe.data->frame;
  packet.direct_from_camera = keyframe.camera_from_direct.Inverse();
  packet.keyframe_rate_hz = poses_.KeyframeRateHz();
  packet.still_active = still_active;
  const Pinhole& camera = geometry_.camera[0];
  const auto add = [&](const SE3& keyframe_from_host, float x, float y, float inverse_depth, float hessian) {
    if (!(hessian > 0.0f) || !(inverse_depth > 0.0f)) return;
    const Vector3d moved = keyframe_from_host.rotation() * camera.Unproject(Vector2d(x, y)) +
                           static_cast<double>(inverse_depth) * keyframe_from_host.translation();
    if (moved.z() < 1e-3) return;
    const Vector2d pixel = camera.Project(moved);
    if (!camera.Contains(pixel, 1.0)) return;
    // Inverse depth in the keyframe is id / z; its derivative by id follows from z = r3 ray + id t3.
    const double ratio = 1.0 / moved.z();
    const double derivative = ratio - inverse_depth * ratio * ratio * keyframe_from_host.translation().z();
    PacketPoint point;
    const double scale = geometry_.half ? 2.0 : 1.0, offset = geometry_.half ? 0.5 : 0.0;
    point.x_px = static_cast<float>(scale * pixel.x() + offset);
    point.y_px = static_cast<float>(scale * pixel.y() + offset);
    point.inverse_depth = static_cast<float>(inverse_depth * ratio);
    point.variance = static_cast<float>(derivative * derivative / static_cast<double>(hessian));
    packet.points.push_back(point);
  };
  for (int h = 0; h < window_.size(); ++h) {
    const Keyframe& host = window_.keyframe(h);
    const SE3 keyframe_from_host =
        &host == &keyframe ? SE3() : keyframe.camera_from_direct * host.camera_from_direct.Inverse();
    for (const SettledPoint& p : host.settled) add(keyframe_from_host, p.x, p.y, p.inverse_depth, p.hessian);
    for (const ActivePoint& p : window_.points()) {
      if (p.host == h) add(keyframe_from_host, p.x, p.y, p.inverse_depth, p.hessian);
    }
  }
  return packet;
}

void Odometry::Impl::PublishPoses() {
  std::lock_guard lock(mutex_);
  for (int k = 0; k < window_.size(); ++k) {
    const Keyframe& keyframe = window_.keyframe(k);
    poses_.keyframe(keyframe.id).direct_from_camera = keyframe.camera_from_direct.Inverse();
  }
}

void Odometry::Impl::Finish() {
  while (OptimizeNext()) {
  }
  // Nothing else would correct the frames since the last keyframe.
  if (last_frame_.data != nullptr && !window_.empty()) MakeKeyframe(std::exchange(last_frame_, {}));
  FlushWindow();
  std::lock_guard lock(mutex_);
  finished_ = true;
}

Odometry::Odometry(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Odometry::~Odometry() = default;

absl::StatusOr<std::unique_ptr<Odometry>> Odometry::Create(const OdometryOptions& options, const Pinhole& camera) {
  const absl::Status status = options.Validate();
  if (!status.ok()) return status;
  if (camera.width_px < 64 || camera.height_px < 48 || !(camera.fx_px > 0.0) || !(camera.fy_px > 0.0)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the odometry needs a camera of at least 64 x 48 px with positive focal lengths, not %d x %d px with "
        "%g and %g px",
        camera.width_px, camera.height_px, camera.fx_px, camera.fy_px));
  }
  return std::unique_ptr<Odometry>(new Odometry(std::make_unique<Impl>(options, camera)));
}

absl::StatusOr<FrameResult> Odometry::Process(const Frame& frame) {
  absl::StatusOr<FrameResult> tracked = impl_->Track(frame);
  if (!tracked.ok()) return tracked;
  const std::size_t position = impl_->FrameCount() - 1;
  while (impl_->OptimizeNext()) {
  }
  return impl_->Result(position);
}

absl::StatusOr<FrameResult> Odometry::Track(const Frame& frame) { return impl_->Track(frame); }
bool Odometry::OptimizeNext() { return impl_->OptimizeNext(); }
int Odometry::PendingFrames() const { return impl_->PendingFrames(); }
bool Odometry::AwaitsKeyframe() const { return impl_->AwaitsKeyframe(); }
std::vector<KeyframePacket> Odometry::TakePackets() { return impl_->TakePackets(); }
absl::StatusOr<KeyframePacket> Odometry::PacketOf(std::int64_t keyframe) const { return impl_->PacketOf(keyframe); }
void Odometry::Finish() { impl_->Finish(); }
absl::Status Odometry::GoOnFrom(KnownView view) { return impl_->GoOnFrom(std::move(view)); }
absl::StatusOr<FrameResult> Odometry::BeginFrom(const Frame& frame, const KnownView& view) {
  return impl_->BeginFrom(frame, view);
}
std::optional<SE3> Odometry::Motion(const FrameResult& a, const FrameResult& b) const { return impl_->Motion(a, b); }
PoseHistory Odometry::Poses() const { return impl_->Poses(); }
std::vector<KeyframePose> Odometry::KeyframeTrajectory() const { return impl_->KeyframeTrajectory(); }
OdometryStatistics Odometry::Statistics() const { return impl_->Statistics(); }

}  // namespace cairn::direct
