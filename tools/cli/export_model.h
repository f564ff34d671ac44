// cairn export: the files of other programs, from a map.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "cli/input_options.h"
#include "cli/server_option.h"
#include "map/snapshot.h"

namespace cairn::cli {

struct ModelExport {
  std::string map;  // a file, or with a server the name of a map there
  ServerChoice server;
  std::string out;     // a file, or a folder for those of several files
  std::string format;  // of ModelFormats()
  std::uint32_t component = 0;
  std::string images;  // the sequence; empty: none
  std::string camera;  // its calibration, if it has none of its own
  bool overwrite = false;
  bool json = false;
};

// "colmap", "colmap-text", "nerfstudio", "tum", "kitti", "euroc", "g2o", "ply", "json".
std::vector<std::string> ModelFormats();
// By the ending of a file's name; "colmap" for a name without one, "" for one that is not known.
std::string FormatOfName(const std::string& path);

// Writes it and prints what was written.
absl::Status ExportModel(const ModelExport& options);

}  // namespace cairn::cli
