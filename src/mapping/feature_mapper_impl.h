// The feature module's state and its stages; private to feature_mapper*.cc. A packet goes through Process(): features
// and depths in feature_mapper.cc, its pose in feature_mapper_tracking.cc, what it changes in the map in
// feature_mapper_map.cc.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "image/orb_extractor.h"
#include "mapping/feature_mapper.h"
#include "mapping/keypoint_depth.h"
#include "mapping/local_mapper.h"
#include "mapping/view_record.h"
#include "tracking/local_map_tracker.h"
#include "tracking/relative_scale.h"
#include "tracking/relocalizer.h"

namespace cairn::mapping {

// Median of 1 / inverse_depth, direct units; 1 if there is none.
double MedianDirectDepth(std::span<const direct::PacketPoint> points);

class FeatureMapper::Impl {
 public:
  Impl(const FeatureMapperOptions& options, MapHead* head, SessionId session, CameraId camera)
      : options_(options),
        head_(head),
        view_(head->View()),
        map_(view_->snapshot()),
        session_(session),
        camera_(camera),
        pinhole_(map_->pinhole(camera)),
        extractor_(map_->info().orb),
        mapper_(options, session,
                [this](const map::Edit& edit, const map::Keyframe& culled, const map::Keyframe& heir) {
                  OnCull(edit, culled, heir);
                }) {}

  absl::StatusOr<KeyframeReport> Process(const direct::KeyframePacket& packet);
  absl::StatusOr<std::optional<Found>> Locate(const direct::Frame& frame) const;
  absl::Status Finish();

  void InsertEach(bool each) { insert_each_ = each; }
  void OnChange(const tracking::MapView& before, const map::Delta& delta,
                const std::shared_ptr<const tracking::MapView>& after, const KeyframeScales& scales);

  void ReviseDirectPoses(const std::unordered_map<std::int64_t, SE3>& poses) { trajectory_.ReviseDirectPoses(poses); }

  const std::shared_ptr<const map::Snapshot>& map() const { return map_; }
  ComponentId component() const { return component_; }
  FeatureState state() const { return state_; }
  const KeyframeTrajectory& trajectory() const { return trajectory_; }
  const std::optional<LensReport>& lens() const { return lens_; }

 private:
  // One packet on its way through.
  struct Current {
    const direct::KeyframePacket& packet;
    std::shared_ptr<map::KeyframeFeatures> features;
    image::FeatureGrid grid;
    std::vector<KeypointDepth> depths;
    int num_depths = 0;
    tracking::TrackedView tracked;
    KeyframeReport report;
  };
  // Where the camera was last, rigidly attached to a keyframe of the map.
  struct Last {
    bool known = false;
    std::int64_t segment = 0;
    SE3 direct_from_camera;
    KeyframeId reference;
    SE3 reference_from_camera;
    std::vector<PointId> points;  // observed there
  };

  absl::Status Check(const direct::KeyframePacket& packet) const;
  absl::Status Extract(Current* current);
  absl::Status Continue(Current* current);
  bool Track(const tracking::PoseSeed& seed, Current* current);
  absl::StatusOr<bool> Relocate(Current* current);
  bool MayGoOnAt(KeyframeId place, const direct::KeyframePacket& packet) const;
  absl::Status Accept(Current* current);
  absl::Status AdjustSession(ComponentId component, const std::vector<KeyframeId>& own);
  absl::Status CullSession();
  bool OwnsCamera() const;
  void CorrectViews();
  absl::Status Lose(const SE3& guess, Current* current);
  absl::Status Start(const SE3& camera_from_map, double map_per_direct, KeyframeId parent, Current* current);
  bool ShouldInsert(const Current& current) const;
  int MaxBetween(double rate_hz) const;
  absl::Status Insert(const SE3& camera_from_map, double map_per_direct, bool points_from_depths, KeyframeId parent,
                      Current* current);
  absl::Status CommitEdit(map::Edit edit, std::string reason);
  void Reattach(KeyframeId gone, const map::Snapshot& before, const map::Snapshot& after);
  double UpdateScale(const Current& current);
  std::vector<double> DepthRatios(const Current& current, std::size_t min_observations) const;
  std::optional<tracking::ScaleMeasurement> MeasureCentres(const Current& current) const;
  void Remember(const SE3& camera_from_map, KeyframeId reference, Current* current);
  void Record(const Current& current, bool refined, double map_per_direct);
  void OnCull(const map::Edit& edit, const map::Keyframe& culled, const map::Keyframe& heir);
  tracking::PoseSeed SeedPose(const direct::KeyframePacket& packet) const;
  std::vector<PointId> SeenLately() const;
  int NumFeatures(double rate_hz) const;

  const FeatureMapperOptions options_;
  MapHead* const head_;
  std::shared_ptr<const tracking::MapView> view_;  // of the head
  std::shared_ptr<const map::Snapshot> map_;       // its map
  const SessionId session_;
  const CameraId camera_;
  const Pinhole pinhole_;
  const image::OrbExtractor extractor_;
  const tracking::Relocalizer relocalizer_;
  ComponentId component_;  // keyframes go there; none: the next one begins it
  LocalMapper mapper_;
  tracking::RelativeScale scale_;
  KeyframeTrajectory trajectory_;
  std::vector<ViewRecord> views_;  // per trajectory entry; empty for keyframes in the map

  std::optional<LensReport> lens_;
  FeatureState state_ = FeatureState::kInitializing;
  Last last_;
  double median_depth_ = 1.0;  // of the scene, map units
  bool insert_each_ = false;
  int since_insertion_ = 0;   // packets
  int inserted_inliers_ = 0;  // of the last keyframe inserted
  int since_depths_ = 0;      // packets since depths gave the relative scale
  int attempts_ = 0;          // packets since the loss
  std::int64_t last_packet_ = -1;
};

}  // namespace cairn::mapping
