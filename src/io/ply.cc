#include "io/ply.h"

#include <bit>
#include <cstring>
#include <limits>

#include "io/atomic_file.h"
#include "io/text_lines.h"

namespace cairn::io {

absl::Status WritePly(const std::string& path, const std::vector<ColoredPoint>& points, bool overwrite,
                      const std::string& comment) {
  static_assert(std::endian::native == std::endian::little, "the format is written in the machine's order");
  std::string contents =
      absl::StrCat("ply\nformat binary_little_endian 1.0\n", comment.empty() ? "" : "comment ", InOneLine(comment),
                   comment.empty() ? "" : "\n", "element vertex ", points.size(),
                   "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
                   "property uchar blue\nend_header\n");
  contents.reserve(contents.size() + 15 * points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f position = points[i].position.cast<float>();
    if (!position.allFinite()) {
      return absl::InvalidArgumentError(
          absl::StrCat("writing ", path, ": the position of point ", i, " is not finite"));
    }
    char record[15];
    std::memcpy(record, position.data(), 12);
    record[12] = static_cast<char>(points[i].red);
    record[13] = static_cast<char>(points[i].green);
    record[14] = static_cast<char>(points[i].blue);
    contents.append(record, sizeof(record));
  }
  return WriteFileAtomically(path, contents, overwrite);
}

}  // namespace cairn::io
