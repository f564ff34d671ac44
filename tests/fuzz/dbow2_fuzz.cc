// Vocabularies in DBoW2's text form. Those that are taken are good ones.
#include <sstream>

#include "place/dbow2.h"

using cairn::place::Vocabulary;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  const auto vocabulary = cairn::place::ImportDbow2Text(in, "a");
  if (vocabulary.ok() && !Vocabulary::Parse(vocabulary->Serialize()).ok()) std::abort();
  return 0;
}
