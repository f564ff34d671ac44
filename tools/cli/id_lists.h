// Lists of ids, for people and for programs.
#pragma once

#include <cstddef>
#include <cstdio>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "cli/cli.h"
#include "text/text.h"

namespace cairn::cli {

template <class Ids>
nlohmann::ordered_json IdsAsJson(const Ids& ids) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const auto id : ids) json.push_back(id.value());
  return json;
}

// "1-3, 7", at most so many runs.
template <class Ids>
std::string Runs(const Ids& ids, std::size_t limit) {
  std::vector<std::string> runs;
  for (std::size_t i = 0; i < ids.size();) {
    std::size_t j = i;
    while (j + 1 < ids.size() && ids[j + 1].value() == ids[j].value() + 1) ++j;
    if (runs.size() == limit) {
      runs.push_back("...");
      break;
    }
    runs.push_back(i == j ? absl::StrCat(ids[i].value()) : absl::StrCat(ids[i].value(), "-", ids[j].value()));
    i = j + 1;
  }
  return absl::StrJoin(runs, ", ");
}

// A line "keyframes added (4): 1-3, 7"; none without ids.
template <class Ids>
void PrintIds(absl::string_view what, const Ids& ids, std::size_t limit) {
  if (ids.empty()) return;
  std::fputs(text::Wrapped(absl::StrCat(what, " (", ids.size(), "): ", Runs(ids, limit)), "  ", "    ").c_str(),
             stdout);
}

}  // namespace cairn::cli
