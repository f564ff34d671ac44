// Vocabularies without the checksum that stands at their end: it is made to fit, so that what it protects is looked at.
// Those that are taken are written and read back as they were.
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "place/vocabulary.h"

using cairn::place::Vocabulary;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  const std::uint64_t checksum = XXH64(bytes.data(), bytes.size(), 0);
  bytes.append(reinterpret_cast<const char*>(&checksum), sizeof checksum);
  const auto vocabulary = Vocabulary::Parse(bytes);
  if (!vocabulary.ok()) return 0;
  if (vocabulary->Serialize() != bytes) std::abort();
  return 0;
}
