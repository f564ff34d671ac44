// The pose of every frame: motion hypotheses, loss, and the decision to make a keyframe.
#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/str_format.h"
#include "direct/odometry_impl.h"

namespace cairn::direct {
namespace {

constexpr double kRotationStepRad = 0.02;
constexpr double kMinMotionSigmaPx = 2.0;
constexpr double kPredictionMemory = 0.8;  // weight of what was known of prediction errors before the last frame
constexpr double kFirstPredictionErrorPx = 4.0;
constexpr double kMaxVelocityRatio = 5.0;  // a gap is bridged by at most as many times the last motion
constexpr std::size_t kMaxReferences = 8;  // tried when lost

SE3 PartOf(const SE3& motion, double factor) { return SE3::Exp(factor * motion.Log()); }

}  // namespace

absl::StatusOr<FrameResult> Odometry::Impl::Track(const Frame& frame) {
  const absl::Status status = CheckFrame(frame);
  if (!status.ok()) return status;
  const std::lock_guard track_lock(track_mutex_);
  FrameResult result;
  result.index = frame.index;
  result.time_ns = frame.time_ns;
  std::size_t position;
  bool starting;
  {
    std::lock_guard lock(mutex_);
    if (!options_.keep_history) poses_.ForgetOld();
    position = poses_.AddFrame(result);
    starting = mode_ == Mode::kStarting || untracked_jobs_ > 0;
    if (starting) {
      poses_.frame(position).message = start_message_;
      result.message = start_message_;
      ++untracked_jobs_;
      Job job;
      job.frame = frame;
      job.position = position;
      jobs_.push_back(std::move(job));
    }
  }
  if (starting) return result;
  Job job;
  result = TrackFrame(frame, position, &job);
  std::lock_guard lock(mutex_);
  if (job.data || job.lost) {
    if (job.restart) mode_ = Mode::kStarting, ++untracked_jobs_;
    keyframe_queued_ |= job.keyframe;
    jobs_.push_back(std::move(job));
  }
  return result;
}

void Odometry::Impl::Recent::BeginSegment() {
  lost_frames = carried_frames = 0;
  unsure = false;
  first_rms_reference = -1;
  rms_gray = 0.0;
  prediction_variance_px2 = kFirstPredictionErrorPx * kFirstPredictionErrorPx;
}

// Constant velocity (scaled by the time between the frames), its half and double, no motion, none since the keyframe,
// then small rotations about all of their combinations.
const std::vector<SE3>& Odometry::Impl::Hypotheses(const TrackingReference& reference, TimeNs time_ns, bool wide) {
  std::lock_guard lock(mutex_);
  const KeyframePose& keyframe = poses_.keyframe(reference.keyframe);
  const SE3 reference_from_direct = keyframe.direct_from_camera.Inverse();
  const auto [before, last] = poses_.LastTracked(keyframe.segment);
  std::vector<SE3>& guesses = guesses_;
  guesses.clear();
  recent_.predicted_steps = 1.0;
  if (last != nullptr) {
    const SE3 last_from_reference = (reference_from_direct * poses_.DirectFromCamera(*last)).Inverse();
    SE3 motion;
    if (before != nullptr) {
      const double step_s = ToSeconds(last->time_ns - before->time_ns), now_s = ToSeconds(time_ns - last->time_ns);
      const double ratio = step_s > 0.0 && now_s > 0.0 ? std::min(now_s / step_s, kMaxVelocityRatio) : 1.0;
      recent_.predicted_steps = std::max(1.0, ratio);
      motion = PartOf(poses_.DirectFromCamera(*last).Inverse() * poses_.DirectFromCamera(*before), ratio);
    }
    const SE3 predicted = motion * last_from_reference;
    guesses.push_back(predicted);
    guesses.push_back(PartOf(motion, 0.5) * last_from_reference);
    guesses.push_back(motion * predicted);
    guesses.push_back(last_from_reference);
    guesses.emplace_back();
    const int rings = wide ? 3 : 1;
    for (int ring = 1; ring <= rings; ++ring) {
      for (int code = 0; code < 27; ++code) {
        const int x = code % 3 - 1, y = (code / 3) % 3 - 1, z = code / 9 - 1;
        const Vector3d turn(x, y, z);
        if (turn.squaredNorm() < 0.5) continue;
        const SE3 turned(ExpSO3(kRotationStepRad * ring * turn), Vector3d::Zero());
        guesses.push_back(turned * (wide ? last_from_reference : predicted));
      }
    }
  } else {
    guesses.emplace_back();
  }
  return guesses;
}

// Constant velocity errs by the acceleration: by as much as it erred before, more over a gap.
double Odometry::Impl::MotionSigmaPx() const {
  return recent_.predicted_steps *
         std::max(kMinMotionSigmaPx, options_.motion_sigma_factor * std::sqrt(recent_.prediction_variance_px2));
}

void Odometry::Impl::LearnPredictionError(const TrackingReference& reference, const SE3& predicted, const SE3& found) {
  const Eigen::Matrix<double, 6, 1> error = (found * predicted.Inverse()).Log();
  const double fx_px = geometry_.camera[0].fx_px / recent_.predicted_steps;
  const double squared_px2 =
      fx_px * fx_px *
      (error.tail<3>().squaredNorm() +
       reference.mean_inverse_depth * reference.mean_inverse_depth * error.head<3>().squaredNorm());
  recent_.prediction_variance_px2 =
      kPredictionMemory * recent_.prediction_variance_px2 + (1.0 - kPredictionMemory) * squared_px2;
}

FrameResult Odometry::Impl::TrackFrame(const Frame& frame, std::size_t position, Job* job) {
  const Timer timer(this, &statistics_.track);
  std::shared_ptr<FrameData> data = NewFrameData(frame);
  std::array<std::shared_ptr<const TrackingReference>, kMaxReferences> references;  // newest first
  std::size_t reference_count;
  {
    std::lock_guard lock(mutex_);
    reference_count = references_.size();
    std::copy(references_.rbegin(), references_.rend(), references.begin());
    const std::int64_t segment = poses_.keyframe(references.front()->keyframe).segment;
    const auto [before, last] = poses_.LastTracked(segment);
    recent_.unsure = recent_.lost_frames > 0 ||
                     (before != nullptr &&
                      IsLongGap(ToSeconds(frame.time_ns - last->time_ns), ToSeconds(last->time_ns - before->time_ns)));
  }
  FrameResult result;
  result.index = frame.index;
  result.time_ns = frame.time_ns;
  TrackingOutcome outcome;
  std::shared_ptr<const TrackingReference> reference = references.front();
  const std::vector<SE3>& guesses = Hypotheses(*reference, frame.time_ns, recent_.unsure);
  const SE3 predicted = guesses.front();
  bool found = AlignView(*reference, *data, guesses, &outcome, &job->covered);
  if (found && !recent_.unsure) LearnPredictionError(*reference, predicted, outcome.new_from_reference);
  if (!found)
    found = SearchReferences({references.data(), reference_count}, *data, frame.time_ns, &outcome, &reference);
  if (!found) {
    result.state = TrackingState::kLost;
    ++recent_.lost_frames;
    result.message = absl::StrFormat("lost for %d frames: no motion explains the image", recent_.lost_frames);
    job->lost = true;
    job->frame = frame;
    job->position = position;
    if (recent_.lost_frames >= options_.max_lost_frames) {
      job->restart = true;
      result.message += "; starting anew";
    }
  } else {
    recent_.lost_frames = 0;
    recent_.carried_frames = outcome.weakest_sigma_px > kCarriedSigmaPx ? recent_.carried_frames + 1 : 0;
    if (recent_.carried_frames > 0) result.message = "the image shows too little: carried on by the motion before";
    recent_.light = outcome.light;
    recent_.rms_gray = outcome.rms_gray;
    // What the image leaves open, the prediction decides.
    result.quality = Quality(outcome);
    result.state = StateOf(result.quality);
    result.keyframe = reference->keyframe;
    result.keyframe_from_camera = outcome.new_from_reference.Inverse();
    job->data = data;
    job->position = position;
    job->reference = reference->keyframe;
    job->keyframe_from_camera = result.keyframe_from_camera;
    job->light = outcome.light;
    job->keyframe = NeedsKeyframe(*reference, outcome);
  }
  std::lock_guard lock(mutex_);
  keyframe_awaited_ = found && outcome.visible_share < options_.keyframe_min_tracked_share;
  if (keyframe_queued_) job->keyframe = false;
  result.direct_from_camera = poses_.DirectFromCamera(result);
  if (found) result.segment = poses_.keyframe(result.keyframe).segment;
  poses_.frame(position) = result;
  return result;
}

bool Odometry::Impl::NeedsKeyframe(const TrackingReference& reference, const TrackingOutcome& outcome) {
  if (recent_.first_rms_reference != reference.keyframe) {
    recent_.first_rms_reference = reference.keyframe;
    recent_.first_rms_gray = outcome.rms_gray;
  }
  const double size = geometry_.camera[0].width_px + geometry_.camera[0].height_px;
  constexpr double kPaperSize = 640.0 + 480.0;
  const double flow = options_.keyframe_weight * kPaperSize / size *
                      (options_.keyframe_flow_weight * outcome.translation_flow_px +
                       options_.keyframe_full_flow_weight * outcome.flow_px);
  const double light = options_.keyframe_affine_weight * std::abs(outcome.light.a - reference.light.a);
  return flow + light > 1.0 || outcome.visible_share < options_.keyframe_min_tracked_share ||
         outcome.rms_gray > options_.keyframe_residual_ratio * recent_.first_rms_gray;
}

void Odometry::Impl::SetReference(std::shared_ptr<const TrackingReference> reference) {
  std::lock_guard lock(mutex_);
  references_.push_back(std::move(reference));
  if (references_.size() > kMaxReferences) references_.erase(references_.begin());
}

}  // namespace cairn::direct
