#include "map/component_assignment.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <unordered_map>
#include <utility>

namespace cairn::map {
namespace {

constexpr std::int64_t kPosesGiven = -1;  // direct_segment of keyframes that no odometry made

// Disjoint sets of the indices of keyframes, each named by its least member.
class Sets {
 public:
  explicit Sets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), std::size_t{0}); }
  std::size_t Find(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void Unite(std::size_t a, std::size_t b) {
    a = Find(a);
    b = Find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::size_t> parent_;
};

Sets LinkedKeyframes(const std::vector<std::shared_ptr<Keyframe>>& keyframes, const std::vector<Session>& sessions) {
  Sets sets(keyframes.size());
  std::unordered_map<KeyframeId, std::size_t> index_of;
  for (std::size_t i = 0; i < keyframes.size(); ++i) index_of[keyframes[i]->id] = i;
  std::unordered_map<PointId, std::size_t> first_observer;
  std::map<std::pair<SessionId, std::int64_t>, std::size_t> last_of_segment;
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    const Keyframe& keyframe = *keyframes[i];
    for (const PointId point : keyframe.points) {
      if (point) sets.Unite(first_observer.emplace(point, i).first->second, i);
    }
    const SessionId odometry = keyframe.direct_segment == kPosesGiven ? SessionId() : keyframe.session;
    const auto before = last_of_segment.emplace(std::pair(odometry, keyframe.direct_segment), i).first;
    sets.Unite(before->second, i);
  }
  for (const Session& session : sessions) {
    for (const ClosedLoop& loop : session.loops) {
      const auto a = index_of.find(loop.keyframe), b = index_of.find(loop.loop_keyframe);
      if (a != index_of.end() && b != index_of.end()) sets.Unite(a->second, b->second);
    }
  }
  return sets;
}

// Keyframes keep only the links to their own component.
void CutLinks(const std::vector<std::shared_ptr<Keyframe>>& keyframes) {
  std::unordered_map<KeyframeId, ComponentId> component_of;
  for (const auto& keyframe : keyframes) component_of[keyframe->id] = keyframe->component;
  for (const auto& keyframe : keyframes) {
    const auto elsewhere = [&](KeyframeId other) {
      const auto found = component_of.find(other);
      return found != component_of.end() && found->second != keyframe->component;
    };
    if (keyframe->parent && elsewhere(keyframe->parent)) keyframe->parent = KeyframeId();
    std::erase_if(keyframe->children, elsewhere);
  }
}

}  // namespace

std::vector<Component> AssignComponents(const std::optional<Sim3>& world_from_map,
                                        const std::vector<std::shared_ptr<Keyframe>>& keyframes,
                                        std::vector<Session>* sessions) {
  Sets sets = LinkedKeyframes(keyframes, *sessions);
  std::map<std::size_t, std::size_t> size_of;
  for (std::size_t i = 0; i < keyframes.size(); ++i) ++size_of[sets.Find(i)];
  std::vector<std::pair<std::size_t, std::size_t>> parts;  // first member, size
  for (const auto& part : size_of) parts.push_back(part);
  std::stable_sort(parts.begin(), parts.end(), [](const auto& a, const auto& b) { return a.second > b.second; });

  std::vector<Component> components;
  std::map<std::size_t, ComponentId> id_of;
  for (const auto& [first, size] : parts) {
    Component component;
    component.id = ComponentId(static_cast<ComponentId::Value>(components.size() + 1));
    component.session = keyframes[first]->session;
    id_of[first] = component.id;
    components.push_back(component);
  }
  if (components.empty()) {
    components.emplace_back();
    components.back().id = ComponentId(1);
    if (!sessions->empty()) components.back().session = sessions->front().id;
  }
  components.front().world_from_component = world_from_map;

  std::map<SessionId, std::vector<ComponentId>> touched;
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    keyframes[i]->component = id_of.at(sets.Find(i));
    touched[keyframes[i]->session].push_back(keyframes[i]->component);
  }
  for (Session& session : *sessions) {
    std::vector<ComponentId>& ids = touched[session.id];
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    session.components = ids;
  }
  CutLinks(keyframes);
  return components;
}

}  // namespace cairn::map
