#include "wire/text.h"

#include <nlohmann/json.hpp>

namespace cairn::wire {

std::string Utf8(absl::string_view text) {
  using nlohmann::json;
  const std::string written = json(std::string(text)).dump(-1, ' ', false, json::error_handler_t::replace);
  return json::parse(written).get<std::string>();
}

}  // namespace cairn::wire
