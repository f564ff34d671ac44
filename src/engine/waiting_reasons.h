// What a stage says that it waits for, frame after frame: which reasons there were, how often, and the last words of
// each. The last word of all is what it waited for when it ended, which need not be why it never began.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace cairn::engine {

class WaitingReasons {
 public:
  // Reasons are the same if they differ in their numbers only.
  void Add(absl::string_view message);
  bool empty() const { return reasons_.empty(); }
  // "the camera has not moved enough: 0.1 deg ... (180 frames); before that: ... (20 frames)": the most frequent ones,
  // each as it was said last.
  std::string Describe() const;

 private:
  static constexpr std::size_t kMostKinds = 32;  // what comes on top is not counted

  struct Reason {
    std::string kind;
    std::string last;
    std::int64_t count = 0;
  };
  std::vector<Reason> reasons_;
};

}  // namespace cairn::engine
