#include "cli/common_frame.h"

#include <algorithm>

#include "cli/component_report.h"
#include "inspect/measures.h"

namespace cairn::cli {

CommonFrame CommonFrameOf(const map::Snapshot& map) {
  CommonFrame frame;
  frame.components = inspect::TogetherInOneFrame(map);
  frame.metric = !frame.components.empty() && map.WorldFrom(frame.components[0]).has_value();
  for (const ComponentId component : frame.components) {
    frame.common_from.push_back(map.WorldFrom(component).value_or(Sim3()));
  }
  return frame;
}

CommonFrame CommonFrameOf(const api::MapDescription& map) {
  CommonFrame aligned{{}, true, {}}, largest;
  std::int64_t most = 0;
  for (const api::ComponentInfo& component : map.components) {
    if (component.joined_into || component.keyframes == 0) continue;
    if (component.world_from_component) {
      aligned.components.push_back(component.id);
      aligned.common_from.push_back(*component.world_from_component);
    }
    if (component.keyframes > most) largest = {{component.id}, false, {Sim3()}};
    most = std::max(most, component.keyframes);
  }
  return aligned.components.empty() ? largest : aligned;
}

}  // namespace cairn::cli
