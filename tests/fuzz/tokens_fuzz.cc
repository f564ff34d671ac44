// tokens.json. Those that are taken make sense each.
#include "server/access/tokens.h"

using namespace cairn;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto tokens = server::ParseTokens({reinterpret_cast<const char*>(data), size});
  if (!tokens.ok()) return 0;
  for (const server::Token& token : *tokens) {
    if (!token.Validate().ok()) std::abort();
    if (token.CoversAll() && !token.Covers("office")) std::abort();
  }
  return 0;
}
