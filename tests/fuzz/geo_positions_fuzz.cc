// Geographic positions of keyframes, as `cairn align --geo-positions` reads them.
#include "cli/geo_options.h"
#include "testing_memory_file.h"

using namespace cairn;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  const auto read = cli::ReadGeoPositions(file.path());
  if (!read.ok()) return 0;
  for (const auto& at : read->positions) {
    if (!at.position.Validate().ok()) std::abort();
  }
  return 0;
}
