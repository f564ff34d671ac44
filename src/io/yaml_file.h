// YAML with errors as values.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>
#include <vector>

#include "base/status.h"

namespace cairn::io {

// The mapping that a file holds. OpenCV's `%YAML:1.0` first line, which is not YAML, is passed over.
absl::StatusOr<YAML::Node> LoadYamlMap(const std::string& path);

// "path:line: message", InvalidArgument.
absl::Status YamlError(const std::string& path, const YAML::Node& node, absl::string_view message);

// The finite number, or the list of them, under a key. Errors name file and line.
absl::StatusOr<double> YamlNumber(const std::string& path, const YAML::Node& map, const std::string& key);
absl::StatusOr<std::vector<double>> YamlNumbers(const std::string& path, const YAML::Node& map, const std::string& key);
absl::StatusOr<std::string> YamlText(const std::string& path, const YAML::Node& map, const std::string& key);

// [width, height] under a key.
absl::Status YamlSize(const std::string& path, const YAML::Node& map, const std::string& key, int* width, int* height);

}  // namespace cairn::io
