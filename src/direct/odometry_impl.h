// The state of Odometry. Files: odometry.cc (interface, packets), odometry_tracking.cc (poses of frames),
// odometry_alignment.cc (which motion explains a frame), odometry_keyframes.cc (what becomes of a frame in the window),
// odometry_cover.cc (obstacles), odometry_segment.cc (what follows from a start), odometry_recovery.cc (going on from a
// known view). What can be read by itself are classes of their own: OdometryStart, StartConfirmation, FirstWindow,
// RetainedFrames, CandidatePoints, PoseTable.
//
// Two locks. track_mutex_: whoever tracks frames holds it all the while, which is Track(), and OptimizeNext() where it
// gives poses to frames that waited. mutex_: what both threads and all readers share, for moments; it is never held
// while track_mutex_ is asked for. Neither is held while keyframes are optimized.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/object_pool.h"
#include "direct/alignment_check.h"
#include "direct/candidate_points.h"
#include "direct/coarse_tracker.h"
#include "direct/corner_witness.h"
#include "direct/cover_mask.h"
#include "direct/first_window.h"
#include "direct/keyframe.h"
#include "direct/odometry.h"
#include "direct/odometry_start.h"
#include "direct/pose_table.h"
#include "direct/retained_frames.h"
#include "direct/start_confirmation.h"
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
    return poses_.end_position();
  }
  std::vector<KeyframePacket> TakePackets();
  absl::StatusOr<KeyframePacket> PacketOf(std::int64_t keyframe) const;
  void Finish();
  absl::Status GoOnFrom(KnownView view);
  absl::StatusOr<FrameResult> BeginFrom(const Frame& frame, const KnownView& view);
  std::optional<SE3> Motion(const FrameResult& a, const FrameResult& b) const;
  PoseHistory Poses() const;
  std::vector<KeyframePose> KeyframeTrajectory() const;
  OdometryStatistics Statistics() const;
  // For tests: what every start passes through before it is used.
  void AlterStarts(std::function<void(StartResult*)> alter) { start_.Alter(std::move(alter)); }

 private:
  enum class Mode { kStarting, kTracking };

  struct Job {
    Frame frame;                            // of an untracked frame
    std::shared_ptr<const FrameData> data;  // of a tracked one
    std::size_t position = 0;               // in poses_
    bool keyframe = false;
    bool lost = false;                       // its image is kept: a new segment begins with the first lost frame
    bool restart = false;                    // tracking gave up: start a new segment
    std::shared_ptr<const KnownView> known;  // no frame, but where to go on
    std::int64_t reference = -1;
    SE3 keyframe_from_camera;
    AffineLight light;
    CellSet covered = {};  // of the image, by an obstacle
  };

  // What the last frames tell about the next one.
  struct Recent {
    std::int64_t first_rms_reference = -1;
    double first_rms_gray = 0.0;  // of the first frame tracked against that reference
    double rms_gray = 0.0;
    double prediction_variance_px2 = 0.0;  // of the motion predicted for the last frames, see MotionGuess
    double predicted_steps = 1.0;          // time to the frame in units of the time between the two before it
    bool unsure = false;                   // lost until now, or after a long gap: what is found must prove itself
    int lost_frames = 0;
    int carried_frames = 0;  // in a row, until now
    AffineLight light;       // of the last frame with a pose, also of a segment before
    void BeginSegment();     // nothing is known of motion and residuals
  };

  // What stands before the view, and what it is found out with.
  struct Cover {
    struct Position {
      float x = -1.0f, y = -1.0f;
    };
    explicit Cover(const Pinhole& camera) : mask(camera) {}
    void Reset() { mask.Reset(), clear_reference = nullptr; }

    CoverMask mask;
    CellMatcher matcher;
    std::shared_ptr<const TrackingReference> clear_reference;  // the last one made before anything was covered
    std::vector<Position> positions;        // of the window's points in the newest keyframe; keeps its memory
    std::vector<PairProjection> to_newest;  // likewise
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
  KeyframePacket MakePacket(const Keyframe& keyframe, bool still_active) const;  // mutex_ held
  void PublishPoses();  // of the window's keyframes; takes mutex_

  // odometry_tracking.cc
  FrameResult TrackFrame(const Frame& frame, std::size_t position, Job* job);
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
  double Fit(const TrackingOutcome& outcome) const;
  double Quality(const TrackingOutcome& outcome) const;

  // odometry_keyframes.cc
  void MakeKeyframe(const Job& job);
  std::vector<bool> ChooseMarginalized() const;
  void Marginalize(const std::vector<bool>& goes);
  std::shared_ptr<const TrackingReference> BuildReference(int index);
  void SetReference(std::shared_ptr<const TrackingReference> reference);
  SE3 KeyframePoseOf(std::int64_t id) const;
  void FlushWindow();

  // odometry_cover.cc
  void FindCover();

  // odometry_segment.cc
  SegmentNumbers NextNumbers() const;
  void AddToStart(const Job& job);
  void AdoptStart(const StartResult& start);
  void AddFirstKeyframes();
  void RetrackRetained(const StartResult& start);
  SE3 RetrackOne(const Frame& frame, const TrackingReference& reference, const SE3& guess, double* quality);
  void StoreRetracked(std::size_t position, std::int64_t keyframe, const SE3& keyframe_from_camera, double quality);
  void DoubtStart(const Frame& frame, std::size_t position, bool tracked);
  std::vector<std::optional<SE3>> PosesSinceReference() const;
  void UndoStart(const StartResult& better);
  void LookAgain();
  void DoubtAgain();
  void TrustStart();

  // odometry_recovery.cc
  std::vector<RetainedFrame> WaitingFrames() const;
  void BeginAt(const KnownView& view);
  void BeginSegmentAt(const RetainedFrame& here, std::span<const RetainedFrame> before, const SegmentNumbers& numbers);
  void TrackBackwards(std::span<const RetainedFrame> frames, const TrackingReference& reference,
                      CornerWitness* witness);
  void RequeueLost();

  const OdometryOptions options_;
  const Pinhole camera_;
  const PyramidGeometry geometry_;

  // Shared between Track(), OptimizeNext() and whoever reads; mutex_ held.
  mutable std::mutex mutex_;
  Mode mode_ = Mode::kStarting;
  std::vector<Job> jobs_;  // few; a deque would allocate for each
  int untracked_jobs_ = 0;
  bool keyframe_queued_ = false;
  bool keyframe_awaited_ = false;  // the last frame sees few points of its reference
  // The frames of the start are still kept; packets are held back. Written, under the lock, where OptimizeNext() runs,
  // and read there without.
  bool start_doubted_ = false;
  bool finished_ = false;
  PoseTable poses_;
  std::vector<std::shared_ptr<const TrackingReference>> references_;  // newest last
  std::deque<KeyframePacket> packets_;
  OdometryStatistics statistics_;
  std::string start_message_ = "waiting for the first frame";

  ObjectPool<FrameData> pool_;  // has a lock of its own

  // Tracking; track_mutex_ held.
  mutable std::mutex track_mutex_;
  CoarseTracker tracker_;
  Recent recent_;
  std::vector<SE3> guesses_;     // keeps its memory
  TrackingReference uncovered_;  // likewise
  mutable CellMatcher tracking_matcher_;

  // Of OptimizeNext() and Finish(), which run in one thread at a time; no lock.
  Window window_;
  CoarseTracker reference_builder_;
  Cover cover_;
  CandidatePoints candidates_;
  FirstWindow first_window_;
  RetainedFrames retained_;
  OdometryStart start_;
  StartConfirmation confirmation_;
  bool looks_again_ = false;  // for corners to prove a start by that nothing has proven yet
  int contradictions_ = 0;    // in a row, that were found in this way
  std::int64_t segment_ = 0;
  Job last_frame_;  // the last one tracked and traced, if it is no keyframe
};

}  // namespace cairn::direct
