// What the verbs check of the files they are to write, before they begin.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"

namespace cairn::cli {

// OK if `path` may be written: its folder can be, and it does not exist, or is a file and `overwrite`. The message
// names the remedy. What is no map never replaces one, nor a file that belongs to one.
absl::Status CheckWritable(const std::string& path, bool overwrite, bool is_map = false);

// InvalidArgument if two outputs are the same file, or an output is one of the inputs, or a file in a folder
// that is one (unless it looks like an earlier map, trajectory, drawing or vocabulary), or belongs to a map among them
// (its log, its lock). Files are the same if they are one file on the disk, whatever their names: through links too.
// Empty names count for nothing.
absl::Status CheckDistinct(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs);

// A folder that a verb makes: if it was not there before, it is gone with all that was put into it, and with the
// folders around it that were made for it, unless it is kept.
class FreshFolder {
 public:
  explicit FreshFolder(const std::string& path);
  ~FreshFolder();
  FreshFolder(const FreshFolder&) = delete;
  FreshFolder& operator=(const FreshFolder&) = delete;
  void Keep() { outermost_.clear(); }

 private:
  std::string outermost_;  // of the folders that were not there; empty: there is nothing to remove
};

// InvalidArgument, of a mistake in the call itself: Fail() (cli.h) ends with the exit code of usage errors.
absl::Status UsageError(const std::string& message);

// UsageError unless the name is empty or ends in .png or .svg.
absl::Status CheckPicture(const std::string& path);

// The error that ended a verb early, with what became of the outputs that could still be written: `written` is the
// result of writing them. Empty names count for nothing.
absl::Status AfterError(const absl::Status& error, const std::vector<std::string>& outputs,
                        const absl::Status& written);

}  // namespace cairn::cli
