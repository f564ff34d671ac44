#include "cli/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "absl/strings/str_format.h"

namespace cairn::cli {
namespace {

double NowSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Of the terminal as it is now; 80 if it does not say.
int Columns() {
  winsize size = {};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

// "61/s, 0:42 left"; "61/s" at the end.
std::string Pace(double per_s, double left_s) {
  const std::string rate = per_s >= 10.0 ? absl::StrFormat("%.0f/s", per_s) : absl::StrFormat("%.1f/s", per_s);
  const auto left = static_cast<long long>(left_s + 0.5);
  if (left == 0) return rate;
  if (left >= 3600) return absl::StrFormat("%s, %d:%02d:%02d left", rate, left / 3600, left / 60 % 60, left % 60);
  return absl::StrFormat("%s, %d:%02d left", rate, left / 60, left % 60);
}

std::string Bar(double share, int width) {
  std::string bar;
  for (int i = 0; i < width; ++i) bar += i < static_cast<int>(share * width) ? "█" : "░";
  return bar;
}

bool Continues(char byte) { return (static_cast<unsigned char>(byte) & 0xC0) == 0x80; }  // of a UTF-8 character

// The first `columns` characters, without what would move the cursor.
std::string Fit(std::string text, int columns) {
  int used = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (static_cast<unsigned char>(text[i]) < 0x20) text[i] = ' ';
    if (!Continues(text[i]) && ++used > columns) return text.substr(0, i);
  }
  return text;
}

int Width(const std::string& text) {
  return static_cast<int>(std::count_if(text.begin(), text.end(), [](char byte) { return !Continues(byte); }));
}

}  // namespace

Progress::Progress(std::string label, std::int64_t total, bool quiet)
    : label_(std::move(label)),
      total_(std::max<std::int64_t>(total, 1)),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() { Finish(); }

void Progress::Update(std::int64_t done, const std::string& note) {
  if (quiet_ || finished_) return;
  const double now_s = NowSeconds();
  if (first_s_ < 0.0) {
    first_s_ = now_s;
    first_done_ = done;
  }
  if (terminal_) {
    if (now_s - last_drawn_s_ < 0.1) return;
    last_drawn_s_ = now_s;
  } else {
    const std::int64_t tenth = done * 10 / total_;
    if (tenth == last_tenth_ || tenth == 0) return;
    last_tenth_ = tenth;
  }
  Draw(done, note, now_s);
}

void Progress::Finish(const std::string& note) {
  if (quiet_ || finished_) return;
  finished_ = true;
  if (terminal_ && last_drawn_s_ >= 0.0) {
    std::fputs("\r\033[K", stderr);
    if (!note.empty()) std::fprintf(stderr, "%s: %s\n", label_.c_str(), note.c_str());
  }
}

// A line that is too long would wrap, and then not be drawn over: the bar goes first, then the end of the line.
void Progress::Draw(std::int64_t done, const std::string& note, double now_s) {
  constexpr int kBar = 30;
  const double share = std::clamp(static_cast<double>(done) / static_cast<double>(total_), 0.0, 1.0);
  std::string rest = absl::StrFormat("%3.0f %%", 100.0 * share);
  const double elapsed_s = now_s - first_s_;
  if (elapsed_s >= 1.0 && done > first_done_) {
    const double per_s = static_cast<double>(done - first_done_) / elapsed_s;
    rest += "  " + Pace(per_s, static_cast<double>(std::max<std::int64_t>(total_ - done, 0)) / per_s);
  }
  if (!note.empty()) rest += "  " + note;
  if (terminal_) {
    const int columns = Columns() - 1;
    std::string line = label_ + " " + rest;
    if (Width(line) + kBar + 1 <= columns) line = label_ + " " + Bar(share, kBar) + " " + rest;
    std::fprintf(stderr, "\r\033[K%s", Fit(std::move(line), columns).c_str());
  } else {
    std::fprintf(stderr, "%s: %s\n", label_.c_str(), rest.c_str() + rest.find_first_not_of(' '));
  }
  std::fflush(stderr);
}

}  // namespace cairn::cli
