// Lines of data files: what is common to the text formats that are read here.
#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "base/time.h"

namespace cairn::io {

struct TextLine {
  int number = 0;    // in the file, from 1
  std::string text;  // without blanks and carriage return at the ends
};

// The lines that hold data: not empty, not starting with `#`. A byte order mark is dropped. NotFound names the file.
absl::StatusOr<std::vector<TextLine>> ReadDataLines(const std::string& path);

// The fields of a line, separated by blanks, tabs or commas; at least one, which may be empty.
std::vector<absl::string_view> SplitFields(absl::string_view text);

// "path:number: message", InvalidArgument.
absl::Status LineError(const std::string& path, int number, absl::string_view message);

// Times of a list of images, which must increase strictly.
class TimeOrder {
 public:
  absl::Status Add(TimeNs time_ns, const std::string& path, int line);

 private:
  bool any_ = false;
  TimeNs last_ns_ = 0;
};

}  // namespace cairn::io
