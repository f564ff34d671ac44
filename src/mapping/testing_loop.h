// A ring-shaped corridor of points with descriptors and a map of it that drifts, keyframe by keyframe: for the tests of
// loop closing, without images.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/alignment.h"
#include "image/testing_descriptors.h"
#include "map/edit.h"
#include "mapping/loop_correction.h"
#include "mapping/testing_head.h"
#include "tracking/testing_world.h"

namespace cairn::mapping::testing {

struct RingOptions {
  double scale_drift = -0.004;  // of the log scale, per keyframe
  double turn_drift_rad = 0.0004;
  double shift_noise = 0.002;  // per keyframe, metres
  bool aliased = false;        // the second half of the ring looks exactly like the first
  int points = 4500;
  double step_deg = 4.0;  // between keyframes
  std::uint64_t seed = 1;
};

class Ring {
 public:
  explicit Ring(const RingOptions& options = {}) : options_(options), random_(options.seed) {
    MakePoints();
    vocabulary_ = tracking::testing_world::TrainVocabulary(world_);
    map::MapInfo info;
    info.id = std::string(32, '2');
    info.vocabulary_hash = vocabulary_->hash();
    const auto empty = map::Snapshot::Empty(info);
    map::Edit edit(empty);
    map::MapCamera camera;
    camera.model = Camera::FromPinhole(tracking::testing_world::kPinhole);
    camera.pinhole = tracking::testing_world::kPinhole;
    camera_ = edit.AddCamera(camera);
    map::Session session;
    session.camera = camera_;
    session_ = edit.AddSession(session);
    head_ = std::make_unique<TestHead>(*empty->Apply(edit.Finish("ring")), vocabulary_.get());
    tracks_.resize(world_.points.size());
  }

  TestHead& head() { return *head_; }
  const std::shared_ptr<const map::Snapshot>& map() const { return head_->map(); }

  // The next keyframe on the way round, where the drifting map believes it to be.
  KeyframeId AddKeyframe() {
    const double angle = options_.step_deg * std::numbers::pi / 180.0 * static_cast<double>(truth_.size());
    const SE3 world_from_camera = PoseAt(angle);
    Drift(world_from_camera);
    truth_.push_back(world_from_camera);
    map::Edit edit(map());
    map::Keyframe keyframe;
    keyframe.session = session_;
    keyframe.camera = camera_;
    keyframe.frame_index = static_cast<std::int64_t>(truth_.size());
    keyframe.time_ns = keyframe.frame_index * 100000000;
    keyframe.camera_from_map = map_from_world_.TransformPose(world_from_camera).Inverse();
    std::vector<std::size_t> point_of_feature;
    keyframe.features = Observe(world_from_camera, angle, &point_of_feature);
    const KeyframeId id = edit.AddKeyframe(keyframe);
    for (std::uint32_t i = 0; i < point_of_feature.size(); ++i) Track(point_of_feature[i], {id, i}, &edit);
    EXPECT_TRUE(head_->Commit(edit.Finish("keyframe"), {}).ok());
    return id;
  }

  // What there is so far is aligned to the world; another session goes on from here.
  void AlignAndBeginSession() {
    map::Edit edit(map());
    map::Component component = edit.component(map()->keyframe(KeyframeId(1)).component);
    component.world_from_component = Sim3();
    edit.PutComponent(component);
    map::Session session = edit.session(session_);
    session_ = edit.AddSession(session);
    EXPECT_TRUE(head_->Commit(edit.Finish("another session"), {}).ok());
  }

  // Continues from where the newest keyframe is in the map by now; lengths around it have grown by `growth`.
  void GoOn(KeyframeId newest, double growth) {
    const SE3 map_from_camera = map()->keyframe(newest).camera_from_map.Inverse();
    const Sim3 scaling(Quaterniond::Identity(), Vector3d::Zero(), map_from_world_.scale() * growth);
    map_from_world_ = Sim3(map_from_camera) * scaling * Sim3(truth_.back().Inverse());
  }

  // Root mean square of the camera centres after Sim(3) alignment, metres.
  double Error() const {
    std::vector<Vector3d> estimated, expected;
    map()->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
      estimated.push_back(keyframe->CenterInMap());
      expected.push_back(truth_[static_cast<std::size_t>(keyframe->frame_index) - 1].translation());
    });
    const auto aligned = AlignPoints(expected, estimated);
    return aligned.ok() ? aligned->rmse : 1e9;
  }

  static SE3 PoseAt(double angle) {
    const Vector3d centre(kRadius * std::sin(angle), 0.1 * std::sin(3.0 * angle), kRadius * std::cos(angle));
    return {ExpSO3(Vector3d(0.0, angle + 0.5 * std::numbers::pi, 0.0)), centre};
  }

 private:
  static constexpr double kRadius = 6.0;

  struct TrackState {
    PointId point;
    map::Observation first;
    std::size_t last_view = 0;
  };

  void MakePoints() {
    const int count = options_.aliased ? options_.points / 2 : options_.points;
    const double arc = options_.aliased ? std::numbers::pi : 2.0 * std::numbers::pi;
    for (int i = 0; i < count; ++i) {
      const double angle = random_.Uniform(0.0, arc);
      const double radius = kRadius + (random_.Below(2) == 0 ? -1.5 : 1.5);
      tracking::testing_world::WorldPoint point;
      point.position = {radius * std::sin(angle), random_.Uniform(-1.5, 1.5), radius * std::cos(angle)};
      point.descriptor = image::testing::RandomDescriptor(random_);
      point.finest_distance = random_.Uniform(3.0, 12.0);
      world_.points.push_back(point);
      angles_.push_back(angle);
      if (!options_.aliased) continue;
      point.position = ExpSO3(Vector3d(0.0, std::numbers::pi, 0.0)) * point.position;
      world_.points.push_back(point);
      angles_.push_back(angle + std::numbers::pi);
    }
  }

  void Drift(const SE3& world_from_camera) {
    if (truth_.empty()) return;
    Vector7d step;
    for (int i = 0; i < 3; ++i) step[i] = options_.shift_noise * random_.Normal();
    step.segment<3>(3) = options_.turn_drift_rad * Vector3d(random_.Normal(), 1.0, random_.Normal());
    step[6] = options_.scale_drift;
    map_from_world_ = map_from_world_ * Sim3(world_from_camera) * Sim3::Exp(step) * Sim3(world_from_camera.Inverse());
  }

  // What is in view and at most 60 degrees further round the ring: the walls hide the rest.
  std::shared_ptr<map::KeyframeFeatures> Observe(const SE3& world_from_camera, double angle,
                                                 std::vector<std::size_t>* point_of_feature) {
    tracking::testing_world::World ahead;
    std::vector<std::size_t> index;
    for (std::size_t i = 0; i < world_.points.size(); ++i) {
      double further = std::fmod(angles_[i] - angle, 2.0 * std::numbers::pi);
      if (further < 0.0) further += 2.0 * std::numbers::pi;
      if (further > std::numbers::pi / 3.0) continue;
      ahead.points.push_back(world_.points[i]);
      index.push_back(i);
    }
    tracking::testing_world::ViewOptions view_options;
    view_options.clutter = 0;
    const auto view =
        tracking::testing_world::Observe(ahead, world_from_camera.Inverse(), map()->info().orb, view_options, random_);
    auto features = std::make_shared<map::KeyframeFeatures>();
    for (const auto& descriptor : view.features.descriptors) features->words.push_back(vocabulary_->Lookup(descriptor));
    features->features = view.features;
    for (const std::int32_t i : view.point_of_feature) {
      point_of_feature->push_back(index[static_cast<std::size_t>(i)]);
    }
    return features;
  }

  // A point that has been out of view for long is a new one: that is what makes a loop.
  void Track(std::size_t world_point, const map::Observation& observation, map::Edit* edit) {
    TrackState& track = tracks_[world_point];
    const std::size_t view = truth_.size();
    const bool gone = track.point && edit->FindPoint(track.point) == nullptr;
    if (track.last_view == 0 || view - track.last_view > 10 || gone) {
      track = {PointId(), observation, view};
      return;
    }
    track.last_view = view;
    if (!track.point) {
      track.point = edit->AddPoint(map_from_world_ * world_.points[world_point].position);
      edit->AddObservation(track.point, track.first.keyframe, track.first.feature);
    }
    edit->AddObservation(track.point, observation.keyframe, observation.feature);
  }

  const RingOptions options_;
  Random random_;
  tracking::testing_world::World world_;
  std::vector<double> angles_;  // of the points, round the ring
  std::shared_ptr<const place::Vocabulary> vocabulary_;
  std::unique_ptr<TestHead> head_;
  CameraId camera_;
  SessionId session_;
  std::vector<SE3> truth_;  // world_from_camera
  std::vector<TrackState> tracks_;
  Sim3 map_from_world_;  // here and now
};

}  // namespace cairn::mapping::testing
