// What it costs to publish one keyframe, in maps of different sizes: the change made, validated and turned into the
// next view, place index included. The store is none: what the disk takes is measured in src/store.
#include <benchmark/benchmark.h>

#include <map>

#include "base/random.h"
#include "map/edit.h"
#include "place/default_vocabulary.h"
#include "tracking/map_view.h"

namespace cairn::engine {
namespace {

constexpr int kFeatures = 400;
constexpr std::uint32_t kNewPoints = 70;  // per keyframe, seen by the three that follow as well

// A camera that moves along x; words are drawn at random from all.
class Corridor {
 public:
  explicit Corridor(int keyframes) : vocabulary_(Vocabulary()) {
    map::MapInfo info;
    info.id = std::string(32, 'b');
    info.vocabulary_hash = vocabulary_->hash();
    auto map = map::Snapshot::Empty(info);
    map::Edit edit(map);
    const Pinhole pinhole{640, 480, 500.0, 500.0, 319.5, 239.5};
    camera_ = edit.AddCamera({CameraId(), "camera", Camera::FromPinhole(pinhole), pinhole});
    map::Session session;
    session.camera = camera_;
    session_ = edit.AddSession(session);
    component_ = edit.AddComponent({});
    for (int i = 0; i < keyframes; ++i) Add(&edit);
    map = *map->Apply(edit.Finish("corridor"));
    view_ = *tracking::MapView::Create(std::move(map), vocabulary_);
  }

  const std::shared_ptr<const tracking::MapView>& view() const { return view_; }

  map::Delta NextKeyframe() {
    map::Edit edit(view_->snapshot());
    Add(&edit);
    return edit.Finish("insert a keyframe");
  }
  void Publish(const map::Delta& delta) { view_ = *view_->After(delta); }

 private:
  static std::shared_ptr<const place::Vocabulary> Vocabulary() {
    static const auto vocabulary = std::make_shared<const place::Vocabulary>(*place::LoadDefaultVocabulary());
    return vocabulary;
  }

  void Add(map::Edit* edit) {
    auto features = std::make_shared<map::KeyframeFeatures>();
    for (int i = 0; i < kFeatures; ++i) {
      features->features.keypoints.push_back({static_cast<float>(random_.Below(640)),
                                              static_cast<float>(random_.Below(480)), 0.0f,
                                              static_cast<std::uint8_t>(random_.Below(8))});
      features->features.descriptors.push_back({random_.Next(), random_.Next(), random_.Next(), random_.Next()});
      features->words.push_back(static_cast<std::uint32_t>(random_.Below(vocabulary_->num_words())));
    }
    map::Keyframe keyframe;
    keyframe.session = session_;
    keyframe.camera = camera_;
    keyframe.component = component_;
    keyframe.camera_from_map = SE3(Quaterniond::Identity(), Vector3d(-0.1 * count_, 0.0, 0.0));
    keyframe.features = std::move(features);
    const KeyframeId id = edit->AddKeyframe(std::move(keyframe));
    std::uint32_t feature = 0;
    for (const std::vector<PointId>& points : seen_) {
      for (const PointId point : points) edit->AddObservation(point, id, feature++);
    }
    seen_.emplace_back();
    if (seen_.size() > 3) seen_.erase(seen_.begin());
    for (std::uint32_t i = 0; i < kNewPoints; ++i) {
      const PointId point = edit->AddPoint(Vector3d(0.1 * count_ + random_.Normal(), random_.Normal(), 4.0));
      edit->AddObservation(point, id, feature++);
      seen_.back().push_back(point);
    }
    ++count_;
  }

  const std::shared_ptr<const place::Vocabulary> vocabulary_;
  Random random_{7};
  CameraId camera_;
  SessionId session_;
  ComponentId component_;
  std::vector<std::vector<PointId>> seen_;
  int count_ = 0;
  std::shared_ptr<const tracking::MapView> view_;
};

Corridor& CorridorOf(int keyframes) {
  static std::map<int, std::unique_ptr<Corridor>> corridors;
  std::unique_ptr<Corridor>& corridor = corridors[keyframes];
  if (corridor == nullptr) corridor = std::make_unique<Corridor>(keyframes);
  return *corridor;
}

void PublishKeyframe(benchmark::State& state) {
  Corridor& corridor = CorridorOf(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    state.PauseTiming();
    const map::Delta delta = corridor.NextKeyframe();
    state.ResumeTiming();
    corridor.Publish(delta);
  }
}
BENCHMARK(PublishKeyframe)->Arg(1000)->Arg(10000)->Unit(benchmark::kMicrosecond)->Iterations(300);

// With the making of the change: an edit of one keyframe.
void EditAndPublishKeyframe(benchmark::State& state) {
  Corridor& corridor = CorridorOf(static_cast<int>(state.range(0)));
  for (auto _ : state) corridor.Publish(corridor.NextKeyframe());
}
BENCHMARK(EditAndPublishKeyframe)->Arg(1000)->Arg(10000)->Unit(benchmark::kMicrosecond)->Iterations(300);

}  // namespace
}  // namespace cairn::engine
