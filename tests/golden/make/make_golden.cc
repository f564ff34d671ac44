// Writes the golden files of one format, with the store of the commit that it is built in (README.md here tells how):
// keyframes in a rendered room, with ORB features, words, and points at their true places.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>

#include "client/conformance/conformance_map.h"
#include "image/orb_extractor.h"
#include "map/edit.h"
#include "place/training.h"
#include "store/map_file.h"
#include "tracking/projection_matcher.h"

#ifndef GOLDEN_FORMAT
#error "GOLDEN_FORMAT: 1, 2 or 3"
#endif

namespace cairn {

using conformance::LookInRoom;
using conformance::RenderedRoom;

namespace {

template <class T>
T ValueOrFail(absl::StatusOr<T> result) {
  if (!result.ok()) {
    std::cerr << result.status() << "\n";
    std::exit(1);
  }
  return *std::move(result);
}
void OkOrFail(const absl::Status& status) {
  if (!status.ok()) ValueOrFail(absl::StatusOr<int>(status));
}

}  // namespace

const Pinhole kPinhole{480, 360, 350.0, 350.0, 239.5, 179.5};

namespace {

class Maker {
 public:
  Maker(const std::string& path, bool parts) : path_(path), parts_(parts) {
    for (int i = 0; i < 7; ++i) {
      poses_.push_back(LookInRoom({-1.0 + 0.3 * i, 0.1 * std::sin(i), -1.5}, 0.4 * std::sin(0.8 * i)));
    }
    // Looks the other way: shares no point with the others.
    for (int i = 0; parts_ && i < 4; ++i) poses_.push_back(LookInRoom({-0.4 + 0.3 * i, 0.0, 0.5}, M_PI));
    info_.id = "0123456789abcdef0123456789abcde" + std::to_string(GOLDEN_FORMAT + (parts ? 4 : 0));
    info_.name = "golden";
    info_.software_version = "0.1.0";
    info_.orb.num_features = 300;
  }

  void Make() {
    const image::OrbExtractor extractor(info_.orb);
    std::vector<place::ImageDescriptors> descriptors;
    for (const SE3& pose : poses_) {
      features_.push_back(ValueOrFail(extractor.Extract(room_.Render(kPinhole, pose))));
      descriptors.push_back(features_.back().descriptors);
    }
    const place::Vocabulary vocabulary = ValueOrFail(place::Train(descriptors, {.branching = 6, .depth = 3}));
    info_.vocabulary_hash = vocabulary.hash();
    map_ = map::Snapshot::Empty(info_);
    const std::string words = vocabulary.Serialize();
    store::CreateOptions options;
    options.vocabulary = words;
    options.write.record_wall_clock = false;
    file_ = ValueOrFail(store::MapFile::Create(path_, info_, options));
    Begin();
    for (std::size_t i = 0; i < poses_.size(); ++i) AddKeyframe(i, vocabulary);
    End();
    std::cout << path_ << " revision " << map_->revision() << " keyframes " << map_->keyframes().size() << " points "
              << map_->points().size() << " digest " << ValueOrFail(file_->ContentDigest()) << "\n";
    OkOrFail(file_->Close());
  }

 private:
  void Commit(map::Edit* edit, const std::string& reason) {
    const map::Delta delta = edit->Finish(reason);
    map_ = ValueOrFail(map_->Apply(delta));
    OkOrFail(file_->Commit(delta));
  }

  void Begin() {
    map::Edit edit(map_);
    map::MapCamera camera;
    camera.name = "cam0";
    camera.model = Camera::FromPinhole(kPinhole);
    camera.pinhole = kPinhole;
    map::Session session;
    session.camera = edit.AddCamera(camera);
    session.source = "rendered room";
    session.software_version = "0.1.0";
    session.settings_json = "{}";
    edit.AddSession(session);
    Commit(&edit, "start of a session");
  }

  void AddKeyframe(std::size_t i, const place::Vocabulary& vocabulary) {
    map::Edit edit(map_);
    map::Keyframe keyframe;
    keyframe.session = SessionId(1);
    keyframe.camera = CameraId(1);
    keyframe.camera_from_map = poses_[i];
    keyframe.camera_from_direct = poses_[i];
    keyframe.direct_segment = i < 7 ? 0 : 1;
    keyframe.time_ns = static_cast<TimeNs>(i) * 1'000'000'000;
    keyframe.frame_index = static_cast<std::int64_t>(i);
    auto shared = std::make_shared<map::KeyframeFeatures>();
    for (const auto& descriptor : features_[i].descriptors) shared->words.push_back(vocabulary.Lookup(descriptor));
    shared->features = features_[i];
    keyframe.features = shared;
    const KeyframeId id = edit.AddKeyframe(keyframe);
    if (i == 7) edit.LinkIfAlone(id, KeyframeId(7));  // where it lies is a guess
    const image::FeatureGrid grid(shared->features.keypoints, kPinhole.width_px, kPinhole.height_px);
    std::vector<const map::MapPoint*> points;
    std::vector<PointId> ids;
    map_->points().ForEach([&](const auto& point) {
      if ((point->observations.front().keyframe.value() <= 7) != (id.value() <= 7)) return;
      points.push_back(point.get());
      ids.push_back(point->id);
    });
    const auto found = tracking::MatchByProjection({kPinhole, shared->features, grid}, keyframe.camera_from_map, points,
                                                   edit.info().orb, {.radius_factor = 1.5, .max_distance = 60});
    for (const auto& match : found.matches) edit.AddObservation(ids[match.point], id, match.feature);
    const SE3 map_from_camera = keyframe.camera_from_map.Inverse();
    for (std::uint32_t f = 0; f < shared->features.size(); ++f) {
      if (edit.keyframe(id).points[f]) continue;
      const auto& keypoint = shared->features.keypoints[f];
      const Vector3d ray = kPinhole.Unproject({keypoint.x_px, keypoint.y_px});
      edit.AddObservation(
          edit.AddPoint(RenderedRoom::Hit(map_from_camera.translation(), map_from_camera.rotation() * ray)), id, f);
    }
    Commit(&edit, "insert keyframe " + std::to_string(id.value()));
  }

  void End() {
    {
      map::Edit edit(map_);
      map::Session session = map_->sessions().at(SessionId(1));
      session.last_ns = static_cast<TimeNs>(poses_.size()) * 1'000'000'000;
      session.complete = true;
#if GOLDEN_FORMAT >= 2
      session.loops.push_back({KeyframeId(7), 6'000'000'000, KeyframeId(1), 0, 52, 1.0125, 0.25, 0.03, 12.5});
      session.trajectory = map::ReportedTrajectory{true, static_cast<int>(poses_.size()), 2, "a loop was closed"};
#endif
      edit.PutSession(session);
#if GOLDEN_FORMAT >= 3
      map::MapCamera camera = map_->cameras().at(CameraId(1));
      camera.lens = LensCorrection{1.0003, -0.0011, 0.0004};
      edit.PutCamera(camera);
#endif
      Commit(&edit, "end of the session");
    }
    map::Edit edit(map_);
    map::MapInfo info = map_->info();
    info.world_from_map = Sim3(Quaterniond::Identity(), Vector3d(10.0, 0.0, 0.0), 2.0);
    edit.SetInfo(info);
    Commit(&edit, "align to poses.txt");
  }

  std::string path_;
  bool parts_;
  RenderedRoom room_;
  std::vector<SE3> poses_;
  map::MapInfo info_;
  std::vector<image::Features> features_;
  std::shared_ptr<const map::Snapshot> map_;
  std::unique_ptr<store::MapFile> file_;
};

}  // namespace

void MakeGolden(const std::string& path, bool parts) { Maker(path, parts).Make(); }

}  // namespace cairn

int main(int argc, char** argv) {
  const std::string folder = argc > 1 ? argv[1] : ".";
  const std::string name = folder + "/format" + std::to_string(GOLDEN_FORMAT);
  cairn::MakeGolden(name + ".cairn", false);
#if GOLDEN_FORMAT == 3
  cairn::MakeGolden(name + "_parts.cairn", true);
  // A view from between the keyframes, and one of the second part.
  const cairn::RenderedRoom room;
  cv::imwrite(folder + "/query.png", room.Render(cairn::kPinhole, cairn::LookInRoom({0.05, 0.05, -1.35}, 0.1)));
  cv::imwrite(folder + "/query_parts.png", room.Render(cairn::kPinhole, cairn::LookInRoom({0.05, 0.05, 0.4}, M_PI)));
#endif
  return 0;
}
