// camera.yaml.
#include "io/camera_file.h"
#include "testing_memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const cairn::MemoryFile file(data, size);
  const auto camera = cairn::io::LoadCamera(file.path());
  if (camera.ok() && !camera->camera.Validate().ok()) std::abort();
  return 0;
}
