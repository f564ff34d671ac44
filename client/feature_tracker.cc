// ORB and the local map for every frame, and no odometry: from where the camera would be at constant velocity
// (Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system", T-RO 2015, Sec. V).
#include <algorithm>
#include <utility>

#include "client/frame_tracker.h"

namespace cairn::client {
namespace {

constexpr double kMaxVelocityRatio = 3.0;  // a gap is bridged by at most as many times the last motion

class FeatureTracker : public FrameTracker {
 public:
  explicit FeatureTracker(TrackerContext* context) : context_(*context) {}

  absl::StatusOr<TrackStep> Track(const direct::Frame& frame) override;
  const Anchor* anchor() const override { return anchor_ ? &*anchor_ : nullptr; }
  const absl::Status& following() const override { return following_; }

 private:
  absl::Status FollowMap();
  Sighting MatchAhead(const ImageFeatures& image, TimeNs time_ns);
  absl::StatusOr<Sighting> LookFor(const ImageFeatures& image, bool nearby, TimeNs time_ns);
  void SetAnchor(const direct::Frame& frame, const Sighting& sighting);

  TrackerContext& context_;
  absl::Status following_;
  std::optional<Anchor> anchor_;  // the last frame with a pose
  std::optional<SE3> motion_;     // before_from_last, of the last two frames, ...
  double motion_s_ = 0.0;         // ... and the time between
  LostClock lost_;
  StreamCache cache_;
};

absl::Status FeatureTracker::FollowMap() {
  if (!context_.watch->Busy()) {
    WatchJob job;
    job.retired = std::move(context_.retired);
    context_.watch->Give(std::move(job));
  }
  const std::optional<WatchAnswer> answer = context_.watch->Take();
  if (!answer) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(answer->status);
  following_ = answer->following;
  if (answer->view == context_.view) return absl::OkStatus();
  if (anchor_) {
    double ratio = 1.0;
    anchor_ = MoveAnchor(*anchor_, context_.view->map(), answer->view->map(), &ratio);
    if (motion_) motion_ = Scaled(*motion_, ratio);
  }
  context_.retired = std::exchange(context_.view, answer->view);
  return absl::OkStatus();
}

// Where the camera would be at constant velocity, if that is known.
Sighting FeatureTracker::MatchAhead(const ImageFeatures& image, TimeNs time_ns) {
  Expectation expected;
  expected.place = anchor_->place;
  if (motion_ && motion_s_ > 0.0) {
    const double ratio = std::min(ToSeconds(time_ns - anchor_->time_ns) / motion_s_, kMaxVelocityRatio);
    expected.place.map_from_camera = anchor_->place.map_from_camera * SE3::Exp(ratio * motion_->Log());
  }
  return context_.matcher->Match(*context_.view, image, expected, &cache_);
}

// Around the last pose, and then, from time to time, anywhere.
absl::StatusOr<Sighting> FeatureTracker::LookFor(const ImageFeatures& image, bool nearby, TimeNs time_ns) {
  Sighting sighting;
  sighting.reason = "not found in the map yet";
  if (nearby) {
    Expectation expected;
    expected.place = anchor_->place;
    expected.after_loss = true;
    sighting = context_.matcher->Match(*context_.view, image, expected);
    if (sighting.found) return sighting;
  }
  if (!lost_.Lost(time_ns)) return sighting;
  if (const auto reason = context_.OutOfTime()) {
    sighting.reason = *reason;
    return sighting;
  }
  return context_.matcher->Find(*context_.view, image);
}

void FeatureTracker::SetAnchor(const direct::Frame& frame, const Sighting& sighting) {
  Anchor anchor;
  anchor.direct.index = frame.index;
  anchor.place = sighting.place;
  context_.calibration.Add(sighting);
  anchor.covariance = context_.calibration.Cover(sighting);
  anchor.time_ns = frame.time_ns;
  anchor.inliers = sighting.inliers;
  anchor.residual_rms = sighting.residual_rms;
  motion_.reset();
  if (anchor_ && anchor_->place.component == anchor.place.component) {
    motion_s_ = ToSeconds(frame.time_ns - anchor_->time_ns);
    if (motion_s_ <= kNearbyS) motion_ = anchor_->place.map_from_camera.Inverse() * anchor.place.map_from_camera;
  }
  anchor_ = std::move(anchor);
}

absl::StatusOr<TrackStep> FeatureTracker::Track(const direct::Frame& frame) {
  CAIRN_RETURN_IF_ERROR(FollowMap());
  const bool nearby = anchor_ && ToSeconds(frame.time_ns - anchor_->time_ns) <= kNearbyS;
  TrackStep step;
  step.state = api::TrackState::kTracked;
  Sighting sighting;
  if (nearby) {
    CAIRN_ASSIGN_OR_RETURN(const ImageFeatures image, context_.matcher->Extract(*context_.view, frame.image, false));
    sighting = MatchAhead(image, frame.time_ns);
  }
  if (!sighting.found) {
    CAIRN_ASSIGN_OR_RETURN(const ImageFeatures image, context_.matcher->Extract(*context_.view, frame.image, true));
    CAIRN_ASSIGN_OR_RETURN(sighting, LookFor(image, nearby, frame.time_ns));
    step.state = api::TrackState::kLocated;
  }
  if (!sighting.found) {
    step.state = api::TrackState::kLost;
    step.reason = sighting.reason;
    return step;
  }
  lost_.Found();
  SetAnchor(frame, sighting);
  step.component = anchor_->place.component;
  step.map_from_camera = anchor_->place.map_from_camera;
  step.covariance = CovarianceOf(*anchor_, step.map_from_camera, {}, context_.options.drift);
  return step;
}

}  // namespace

std::unique_ptr<FrameTracker> MakeFeatureTracker(TrackerContext* context) {
  return std::make_unique<FeatureTracker>(context);
}

}  // namespace cairn::client
