#include "engine/waiting_reasons.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace cairn::engine {

void WaitingReasons::Add(absl::string_view message) {
  if (message.empty()) return;
  std::string kind(message);
  std::erase_if(kind, [](unsigned char c) { return absl::ascii_isdigit(c) || c == '.'; });
  auto known = std::ranges::find(reasons_, kind, &Reason::kind);
  if (known == reasons_.end()) {
    if (reasons_.size() == kMostKinds) return;
    reasons_.push_back({std::move(kind), "", 0});
    known = reasons_.end() - 1;
  }
  known->last = std::string(message);
  ++known->count;
}

std::string WaitingReasons::Describe() const {
  constexpr std::size_t kMostTold = 3;
  std::vector<Reason> told = reasons_;
  std::ranges::stable_sort(told, std::greater<>(), &Reason::count);
  std::string text;
  for (std::size_t i = 0; i < std::min(told.size(), kMostTold); ++i) {
    absl::StrAppend(&text, i == 0 ? "" : "; also ", told[i].last);
    if (told.size() > 1) absl::StrAppend(&text, " (", told[i].count, told[i].count == 1 ? " frame)" : " frames)");
  }
  return text;
}

}  // namespace cairn::engine
