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

struct TextTable {
  // What the file says of its columns: the last comment before the data, or a first line in which nothing is a number,
  // as csv files have it. Empty: nothing.
  std::string header;
  std::vector<TextLine> lines;
};
absl::StatusOr<TextTable> ReadTable(const std::string& path);

// The fields of a line, separated by blanks, tabs or commas, or by semicolons where there are any; at least one, which
// may be empty. Quotes around a field are dropped.
std::vector<absl::string_view> SplitFields(absl::string_view text);

// The names of the columns in a header, in lower case, each with the unit behind it: "timestamp [ns]". Names are
// separated by commas if there are any, or else by blanks. What follows a colon is a remark.
std::vector<std::string> ColumnNames(absl::string_view header);

// Whether commas stand between digits of a line whose columns are separated by blanks.
bool HasDecimalCommas(absl::string_view text);

// InvalidArgument if a line has more fields than the `most` that are meant (`what`: their names), unless the header
// names all that it has: a number with a decimal comma is two, and would be read as another one.
absl::Status CheckNoMoreFields(const std::string& path, const TextLine& line, std::size_t fields, std::size_t most,
                               absl::string_view what, absl::string_view header = "");

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

// For a comment in a file that is written: names of maps may hold line ends and escape codes, which become blanks.
std::string InOneLine(absl::string_view text);

}  // namespace cairn::io
