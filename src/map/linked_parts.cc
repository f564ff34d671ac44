#include "map/linked_parts.h"

#include <algorithm>
#include <map>
#include <utility>

namespace cairn::map {
namespace {

constexpr std::int64_t kPosesGiven = -1;  // direct_segment of keyframes that no odometry made

using Links = std::unordered_multimap<KeyframeId, KeyframeId>;

void Link(KeyframeId a, KeyframeId b, Links* links) {
  links->emplace(a, b);
  links->emplace(b, a);
}

// Beside shared points: loops, and what one start of the odometry has seen.
Links LinksOf(const Snapshot& map) {
  Links links;
  for (const auto& [id, session] : map.sessions()) {
    for (const ClosedLoop& loop : session.loops) {
      const bool gone =
          map.keyframes().Find(loop.keyframe) == nullptr || map.keyframes().Find(loop.loop_keyframe) == nullptr;
      if (!gone) Link(loop.keyframe, loop.loop_keyframe, &links);
    }
  }
  std::map<std::pair<SessionId, std::int64_t>, KeyframeId> last;  // of each segment
  map.keyframes().ForEach([&](const auto& keyframe) {
    const bool given = keyframe->direct_segment == kPosesGiven;
    const auto [before, first] =
        last.emplace(std::pair(given ? SessionId() : keyframe->session, keyframe->direct_segment), keyframe->id);
    if (!first) Link(std::exchange(before->second, keyframe->id), keyframe->id, &links);
  });
  return links;
}

}  // namespace

LinkedParts::LinkedParts(const Snapshot& map) {
  const Links links = LinksOf(map);
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (part_of_.contains(keyframe->id)) return;
    std::vector<KeyframeId> part;
    const auto visit = [&](KeyframeId other) {
      if (part_of_.emplace(other, 0).second) part.push_back(other);
    };
    visit(keyframe->id);
    for (std::size_t i = 0; i < part.size(); ++i) {
      for (const CovisibilityEdge& edge : map.keyframe(part[i]).covisible) {
        if (edge.shared_points < kMinCovisiblePoints) break;
        visit(edge.keyframe);
      }
      const auto [begin, end] = links.equal_range(part[i]);
      for (auto link = begin; link != end; ++link) visit(link->second);
    }
    std::sort(part.begin(), part.end());
    parts_.push_back(std::move(part));
  });
  std::sort(parts_.begin(), parts_.end(), [](const auto& a, const auto& b) {
    return a.size() != b.size() ? a.size() > b.size() : a.front() < b.front();
  });
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    for (const KeyframeId keyframe : parts_[i]) part_of_[keyframe] = static_cast<int>(i);
  }
}

int LinkedParts::PartOf(KeyframeId keyframe) const {
  const auto found = part_of_.find(keyframe);
  return found == part_of_.end() ? -1 : found->second;
}

}  // namespace cairn::map
