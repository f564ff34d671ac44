// A large map for measurements, from a small one:
//
//   repeat_map MAP COPIES OUT     OUT is MAP and as many copies of its largest component, each a component of its own
//
// The copies look like other places: each has its own mask over all descriptors, so that within a copy these are as far
// apart as in the original, and between two of them as far as by chance.
#include <cstdlib>
#include <iostream>
#include <map>
#include <string>

#include "base/random.h"
#include "map/edit.h"
#include "place/vocabulary.h"
#include "store/sqlite_map_store.h"

namespace {

using namespace cairn;  // NOLINT

std::shared_ptr<const map::KeyframeFeatures> Masked(const map::KeyframeFeatures& features,
                                                    const image::Descriptor& mask,
                                                    const place::Vocabulary& vocabulary) {
  auto masked = std::make_shared<map::KeyframeFeatures>(features);
  for (std::size_t i = 0; i < masked->features.size(); ++i) {
    image::Descriptor& descriptor = masked->features.descriptors[i];
    for (std::size_t k = 0; k < descriptor.size(); ++k) descriptor[k] ^= mask[k];
    masked->words[i] = vocabulary.Lookup(descriptor);
  }
  return masked;
}

ComponentId Largest(const map::Snapshot& map) {
  ComponentId largest;
  for (const ComponentId id : map.LiveComponents()) {
    if (!largest || map.NumKeyframes(id) > map.NumKeyframes(largest)) largest = id;
  }
  return largest;
}

map::Delta Copy(const std::shared_ptr<const map::Snapshot>& onto, const map::Snapshot& from, ComponentId component,
                const place::Vocabulary& vocabulary, Random& random) {
  image::Descriptor mask;
  for (std::uint64_t& word : mask) word = random.Next();
  map::Edit edit(onto);
  const ComponentId there = edit.AddComponent({.id = {}, .session = from.component(component).session});
  std::map<KeyframeId, KeyframeId> copied;
  from.keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component != component) return;
    map::Keyframe copy = *keyframe;
    copy.component = there;
    copy.features = Masked(*keyframe->features, mask, vocabulary);
    copy.points.clear();
    copy.parent = {};
    copy.children.clear();
    copy.covisible.clear();
    copied[keyframe->id] = edit.AddKeyframe(std::move(copy));
  });
  from.points().ForEach([&](const auto& point) {
    if (!copied.contains(point->observations.front().keyframe)) return;
    const PointId id = edit.AddPoint(point->position);
    for (const map::Observation& seen : point->observations) {
      edit.AddObservation(id, copied.at(seen.keyframe), seen.feature);
    }
  });
  return edit.Finish("a copy");
}

absl::Status Run(const std::string& path, int copies, const std::string& out) {
  CAIRN_ASSIGN_OR_RETURN(const auto source, store::OpenMapStore(path, store::OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(const auto original, source->LoadSnapshot());
  CAIRN_RETURN_IF_ERROR(source->CopyTo(out));
  CAIRN_ASSIGN_OR_RETURN(const std::string bytes, source->LoadVocabulary());
  CAIRN_ASSIGN_OR_RETURN(const place::Vocabulary vocabulary, place::Vocabulary::Parse(bytes));
  CAIRN_ASSIGN_OR_RETURN(const auto target, store::OpenMapStore(out, store::OpenMode::kWrite));
  std::shared_ptr<const map::Snapshot> grown = original;
  Random random(1);
  for (int i = 0; i < copies; ++i) {
    const map::Delta delta = Copy(grown, *original, Largest(*original), vocabulary, random);
    CAIRN_ASSIGN_OR_RETURN(grown, grown->Apply(delta));
    CAIRN_RETURN_IF_ERROR(target->Commit(delta));
  }
  return target->Close();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: repeat_map MAP COPIES OUT\n";
    return 2;
  }
  const absl::Status status = Run(argv[1], std::atoi(argv[2]), argv[3]);
  if (!status.ok()) std::cerr << status.message() << '\n';
  return status.ok() ? 0 : 1;
}
