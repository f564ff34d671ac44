// Direct tracking of every frame, anchored by matches against the map (client/local_tracker.h).
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>

#include "client/frame_tracker.h"
#include "tracking/relative_scale.h"

namespace cairn::client {
namespace {

// An image whose brightness varies less than this, in gray levels, shows nothing: it is dark, or covered.
constexpr double kBlankGray = 1.0;

bool IsBlank(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0] < kBlankGray;
}

// What a match is expected to differ by in any case, beside what the odometry may have drifted.
constexpr double kSeedDepthShare = 0.0015;
constexpr double kSeedRotationRad = 0.0015;
// While carried: after so many matches that failed the whole map is searched, searches this far apart.
constexpr int kFailuresToSearch = 2;
constexpr double kSearchApartS = 0.5;
constexpr double kSearchEvery = 0.1;  // or this share of the time since the last match
// Per axis, of a camera that is not where it was carried to, and was not found: as much as tracking may jump without
// being lost.
constexpr double kMisplacedDepthShare = 0.25;
constexpr double kMisplacedRad = 0.25;
// A finding in the whole map contradicts what was carried on beyond so many sigmas and this share of the depth, and
// this angle.
constexpr double kContradictionSigmas = 4.0;
constexpr double kContradictionDepthShare = 0.05;
constexpr double kContradictionRad = 0.05;
// To a new anchor that is further off than is usual, in median depths and rad together, poses go over by and by, so
// that nothing that is shown with them jumps: in this time all but 1 / e of the rest of the correction is made.
constexpr double kUsualCorrection = 0.003;
constexpr double kCorrectionS = 0.2;

// What of a correction is left for later.
SE3 BeyondUsual(const SE3& correction, double median_depth) {
  const Vector6d by = correction.Log();
  const double size = std::hypot(by.head<3>().norm() / std::max(median_depth, 1e-9), by.tail<3>().norm());
  return size > kUsualCorrection ? SE3::Exp((1.0 - kUsualCorrection / size) * by) : SE3();
}

Sighting Miss(std::string reason) {
  Sighting miss;
  miss.reason = std::move(reason);
  return miss;
}

class SemiDirectTracker : public FrameTracker {
 public:
  explicit SemiDirectTracker(TrackerContext* context) : context_(*context), drift_(context->options.drift) {}

  absl::StatusOr<TrackStep> Track(const direct::Frame& frame) override;
  const Anchor* anchor() const override { return anchor_ ? &*anchor_ : nullptr; }
  const absl::Status& following() const override { return following_; }

 private:
  struct Doubted {
    direct::FrameResult direct;
    SE3 map_from_camera;
  };

  absl::Status TakeMessage();
  void Adopt(const std::shared_ptr<const tracking::MapView>& view);
  absl::Status Use(const WatchAnswer& answer);
  bool Contradicts(const WatchAnswer& answer);
  void SetAnchor(const direct::FrameResult& direct, const Odometer& odometer, const Sighting& sighting, bool blend);

  // Matched against the map since the last frame without a pose.
  bool Confirmed() const { return anchor_ && anchor_->direct.index > lost_index_; }
  std::optional<SE3> PoseOf(const direct::FrameResult& result) const;
  void Count(const direct::FrameResult& result);
  void Correct(double seconds) { pending_ = SE3::Exp(std::exp(-seconds / kCorrectionS) * pending_.Log()); }
  TrackStep Followed(const direct::FrameResult& result, const SE3& map_from_camera);
  void MatchBeside(const direct::Frame& frame, const direct::FrameResult& result, const SE3& map_from_camera);
  absl::StatusOr<TrackStep> Lost(const direct::Frame& frame, const std::string& why, bool worth_a_look);
  absl::StatusOr<Sighting> LookInCall(const direct::Frame& frame) const;
  void BeginAt(const direct::Frame& frame, const Sighting& sighting);

  TrackerContext& context_;
  const DriftOptions drift_;
  Drift learnt_;
  absl::Status following_;

  std::unique_ptr<DirectFollower> follower_;
  std::int64_t begun_index_ = 0;  // frames of the follower come after it
  tracking::RelativeScale scale_;
  std::optional<Anchor> anchor_;
  std::optional<Doubted> doubted_;
  Odometer odometer_;
  SE3 pending_;                     // a pose by the anchor times this is the pose that is answered
  direct::FrameResult last_;        // the last frame that was followed
  std::optional<TimeNs> posed_ns_;  // the time of the last frame with a pose, ...
  SE3 last_pose_;                   // ... and that pose, in the frame of the anchor's component

  std::int64_t lost_index_ = -1;   // the last frame without a pose
  std::int64_t given_index_ = -1;  // the last frame that was given to be matched, ...
  TimeNs given_ns_ = 0;            // ... and its time
  TimeNs searched_ns_ = 0;         // of the last one that was looked for in the whole map
  int failures_ = 0;               // matches that failed since the last that did not
  bool misplaced_ = false;         // the last did, where the map should be seen (Sighting::misplaced)
  std::string failure_;
  LostClock lost_;
};

absl::StatusOr<TrackStep> SemiDirectTracker::Track(const direct::Frame& frame) {
  const LocalTrackerOptions& options = context_.options;
  if (options.wait_for_matches) context_.watch->Wait();
  CAIRN_RETURN_IF_ERROR(TakeMessage());
  // It tells the odometry nothing, and would cost it, and a relocalization, as much as a place that is not known.
  if (IsBlank(frame.image)) return Lost(frame, "the image is blank", false);
  std::string why = "not found in the map yet";
  direct::FrameResult result;
  if (follower_ != nullptr) {
    absl::StatusOr<direct::FrameResult> tracked = follower_->Track(frame);
    if (tracked.ok()) result = *tracked;
    why = tracked.ok() ? result.message : std::string(tracked.status().message());
    // A fresh one begins where the camera is found again.
    if (!tracked.ok() || follower_->ended()) follower_.reset();
  }
  if (follower_ == nullptr || result.keyframe < 0) return Lost(frame, why, true);
  Count(result);
  std::optional<SE3> pose = PoseOf(result);
  if (!pose) return Lost(frame, "what the camera was matched with is not in the map any more", true);
  MatchBeside(frame, result, *pose);
  if (options.deterministic) {
    CAIRN_RETURN_IF_ERROR(TakeMessage());
    pose = PoseOf(result);
    if (!pose) return Lost(frame, "what the camera was matched with is not in the map any more", true);
  }
  return Followed(result, *pose);
}

TrackStep SemiDirectTracker::Followed(const direct::FrameResult& result, const SE3& map_from_camera) {
  lost_.Found();
  if (posed_ns_) Correct(ToSeconds(result.time_ns - *posed_ns_));
  posed_ns_ = result.time_ns;
  last_pose_ = map_from_camera;
  TrackStep step;
  step.component = anchor_->place.component;
  step.map_from_camera = map_from_camera * pending_;
  MotionSigma motion = SigmaSince(*anchor_, odometer_, drift_, learnt_.factor());
  // What is still to be corrected is an error that is known of.
  const Vector6d pending = (step.map_from_camera.Inverse() * map_from_camera).Log();
  motion.translation = std::hypot(motion.translation, pending.head<3>().norm() / std::sqrt(3.0));
  motion.rotation_rad = std::hypot(motion.rotation_rad, pending.tail<3>().norm() / std::sqrt(3.0));
  if (misplaced_) {  // covered, or somewhere else: nobody knows
    motion.translation = std::hypot(motion.translation, kMisplacedDepthShare * anchor_->place.median_depth);
    motion.rotation_rad = std::hypot(motion.rotation_rad, kMisplacedRad);
  }
  step.covariance = CovarianceOf(*anchor_, step.map_from_camera, motion, drift_);
  step.state = api::TrackState::kTracked;
  const double age_s = ToSeconds(result.time_ns - anchor_->time_ns);
  if (!result.message.empty()) {
    step.reason = result.message;
  } else if (!Confirmed()) {
    step.reason = "found again by the images before the loss, and not matched against the map since";
  } else if (failures_ > 0) {
    step.reason = failure_;
  } else if (age_s > context_.options.max_match_age_s) {
    step.reason = "the last match against the map is too old";
  }
  if (!step.reason.empty()) step.state = api::TrackState::kCarried;
  return step;
}

std::optional<SE3> SemiDirectTracker::PoseOf(const direct::FrameResult& result) const {
  if (!anchor_ || anchor_->direct.keyframe < 0) return std::nullopt;
  const std::optional<SE3> motion = follower_->Motion(anchor_->direct, result);
  if (!motion) return std::nullopt;
  return anchor_->place.map_from_camera * Scaled(*motion, scale_.scale());
}

void SemiDirectTracker::Count(const direct::FrameResult& result) {
  if (const std::optional<SE3> motion = follower_->Motion(last_, result)) {
    odometer_.Add(Scaled(*motion, scale_.scale()), result.message.empty() ? 1.0 : drift_.blind_factor);
  }
  last_ = result;
}

void SemiDirectTracker::MatchBeside(const direct::Frame& frame, const direct::FrameResult& result,
                                    const SE3& map_from_camera) {
  const LocalTrackerOptions& options = context_.options;
  // What ends a loss by itself is not believed for longer than it must.
  const bool due = ToSeconds(frame.time_ns - given_ns_) >= options.match_interval_s || given_index_ <= lost_index_;
  if (!due || context_.watch->Busy()) return;
  given_index_ = frame.index;
  given_ns_ = frame.time_ns;
  WatchJob job;
  job.frame = frame;
  job.direct = result;
  job.odometer = odometer_;
  job.map_per_direct = scale_.scale();
  job.depths = follower_->Depths();
  job.view = context_.view;
  job.retired = std::move(context_.retired);
  const MotionSigma motion = SigmaSince(*anchor_, odometer_, drift_, learnt_.factor());
  Expectation expected;
  expected.place = anchor_->place;
  expected.place.map_from_camera = map_from_camera;
  expected.translation_sigma = std::hypot(motion.translation, kSeedDepthShare * anchor_->place.median_depth);
  expected.rotation_sigma_rad = std::hypot(motion.rotation_rad, kSeedRotationRad);
  expected.cautious = failures_ > 0;
  job.expected = std::move(expected);
  const double since_s = ToSeconds(frame.time_ns - anchor_->time_ns);
  if (failures_ >= kFailuresToSearch &&
      ToSeconds(frame.time_ns - searched_ns_) >= std::max(kSearchApartS, kSearchEvery * since_s)) {
    job.find_anywhere = true;
    searched_ns_ = frame.time_ns;
  }
  context_.watch->Give(std::move(job));
}

absl::Status SemiDirectTracker::TakeMessage() {
  const std::optional<WatchAnswer> answer = context_.watch->Take();
  if (!answer) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(answer->status);
  following_ = answer->following;
  Adopt(answer->view);
  return answer->looked ? Use(*answer) : absl::OkStatus();
}

void SemiDirectTracker::Adopt(const std::shared_ptr<const tracking::MapView>& view) {
  if (view == context_.view) return;
  if (anchor_) {
    double ratio = 1.0;
    std::optional<Anchor> moved = MoveAnchor(*anchor_, context_.view->map(), view->map(), &ratio);
    if (moved) {
      last_pose_ = moved->place.map_from_camera * Scaled(anchor_->place.map_from_camera.Inverse() * last_pose_, ratio);
      pending_ = Scaled(pending_, ratio);
      odometer_.way *= ratio;
      scale_.Rescale(ratio);
    } else {
      posed_ns_.reset();
    }
    anchor_ = std::move(moved);
    doubted_.reset();
  }
  context_.retired = std::exchange(context_.view, view);
}

absl::Status SemiDirectTracker::Use(const WatchAnswer& answer) {
  if (!answer.sighting.found) {
    ++failures_;
    failure_ = answer.sighting.reason;
    misplaced_ = answer.misplaced;
    return absl::OkStatus();
  }
  if (follower_ == nullptr) {
    if (posed_ns_ && answer.frame.time_ns < *posed_ns_) return absl::OkStatus();
    BeginAt(answer.frame, answer.sighting);
    return absl::OkStatus();
  }
  if (answer.direct.keyframe < 0) {  // the odometry was lost in that frame
    BeginAt(answer.frame, answer.sighting);
    return absl::OkStatus();
  }
  if (answer.frame.index < begun_index_) return absl::OkStatus();  // of an odometry before
  if (answer.anywhere && Contradicts(answer)) {
    // The map is not to be seen where the odometry has come to: its motion was none, and it begins anew.
    if (answer.misplaced) {
      BeginAt(answer.frame, answer.sighting);
      return absl::OkStatus();
    }
    ++failures_;
    failure_ = "found elsewhere in the map, which has to be confirmed";
    searched_ns_ = 0;
    return absl::OkStatus();
  }
  Odometer odometer = answer.odometer;
  odometer.way *= answer.unit_ratio;
  SetAnchor(answer.direct, odometer, answer.sighting, !answer.anywhere);
  // After it: the way until there was counted in the scale before.
  if (const auto scale = tracking::ScaleFromDepths(answer.depth_ratios)) scale_.Update(scale, std::nullopt);
  return absl::OkStatus();
}

// A second finding where the first one was, by the motion between, is believed.
bool SemiDirectTracker::Contradicts(const WatchAnswer& answer) {
  const auto differ = [&](const SE3& expected, double translation, double rotation_rad) {
    const SE3 difference = expected.Inverse() * answer.sighting.place.map_from_camera;
    return difference.translation().norm() >
               translation + kContradictionDepthShare * answer.sighting.place.median_depth ||
           AngleRad(difference.rotation()) > rotation_rad + kContradictionRad;
  };
  const std::optional<SE3> carried = PoseOf(answer.direct);
  if (!carried) return false;
  const MotionSigma sigma = SigmaSince(*anchor_, answer.odometer, drift_, learnt_.factor());
  const bool same_component = answer.sighting.place.component == anchor_->place.component;
  if (same_component &&
      !differ(*carried, kContradictionSigmas * sigma.translation, kContradictionSigmas * sigma.rotation_rad)) {
    return false;
  }
  if (doubted_) {
    const std::optional<SE3> motion = follower_->Motion(doubted_->direct, answer.direct);
    if (motion && !differ(doubted_->map_from_camera * Scaled(*motion, scale_.scale()), 0.0, 0.0)) return false;
  }
  doubted_ = Doubted{answer.direct, answer.sighting.place.map_from_camera};
  return true;
}

void SemiDirectTracker::SetAnchor(const direct::FrameResult& direct, const Odometer& odometer, const Sighting& sighting,
                                  bool blend) {
  context_.calibration.Add(sighting);
  Anchor anchor{direct,
                sighting.place,
                context_.calibration.Cover(sighting),
                direct.time_ns,
                sighting.inliers,
                sighting.residual_rms,
                odometer,
                MatchVariance(sighting.inliers, drift_)};
  std::optional<SE3> answered;
  if (blend && Confirmed() && anchor_->place.component == anchor.place.component) {
    answered = PoseOf(last_);
    if (const std::optional<SE3> carried = PoseOf(direct)) {
      learnt_.Learn(Blend(*anchor_, *carried, SigmaSince(*anchor_, odometer, drift_, learnt_.factor()), &anchor));
    }
  }
  anchor_ = std::move(anchor);
  const std::optional<SE3> corrected = answered ? PoseOf(last_) : std::nullopt;
  pending_ = corrected ? BeyondUsual(corrected->Inverse() * *answered * pending_, anchor_->place.median_depth) : SE3();
  failures_ = 0;
  misplaced_ = false;
  doubted_.reset();
}

// The odometry is lost, or there is none.
absl::StatusOr<TrackStep> SemiDirectTracker::Lost(const direct::Frame& frame, const std::string& why,
                                                  bool worth_a_look) {
  TrackStep step;
  step.reason = why;
  lost_index_ = frame.index;
  const bool in_call = context_.options.relocalize_in_call || context_.options.deterministic;
  const bool look = worth_a_look && lost_.Lost(frame.time_ns);
  if (!context_.watch->Busy()) {  // what is looked for, or only whether the map has changed
    WatchJob job;
    job.retired = std::move(context_.retired);
    if (look && !in_call) {
      job.frame = frame;
      job.direct.index = frame.index;
      job.direct.time_ns = frame.time_ns;
      job.find_anywhere = true;
    }
    context_.watch->Give(std::move(job));
    if (context_.options.deterministic) CAIRN_RETURN_IF_ERROR(TakeMessage());
  }
  if (!look || !in_call) return step;
  CAIRN_ASSIGN_OR_RETURN(const Sighting sighting, LookInCall(frame));
  if (!sighting.found) {
    step.reason = absl::StrCat(why, why.empty() ? "" : "; ", "not found in the map: ", sighting.reason);
    return step;
  }
  BeginAt(frame, sighting);
  step.state = api::TrackState::kLocated;
  step.reason.clear();
  step.component = sighting.place.component;
  step.map_from_camera = sighting.place.map_from_camera;
  step.covariance = CovarianceOf(*anchor_, step.map_from_camera, {}, drift_);
  lost_.Found();
  lost_index_ = frame.index - 1;
  return step;
}

// Around the last pose, if it is not long ago, and then anywhere.
absl::StatusOr<Sighting> SemiDirectTracker::LookInCall(const direct::Frame& frame) const {
  if (const auto reason = context_.OutOfTime()) return Miss(*reason);
  CAIRN_ASSIGN_OR_RETURN(const ImageFeatures image, context_.matcher->Extract(*context_.view, frame.image, true));
  if (anchor_ && posed_ns_ && ToSeconds(frame.time_ns - *posed_ns_) <= kNearbyS) {
    Expectation expected;
    expected.place = anchor_->place;
    expected.place.map_from_camera = last_pose_;
    expected.after_loss = true;
    Sighting near = context_.matcher->Match(*context_.view, image, expected);
    if (near.found) return near;
  }
  if (const auto reason = context_.OutOfTime()) return Miss(*reason);
  return context_.matcher->Find(*context_.view, image);
}

// A fresh odometry where the map has been found. If the depths are too few for one, the next frame is looked for again.
void SemiDirectTracker::BeginAt(const direct::Frame& frame, const Sighting& sighting) {
  follower_.reset();
  direct::KnownView view;
  view.frame_index = frame.index;
  view.points = sighting.depths;
  direct::FrameResult begun;
  begun.index = frame.index;
  begun.time_ns = frame.time_ns;
  absl::StatusOr<std::unique_ptr<DirectFollower>> follower = DirectFollower::Begin(
      context_.options.odometry, context_.pinhole, frame, view, !context_.options.deterministic, &begun);
  if (follower.ok()) {
    follower_ = *std::move(follower);
    scale_.Reset(follower_->DirectUnit());
  }
  begun_index_ = frame.index;
  given_index_ = frame.index;
  last_ = begun;
  given_ns_ = posed_ns_.emplace(frame.time_ns);
  last_pose_ = sighting.place.map_from_camera;
  SetAnchor(begun, odometer_, sighting, false);
}

}  // namespace

std::unique_ptr<FrameTracker> MakeSemiDirectTracker(TrackerContext* context) {
  return std::make_unique<SemiDirectTracker>(context);
}

}  // namespace cairn::client
