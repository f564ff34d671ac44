// What may wait a little goes behind what somebody waits for.
#pragma once

namespace cairn {

// From now on the calling thread gets the processor after those of the usual priority that want it, in this process and
// others. For work whose result nobody waits for. Where the system does not allow it, nothing changes.
void YieldToOthers() noexcept;

}  // namespace cairn
