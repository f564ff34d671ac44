// cairnd.yaml.
#include "server/daemon/settings.h"
#include "testing_memory_file.h"

using namespace cairn;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  server::DaemonOptions options;
  (void)server::LoadSettings(file.path(), server::SettingsOf(&options));
  return 0;
}
