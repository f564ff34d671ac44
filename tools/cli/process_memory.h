// How much memory this process uses.
#pragma once

namespace cairn::cli {

// The most that was resident at any time since the start, or since ResetPeakMemory(); in 10^6 bytes; 0 if the system
// does not tell.
double PeakMemoryMb();
// Starts counting anew, after returning what is free to the system. Without effect where the system does not allow it.
void ResetPeakMemory();

}  // namespace cairn::cli
