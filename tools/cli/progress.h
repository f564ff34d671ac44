// How far a verb is: one line that redraws itself on a terminal, and a plain line every tenth otherwise.
#pragma once

#include <cstdint>
#include <string>

namespace cairn::cli {

// Writes to standard error.
class Progress {
 public:
  Progress(std::string label, std::int64_t total, bool quiet);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `note` stands last: "42 keyframes". The rate and the time left are known here.
  void Update(std::int64_t done, const std::string& note = "");
  void Finish(const std::string& note = "");

 private:
  void Draw(std::int64_t done, const std::string& note, double now_s);

  std::string label_;
  std::int64_t total_;
  bool quiet_;
  bool terminal_;
  bool finished_ = false;
  std::int64_t last_tenth_ = -1;
  double last_drawn_s_ = -1.0;
  double first_s_ = -1.0;  // of the first update
  std::int64_t first_done_ = 0;
};

}  // namespace cairn::cli
