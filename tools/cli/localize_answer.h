// What `cairn localize` says of one image.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "api/localizer.h"
#include "base/time.h"

namespace cairn::cli {

nlohmann::ordered_json AnswerToJson(const api::LocalizeAnswer& answer, const std::string& path, TimeNs time_ns);
// `head`: what its line begins with.
void PrintLocalizeAnswer(const api::LocalizeAnswer& answer, const std::string& path, const std::string& head = "");

}  // namespace cairn::cli
