// A folder in memory for parsers that take the name of one, or of a file that others stand beside; gone at the end.
#pragma once

#include <stdlib.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "absl/strings/string_view.h"

namespace cairn {

class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code none;
    std::string name = std::filesystem::is_directory("/dev/shm", none) ? "/dev/shm" : "/tmp";
    name += "/cairn_fuzz_XXXXXX";
    if (mkdtemp(name.data()) == nullptr) std::abort();
    path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  std::string path(const std::string& name = "") const { return name.empty() ? path_ : path_ + "/" + name; }

  // In place of what is there. Folders in the name are made.
  void Write(const std::string& name, absl::string_view bytes) const {
    const std::string file_name = path(name);
    std::FILE* file = std::fopen(file_name.c_str(), "wb");
    if (file == nullptr) {
      std::filesystem::create_directories(std::filesystem::path(file_name).parent_path());
      file = std::fopen(file_name.c_str(), "wb");
    }
    if (file == nullptr || std::fwrite(bytes.data(), 1, bytes.size(), file) != bytes.size()) std::abort();
    std::fclose(file);
  }

 private:
  std::string path_;
};

}  // namespace cairn
