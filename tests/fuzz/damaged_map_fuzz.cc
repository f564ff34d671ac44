// What is read of a damaged map file without SQLite: its pages, its write-ahead log, and the page that names the map.
// The first byte says which, and how much of the rest is the log.
#include "store/log_frames.h"
#include "store/page_image.h"
#include "store/write_ahead_log.h"
#include "testing_memory_file.h"

using namespace cairn;

namespace {

void ReadPages(const std::string& path, const std::string& log) {
  auto image = store::PageImage::Open(path, log);
  if (!image.ok()) return;
  std::size_t bytes = 0;
  image->ForEachRow([&](const store::RawRow& row) {
    for (const store::RecordColumn& column : row.columns) {
      bytes += column.Text().size() + column.bytes.size();
      (void)column.Int();
      (void)column.Real();
      (void)column.Type();
    }
  });
  (void)image->user_version();
  (void)bytes;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const store::Bytes rest(data + 1, size - 1);
  switch (data[0] % 4) {
    case 0:
      ReadPages(MemoryFile(rest.data(), rest.size()).path(), "");
      break;
    case 1: {
      // Both in pages of 512 bytes, as many of the file as the other bits say.
      const std::size_t file_bytes = std::min<std::size_t>(rest.size(), 512 * std::size_t{data[0]} / 4);
      const MemoryFile file(rest.data(), file_bytes), log(rest.data() + file_bytes, rest.size() - file_bytes);
      ReadPages(file.path(), log.path());
      break;
    }
    case 2:
      store::ForEachLogFrame(MemoryFile(rest.data(), rest.size()).path(), [](const store::LogFrame& frame) {
        if (frame.in_order && !frame.intact) std::abort();
      });
      break;
    default:
      (void)store::ParseMapPage(rest);
  }
  return 0;
}
