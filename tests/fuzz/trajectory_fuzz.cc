// Trajectories, in every layout that is told by its columns.
#include "io/trajectory.h"
#include "testing_memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const cairn::MemoryFile file(data, size);
  (void)cairn::io::ReadTrajectory(file.path());
  return 0;
}
