#include "synth/map_copies.h"

#include <algorithm>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/random.h"
#include "health/map_vocabulary.h"
#include "map/snapshot.h"
#include "store/map_store.h"

namespace cairn::synth {
namespace {

// The next free id, which is one further then.
template <class IdType>
IdType Take(IdType* next) {
  return std::exchange(*next, IdType(next->value() + 1));
}

// What is copied, in the order of ids.
struct Original {
  std::vector<std::vector<const map::Keyframe*>> keyframes;  // by component
  std::vector<const map::Component*> components;
  double extent = 0.0;  // of the cameras in frame world, along x
};

Original Sort(const map::Snapshot& map) {
  Original original;
  std::unordered_map<ComponentId, std::size_t> index;
  for (const ComponentId id : map.LiveComponents()) {
    index.emplace(id, original.components.size());
    original.components.push_back(&map.component(id));
  }
  original.keyframes.resize(original.components.size());
  double low = 0.0, high = 0.0;
  map.keyframes().ForEach([&](const auto& keyframe) {
    original.keyframes[index.at(keyframe->component)].push_back(keyframe.get());
    const auto& world_from_map = map.WorldFrom(keyframe->component);
    const double x = (world_from_map ? *world_from_map * keyframe->CenterInMap() : keyframe->CenterInMap()).x();
    low = std::min(low, x), high = std::max(high, x);
  });
  original.extent = high - low;
  return original;
}

class Copier {
 public:
  Copier(std::shared_ptr<const map::Snapshot> map, std::shared_ptr<const place::Vocabulary> vocabulary,
         const MapCopiesOptions& options)
      : map_(std::move(map)),
        vocabulary_(std::move(vocabulary)),
        options_(options),
        random_(options.seed),
        original_(Sort(*map_)) {}

  std::size_t num_components() const { return original_.components.size(); }

  // Copy number `round` of the i-th component, as a change of the map that is being made.
  map::Delta Copy(std::size_t i, int round) {
    map::Delta delta;
    delta.base = revision_++;
    delta.reason = absl::StrCat("copy ", round + 1, " of component ", original_.components[i]->id.value());
    if (delta.base == 0) AddDescription(&delta);
    map::Component component;
    component.id = Take(&next_component_);
    component.session = SessionId(1);
    if (const auto& world = original_.components[i]->world_from_component) {
      const Vector3d shift(2.0 * original_.extent * round, 0.0, 0.0);
      component.world_from_component.emplace(world->rotation(), world->translation() + shift, world->scale());
    }
    image::Descriptor mask{};
    for (std::uint64_t& word : mask) word = round > 0 && options_.other_places ? random_.Next() : 0;
    AddKeyframes(original_.keyframes[i], component.id, mask, round == 0 ? 0.0 : options_.flipped_bits, &delta);
    delta.components.push_back(std::move(component));
    delta.next_keyframe = next_keyframe_;
    delta.next_point = next_point_;
    delta.next_camera = map_->next_camera();
    delta.next_session = SessionId(2);
    delta.next_component = next_component_;
    return delta;
  }

 private:
  void AddDescription(map::Delta* delta) const {
    for (const auto& [id, camera] : map_->cameras()) delta->cameras.push_back(camera);
    map::Session session;
    session.id = SessionId(1);
    session.camera = map_->cameras().begin()->first;
    session.source = absl::StrCat("copies of ", map_->info().name);
    session.complete = true;
    session.result = map::SessionResult::kCreated;
    delta->sessions.push_back(std::move(session));
  }

  void AddKeyframes(const std::vector<const map::Keyframe*>& keyframes, ComponentId component,
                    const image::Descriptor& mask, double flipped_bits, map::Delta* delta) {
    std::unordered_map<KeyframeId, KeyframeId> copy_of;
    for (const map::Keyframe* keyframe : keyframes) copy_of.emplace(keyframe->id, Take(&next_keyframe_));
    std::unordered_map<PointId, std::shared_ptr<map::MapPoint>> points;
    std::vector<std::shared_ptr<map::MapPoint>> in_order;
    for (const map::Keyframe* keyframe : keyframes) {
      auto copy = std::make_shared<map::Keyframe>(*keyframe);
      copy->id = copy_of.at(keyframe->id);
      copy->component = component;
      copy->session = SessionId(1);
      copy->features = Perturbed(*keyframe->features, mask, flipped_bits);
      copy->parent = keyframe->parent ? copy_of.at(keyframe->parent) : KeyframeId();
      for (KeyframeId& child : copy->children) child = copy_of.at(child);
      for (map::CovisibilityEdge& edge : copy->covisible) edge.keyframe = copy_of.at(edge.keyframe);
      for (PointId& id : copy->points) {
        if (!id) continue;
        auto& point = points[id];
        if (point == nullptr) {
          point = std::make_shared<map::MapPoint>(map_->point(id));
          point->id = Take(&next_point_);
          point->reference.keyframe = copy_of.at(point->reference.keyframe);
          for (map::Observation& seen : point->observations) seen.keyframe = copy_of.at(seen.keyframe);
          in_order.push_back(point);
        }
        id = point->id;
      }
      delta->keyframes.push_back(std::move(copy));
    }
    const std::uint32_t first = delta->keyframes.front()->id.value();
    for (const auto& point : in_order) {
      const map::Keyframe& reference = *delta->keyframes[point->reference.keyframe.value() - first];
      point->descriptor = reference.descriptors()[point->reference.feature];
    }
    delta->points.assign(in_order.begin(), in_order.end());
  }

  std::shared_ptr<const map::KeyframeFeatures> Perturbed(const map::KeyframeFeatures& features,
                                                         const image::Descriptor& mask, double flipped_bits) {
    auto perturbed = std::make_shared<map::KeyframeFeatures>(features);
    if (flipped_bits <= 0.0 && mask == image::Descriptor{}) return perturbed;
    const int flips = static_cast<int>(flipped_bits * 8.0 * sizeof(image::Descriptor));
    for (image::Descriptor& descriptor : perturbed->features.descriptors) {
      for (std::size_t i = 0; i < mask.size(); ++i) descriptor[i] ^= mask[i];
      auto* const words = reinterpret_cast<std::uint8_t*>(&descriptor);
      for (int i = 0; i < flips; ++i) {
        const std::uint64_t bit = random_.Below(8 * sizeof(image::Descriptor));
        words[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
      }
    }
    if (!perturbed->words.empty()) perturbed->words = vocabulary_->LookupAll(perturbed->features.descriptors);
    return perturbed;
  }

  const std::shared_ptr<const map::Snapshot> map_;
  const std::shared_ptr<const place::Vocabulary> vocabulary_;
  const MapCopiesOptions options_;
  Random random_;
  const Original original_;
  Revision revision_ = 0;
  KeyframeId next_keyframe_{1};
  PointId next_point_{1};
  ComponentId next_component_{1};
};

}  // namespace

absl::Status MapCopiesOptions::Validate() const {
  if (keyframes < 1) return absl::InvalidArgumentError("copies of a map: keyframes must be at least 1");
  if (!(flipped_bits >= 0.0 && flipped_bits <= 1.0)) {
    return absl::InvalidArgumentError("copies of a map: flipped_bits is a share, from 0 to 1");
  }
  return absl::OkStatus();
}

absl::StatusOr<MapCopies> CopyMap(const MapCopiesOptions& options, const std::string& out,
                                  const std::function<void(std::int64_t)>& progress) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(const auto like, store::OpenMapStore(options.like, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const health::MapVocabulary vocabulary, health::LoadVocabulary(*like));
  CAIRN_ASSIGN_OR_RETURN(const auto map, like->LoadSnapshot());
  if (vocabulary.words == nullptr || map->keyframes().empty()) {
    return absl::InvalidArgumentError(absl::StrCat(options.like, ": it has no keyframes, or no vocabulary"));
  }
  map::MapInfo info = map->info();
  Random random(options.seed);
  info.id = absl::StrCat(absl::Hex(random.Next(), absl::kZeroPad16), absl::Hex(random.Next(), absl::kZeroPad16));
  info.geo_anchor.reset();
  store::CreateOptions create;
  create.overwrite = options.overwrite;
  create.whole = true;
  create.vocabulary = vocabulary.words->Serialize();
  create.write.sync_every_commit = false;
  CAIRN_ASSIGN_OR_RETURN(const auto made, store::CreateMapStore(out, info, create));
  Copier copier(map, vocabulary.words, options);
  MapCopies copies;
  for (int round = 0; copies.keyframes < options.keyframes; ++round) {
    for (std::size_t i = 0; i < copier.num_components() && copies.keyframes < options.keyframes; ++i) {
      const map::Delta delta = copier.Copy(i, round);
      CAIRN_RETURN_IF_ERROR(made->Commit(delta));
      copies.keyframes += static_cast<std::int64_t>(delta.keyframes.size());
      copies.points += static_cast<std::int64_t>(delta.points.size());
      ++copies.components;
      if (progress) progress(copies.keyframes);
    }
  }
  CAIRN_RETURN_IF_ERROR(made->Close());
  return copies;
}

}  // namespace cairn::synth
