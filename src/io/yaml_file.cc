#include "io/yaml_file.h"

#include <cmath>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "io/atomic_file.h"

namespace cairn::io {
namespace {

constexpr std::uint64_t kMaxYamlBytes = 1 << 20;  // calibrations have a few hundred

absl::Status Missing(const std::string& path, const std::string& key) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": the key `", key, "` is missing"));
}

absl::StatusOr<double> NumberOf(const std::string& path, const YAML::Node& node, const std::string& key) {
  double value = 0.0;
  if (!node.IsScalar() || !absl::SimpleAtod(node.Scalar(), &value) || !std::isfinite(value)) {
    return YamlError(path, node,
                     absl::StrCat("`", key, "` must be ", node.IsScalar() ? "" : "made of ", "numbers",
                                  node.IsScalar() ? absl::StrCat(", not \"", node.Scalar(), "\"") : ""));
  }
  return value;
}

}  // namespace

absl::StatusOr<YAML::Node> LoadYamlMap(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(std::string contents, ReadWholeFile(path, kMaxYamlBytes));
  if (absl::StartsWith(contents, "\xEF\xBB\xBF")) contents.erase(0, 3);
  if (absl::StartsWith(contents, "%YAML:")) contents.replace(0, 6, "#     ");  // the line stays, as a comment
  try {
    const YAML::Node root = YAML::Load(contents);
    if (!root.IsMap()) return absl::InvalidArgumentError(absl::StrCat(path, " is not a list of `key: value` lines"));
    return root;
  } catch (const YAML::Exception& error) {
    const std::string where = error.mark.is_null() ? "" : absl::StrCat(":", error.mark.line + 1);
    return absl::InvalidArgumentError(absl::StrCat(path, where, ": not valid YAML: ", error.msg));
  }
}

absl::Status YamlError(const std::string& path, const YAML::Node& node, absl::string_view message) {
  const YAML::Mark mark = node.Mark();
  return absl::InvalidArgumentError(
      absl::StrCat(path, mark.is_null() ? "" : absl::StrCat(":", mark.line + 1), ": ", message));
}

absl::StatusOr<double> YamlNumber(const std::string& path, const YAML::Node& map, const std::string& key) {
  const YAML::Node node = map[key];
  if (!node) return Missing(path, key);
  return NumberOf(path, node, key);
}

absl::StatusOr<std::vector<double>> YamlNumbers(const std::string& path, const YAML::Node& map,
                                                const std::string& key) {
  const YAML::Node node = map[key];
  if (!node) return Missing(path, key);
  if (!node.IsSequence())
    return YamlError(path, node, absl::StrCat("`", key, "` must be a list of numbers, as in [1, 2]"));
  std::vector<double> values;
  for (const YAML::Node& item : node) {
    CAIRN_ASSIGN_OR_RETURN(const double value, NumberOf(path, item, key));
    values.push_back(value);
  }
  return values;
}

absl::StatusOr<std::string> YamlText(const std::string& path, const YAML::Node& map, const std::string& key) {
  const YAML::Node node = map[key];
  if (!node) return Missing(path, key);
  if (!node.IsScalar()) return YamlError(path, node, absl::StrCat("`", key, "` must be a single word"));
  return node.Scalar();
}

absl::Status YamlSize(const std::string& path, const YAML::Node& map, const std::string& key, int* width, int* height) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<double> size, YamlNumbers(path, map, key));
  const auto whole = [](double v) { return v == std::floor(v) && v >= 1 && v <= 1e6; };
  if (size.size() != 2 || !whole(size[0]) || !whole(size[1])) {
    return YamlError(path, map[key], absl::StrCat("`", key, "` must be [width, height] in whole pixels"));
  }
  *width = static_cast<int>(size[0]);
  *height = static_cast<int>(size[1]);
  return absl::OkStatus();
}

}  // namespace cairn::io
