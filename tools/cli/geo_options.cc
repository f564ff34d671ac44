#include "cli/geo_options.h"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "cli/outputs.h"
#include "io/text_lines.h"
#include "io/time_column.h"
#include "map/geo_pose.h"

namespace cairn::cli {
namespace {

absl::StatusOr<GeoPosition> PositionFrom(absl::string_view latitude, absl::string_view longitude,
                                         absl::string_view height) {
  GeoPosition position;
  if (!absl::SimpleAtod(latitude, &position.latitude_deg) || !absl::SimpleAtod(longitude, &position.longitude_deg) ||
      !absl::SimpleAtod(height, &position.height_m)) {
    return absl::InvalidArgumentError("latitude and longitude in degrees and a height in metres are needed");
  }
  CAIRN_RETURN_IF_ERROR(position.Validate());
  return position;
}

struct Axes {
  Vector3d up, ahead;
};

absl::StatusOr<Axes> AxesFrom(absl::string_view up) {
  absl::string_view axis = up;
  const bool negative = !axis.empty() && axis[0] == '-';
  if (negative) axis.remove_prefix(1);
  if (axis.size() != 1 || axis[0] < 'x' || axis[0] > 'z') {
    return absl::InvalidArgumentError("--up is one of x, y, z, -x, -y, -z");
  }
  const int index = axis[0] - 'x';
  return Axes{(negative ? -1.0 : 1.0) * Vector3d::Unit(index), Vector3d::Unit((index + 1) % 3)};
}

std::string AxisName(int index) { return std::string(1, static_cast<char>('x' + index)); }

}  // namespace

absl::StatusOr<decltype(api::AlignRequest::by)> AnchorOf(const GeoOptions& options) {
  if (options.geo == "none") return api::NoGeoAnchor();
  const std::vector<absl::string_view> fields = io::SplitFields(options.geo);
  if (fields.size() != 3) return UsageError("--geo takes \"LATITUDE LONGITUDE HEIGHT\", or none");
  const absl::StatusOr<GeoPosition> position = PositionFrom(fields[0], fields[1], fields[2]);
  if (!position.ok()) return UsageError(absl::StrCat("--geo: ", position.status().message()));
  CAIRN_ASSIGN_OR_RETURN(const Axes axes, AxesFrom(options.up));
  if (!std::isfinite(options.heading_deg)) return UsageError("--heading must be a number of degrees");
  return map::AnchorAt(*position, map::EnuFromWorld(axes.up, axes.ahead, options.heading_deg));
}

absl::StatusOr<api::GeoPositions> ReadGeoPositions(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const io::TextTable table, io::ReadTable(path));
  const std::vector<std::string> names = io::ColumnNames(table.header);
  const bool by_keyframe = !names.empty() && names[0] == "keyframe";
  api::GeoPositions read;
  std::vector<io::TimeText> times;
  for (const io::TextLine& line : table.lines) {
    const std::vector<absl::string_view> fields = io::SplitFields(line.text);
    constexpr std::size_t kColumns = 4;
    if (fields.size() < kColumns) {
      return io::LineError(path, line.number,
                           absl::StrCat(by_keyframe ? "keyframe" : "time", " latitude longitude height are needed"));
    }
    CAIRN_RETURN_IF_ERROR(io::CheckNoMoreFields(
        path, line, fields.size(), kColumns,
        by_keyframe ? "keyframe latitude longitude height" : "time latitude longitude height", table.header));
    api::GeoPositions::At at;
    const absl::StatusOr<GeoPosition> position = PositionFrom(fields[1], fields[2], fields[3]);
    if (!position.ok()) return io::LineError(path, line.number, position.status().message());
    at.position = *position;
    KeyframeId::Value keyframe = 0;
    if (!by_keyframe) {
      times.push_back({line.number, fields[0]});
    } else if (absl::SimpleAtoi(fields[0], &keyframe) && keyframe > 0) {
      at.keyframe = KeyframeId(keyframe);
    } else {
      return io::LineError(path, line.number, "the number of a keyframe is needed (cairn info)");
    }
    read.positions.push_back(at);
  }
  if (!times.empty()) {
    io::TimeColumnRules rules;
    rules.of_images = false;
    rules.example = "# time [ms] latitude longitude height";
    if (!names.empty()) rules.named = io::UnitOfColumn(names[0]);
    CAIRN_ASSIGN_OR_RETURN(const io::TimeColumn column, io::ReadTimeColumn(path, times, rules));
    for (std::size_t i = 0; i < read.positions.size(); ++i) read.positions[i].time_ns = column.times_ns[i];
  }
  return read;
}

std::string DescribeAnchor(const map::GeoAnchor& anchor) {
  // The axis that is closest to upwards, and the one whose heading is told with it.
  const Matrix3d enu_from_world = anchor.enu_from_world.toRotationMatrix();
  int up = 0;
  enu_from_world.row(2).cwiseAbs().maxCoeff(&up);
  const int ahead = (up + 1) % 3;
  double heading_deg = std::atan2(enu_from_world(0, ahead), enu_from_world(1, ahead)) * 180.0 / std::numbers::pi;
  if (heading_deg < 0.0) heading_deg += 360.0;
  return absl::StrFormat(
      "%.8f %.8f, %.3f m above the ellipsoid; the world's %s axis points to %.2f deg, its %s axis %s",
      anchor.latitude_deg, anchor.longitude_deg, anchor.height_m, AxisName(ahead), heading_deg, AxisName(up),
      enu_from_world(2, up) > 0.0 ? "upwards" : "downwards");
}

}  // namespace cairn::cli
