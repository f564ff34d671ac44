#include "cli/process_memory.h"

#include <malloc.h>

#include <fstream>
#include <sstream>
#include <string>

namespace cairn::cli {

// proc(5): VmHWM of /proc/self/status, in units of 1024 bytes.
double PeakMemoryMb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    std::istringstream fields(line);
    std::string name;
    double kilobytes = 0.0;
    if (fields >> name >> kilobytes && name == "VmHWM:") return kilobytes * 1024e-6;
  }
  return 0.0;
}

// proc(5): 5 written to /proc/self/clear_refs resets VmHWM.
void ResetPeakMemory() {
  malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << "5";
}

}  // namespace cairn::cli
