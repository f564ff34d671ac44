// The state of Odometry. Files: odometry.cc (interface, results, packets), odometry_tracking.cc (poses of frames),
// odometry_alignment.cc (which motion explains a frame), odometry_mapping.cc (keyframes), odometry_cover.cc
// (obstacles), odometry_start.cc (first keyframes), odometry_confirmation.cc (was the start right),
// odometry_recovery.cc (going on from a known view).
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "base/object_pool.h"
#include "direct/alignment_check.h"
#include "direct/coarse_tracker.h"
#include "direct/cover_mask.h"
#include "direct/feature_start.h"
#include "direct/keyframe.h"
#include "direct/odometry.h"
#include "direct/pixel_selector.h"
#include "direct/point_tracer.h"
#include "direct/spacing_grid.h"
#include "direct/window.h"

namespace cairn::direct {

class Odometry::Impl {
 public:
  Impl(const OdometryOptions& options, const Pinhole& camera);

  absl::StatusOr<FrameResult> Track(const Frame& frame);
  bool OptimizeNext();
  int PendingFrames() const;
  bool AwaitsKeyframe() const {
    std::lock_guard lock(mutex_);
    return keyframe_queued_ && keyframe_awaited_;
  }
  FrameResult Result(std::size_t position) const;
  std::size_t FrameCount() const {
    std::lock_guard lock(mutex_);
    return results_.size();
  }
  std::vector<KeyframePacket> TakePackets();
  absl::StatusOr<KeyframePacket> PacketOf(std::int64_t keyframe) const;
  void Finish();
  absl::Status GoOnFrom(KnownView view);
  PoseHistory Poses() const;
  std::vector<KeyframePose> KeyframeTrajectory() const;
  OdometryStatistics Statistics() const;
  // For tests: what every start passes through before it is used.
  void AlterStarts(std::function<void(StartResult*)> alter) { alter_start_ = std::move(alter); }

 private:
  enum class Mode { kStarting, kTracking };

  struct Job {
    Frame frame;                            // of an untracked frame
    std::shared_ptr<const FrameData> data;  // of a tracked one
    std::size_t position = 0;               // in results_
    bool keyframe = false;
    bool lost = false;                       // its image is kept: a new segment begins with the first lost frame
    bool restart = false;                    // tracking gave up: start a new segment
    std::shared_ptr<const KnownView> known;  // no frame, but where to go on
    std::int64_t reference = -1;
    SE3 keyframe_from_camera;
    AffineLight light;
    CellSet covered = {};  // of the image, by an obstacle
  };

  struct Retained {
    Frame frame;
    std::size_t position = 0;
  };

  // A stage's clock: adds to its statistics when it goes.
  class Timer {
   public:
    Timer(Impl* impl, StageTime* stage) : impl_(impl), stage_(stage), begin_(std::chrono::steady_clock::now()) {}
    ~Timer();

   private:
    Impl* impl_;
    StageTime* stage_;
    std::chrono::steady_clock::time_point begin_;
  };

  // odometry.cc
  absl::Status CheckFrame(const Frame& frame) const;
  std::shared_ptr<FrameData> NewFrameData(const Frame& frame);
  SE3 DirectFromCamera(const FrameResult& result) const;  // mutex_ held
  KeyframePacket MakePacket(const Keyframe& keyframe, bool still_active) const;
  double KeyframeRateHz() const;
  void PublishPoses();  // keyframe poses and packets' order, takes mutex_

  // odometry_tracking.cc
  FrameResult TrackFrame(const Frame& frame, std::size_t position, Job* job);
  void ResetTracking();
  // The newest two frames with a pose in a segment, in the order of time; null where there is none. mutex_ held.
  struct TrackedPair {
    const FrameResult* before = nullptr;
    const FrameResult* last = nullptr;
  };
  TrackedPair LastTracked(std::int64_t segment) const;
  const std::vector<SE3>& Hypotheses(const TrackingReference& reference, TimeNs time_ns, bool wide);
  double MotionSigmaPx() const;
  void LearnPredictionError(const TrackingReference& reference, const SE3& predicted, const SE3& found);
  bool NeedsKeyframe(const TrackingReference& reference, const TrackingOutcome& outcome);

  // odometry_alignment.cc
  // Beyond this uncertainty of the motion (TrackingOutcome::weakest_sigma_px) a frame is carried on by the prediction.
  static constexpr double kCarriedSigmaPx = 4.0;
  bool AlignView(const TrackingReference& reference, const FrameData& data, const std::vector<SE3>& guesses,
                 TrackingOutcome* outcome, CellSet* covered);
  bool AlignBest(const TrackingReference& reference, const FrameData& data, const std::vector<SE3>& guesses,
                 double sigma_px, double expected_rms, TrackingOutcome* best) const;
  bool SearchReferences(std::span<const std::shared_ptr<const TrackingReference>> newest_first, const FrameData& data,
                        TimeNs time_ns, TrackingOutcome* outcome, std::shared_ptr<const TrackingReference>* found);
  TrackingOutcome AlignWithout(const CellSet& cells, const TrackingReference& reference, const FrameData& data,
                               const SE3& guess, const AffineLight& light);
  CellSet AlignUncovered(const TrackingReference& reference, const FrameData& data, TrackingOutcome* outcome);
  bool AlignSeenCells(const TrackingReference& reference, const FrameData& data, std::span<const SE3> guesses,
                      TrackingOutcome* outcome);
  bool Plausible(const TrackingReference& reference, const FrameData& data, const TrackingOutcome& outcome) const;
  AlignmentAgreement Agreement(const TrackingReference& reference, const FrameData& data,
                               const SE3& new_from_reference) const;
  CellSet CoveredCells(const TrackingReference& reference, const FrameData& data, const SE3& new_from_reference) const;
  double Quality(const TrackingOutcome& outcome) const;

  // odometry_mapping.cc
  void TraceFrame(const FrameData& data, const SE3& camera_from_direct, const AffineLight& light,
                  const CellSet& covered);
  bool Hidden(const Pinhole& camera, const PairProjection& pair, const ImmaturePoint& point,
              const CellSet& covered) const;
  void MakeKeyframe(const Job& job);
  void ActivatePoints(const std::vector<bool>& goes);
  std::vector<bool> ChooseMarginalized() const;
  void Marginalize(const std::vector<bool>& goes);
  void SelectCandidates(Keyframe* keyframe);
  std::shared_ptr<const TrackingReference> BuildReference(int index);
  void SetReference(std::shared_ptr<const TrackingReference> reference);
  SE3 KeyframePoseOf(std::int64_t id) const;
  void FlushWindow();
  void RequeueLost();

  // odometry_cover.cc
  void FindCover();

  // odometry_start.cc
  void AddToStart(const Job& job);
  void AdoptStart(const StartResult& start);
  void ThinRetained();
  void InterpolateThinned(std::size_t first, std::size_t last);  // in results_
  bool BuildFirstWindow(const StartResult& start, std::size_t reference_at, std::string* message);
  AffineLight MatchLight(const StartResult& start, const FrameData& reference, const FrameData& view,
                         const SE3& view_from_reference) const;
  void RetrackRetained(const StartResult& start, std::size_t reference_at);
  void StoreRetracked(std::size_t position, std::int64_t keyframe, const SE3& keyframe_from_camera, double quality);

  // odometry_recovery.cc
  std::vector<Retained> WaitingFrames() const;
  void BeginAt(const KnownView& view);
  bool BuildKnownWindow(const Frame& frame, const KnownView& view);
  void TrackBackwards(std::span<const Retained> frames, const TrackingReference& reference);

  // odometry_confirmation.cc
  void DoubtStart(const Frame& frame, std::size_t position, bool tracked);
  bool StartIsWrong(StartResult* better);
  void UndoStart(const StartResult& better);
  void TrustStart();

  const OdometryOptions options_;
  const Pinhole camera_;
  const PyramidGeometry geometry_;
  TraceOptions trace_options_;

  // Shared between Track() and OptimizeNext().
  mutable std::mutex mutex_;
  Mode mode_ = Mode::kStarting;
  std::vector<Job> jobs_;  // few; a deque would allocate for each
  int untracked_jobs_ = 0;
  bool keyframe_queued_ = false;
  bool keyframe_awaited_ = false;  // the last frame sees few points of its reference
  std::vector<FrameResult> results_;
  std::vector<KeyframePose> keyframes_;
  std::vector<std::shared_ptr<const TrackingReference>> references_;  // newest last
  std::deque<KeyframePacket> packets_;
  OdometryStatistics statistics_;
  std::string start_message_ = "waiting for the first frame";
  ObjectPool<FrameData> pool_;
  bool finished_ = false;

  // Tracking; whoever tracks holds track_mutex_.
  mutable std::mutex track_mutex_;
  CoarseTracker tracker_;
  std::int64_t first_rms_reference_ = -1;
  double first_rms_ = 0.0;
  double last_rms_ = 0.0;
  double prediction_variance_px2_ = 0.0;  // of the motion predicted for the last frames, see MotionGuess
  double predicted_steps_ = 1.0;          // time to the frame in units of the time between the two before it
  bool unsure_ = false;                   // lost until now, or after a long gap: what is found must prove itself
  int lost_frames_ = 0;
  int carried_frames_ = 0;  // in a row, until now
  AffineLight last_light_;
  std::vector<SE3> guesses_;     // keeps its memory
  TrackingReference uncovered_;  // likewise
  mutable CellMatcher tracking_matcher_;

  // Mapping only.
  Window window_;
  CoarseTracker reference_builder_;
  PixelSelector selector_;
  SpacingGrid spacing_;
  double spacing_px_ = 4.0;
  std::int64_t segment_ = 0;
  FeatureStart start_;
  std::deque<Retained> retained_;
  Job last_frame_;                   // the last one mapped, if it is no keyframe
  std::deque<Retained> lost_;        // frames since the last tracked one, at most max_lost_frames
  std::size_t start_reference_ = 0;  // in retained_
  int start_frames_ = 0;             // from the reference to the last one of the start
  bool start_doubted_ = false;       // the frames of the start are still kept; packets are held back
  std::function<void(StartResult*)> alter_start_;
  std::vector<SelectedPixel> selected_;
  CoverMask cover_;
  CellMatcher mapping_matcher_;
  std::shared_ptr<const TrackingReference> clear_reference_;  // the last one made before anything was covered
  struct Position {
    float x = -1.0f, y = -1.0f;
  };
  std::vector<Position> positions_;  // of the window's points in the newest keyframe; keeps its memory
  std::vector<PairProjection> to_newest_;
};

}  // namespace cairn::direct
