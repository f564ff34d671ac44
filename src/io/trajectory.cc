#include "io/trajectory.h"

#include <array>
#include <cmath>
#include <filesystem>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "io/atomic_file.h"
#include "io/text_lines.h"

namespace cairn::io {
namespace {

using Fields = std::vector<absl::string_view>;

// `count` numbers from field `first` on; NaN is allowed, infinity is not.
absl::Status ReadNumbers(const Fields& fields, std::size_t first, std::size_t count, double* numbers) {
  for (std::size_t i = 0; i < count; ++i) {
    if (!absl::SimpleAtod(fields[first + i], &numbers[i]) || std::isinf(numbers[i])) {
      return absl::InvalidArgumentError(
          absl::StrCat("column ", first + i + 1, ", \"", fields[first + i], "\", is not a number"));
    }
  }
  return absl::OkStatus();
}

bool AnyNan(const double* numbers, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (std::isnan(numbers[i])) return true;
  }
  return false;
}

absl::StatusOr<SE3> PoseFrom(const Vector3d& position, const Quaterniond& rotation) {
  if (std::abs(rotation.norm() - 1.0) > 0.1) {
    return absl::InvalidArgumentError(
        absl::StrCat("the quaternion has length ", rotation.norm(), " instead of 1; check the order of the columns"));
  }
  return SE3(rotation, position);
}

// One row after another; `parse` gives the time and the pose, or no pose for a row with NaN.
template <class Parse>
absl::StatusOr<Trajectory> ReadRows(const std::string& path, std::size_t min_columns, absl::string_view columns,
                                    const Parse& parse) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(path));
  if (lines.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, " holds no poses; expected lines of `", columns, "`"));
  }
  Trajectory out;
  for (const TextLine& line : lines) {
    const Fields fields = SplitFields(line.text);
    if (fields.size() < min_columns) {
      return LineError(path, line.number,
                       absl::StrCat(fields.size(), " columns instead of ", min_columns, ", `", columns, "`"));
    }
    StampedPose pose;
    const absl::StatusOr<bool> has_pose = parse(fields, out.num_rows, pose);
    if (!has_pose.ok()) return LineError(path, line.number, has_pose.status().message());
    if (*has_pose) {
      out.poses.push_back(pose);
      out.rows.push_back(out.num_rows);
    }
    ++out.num_rows;
  }
  return out;
}

bool IsIntegerTime(absl::string_view text) { return text.size() >= 15 && !absl::StrContains(text, '.'); }

}  // namespace

absl::StatusOr<Trajectory> ReadTumTrajectory(const std::string& path) {
  return ReadRows(path, 8, "t tx ty tz qx qy qz qw",
                  [](const Fields& fields, std::int64_t, StampedPose& pose) -> absl::StatusOr<bool> {
                    std::array<double, 7> n;
                    CAIRN_ASSIGN_OR_RETURN(pose.time_ns, ParseSeconds(fields[0]));
                    CAIRN_RETURN_IF_ERROR(ReadNumbers(fields, 1, 7, n.data()));
                    if (AnyNan(n.data(), 7)) return false;
                    CAIRN_ASSIGN_OR_RETURN(pose.world_from_camera,
                                           PoseFrom({n[0], n[1], n[2]}, Quaterniond(n[6], n[3], n[4], n[5])));
                    return true;
                  });
}

absl::StatusOr<Trajectory> ReadEurocTrajectory(const std::string& path) {
  absl::StatusOr<Trajectory> out =
      ReadRows(path, 8, "ns, x, y, z, qw, qx, qy, qz",
               [](const Fields& fields, std::int64_t, StampedPose& pose) -> absl::StatusOr<bool> {
                 std::array<double, 7> n;
                 CAIRN_ASSIGN_OR_RETURN(pose.time_ns, ParseNanoseconds(fields[0]));
                 CAIRN_RETURN_IF_ERROR(ReadNumbers(fields, 1, 7, n.data()));
                 if (AnyNan(n.data(), 7)) return false;
                 CAIRN_ASSIGN_OR_RETURN(pose.world_from_camera,
                                        PoseFrom({n[0], n[1], n[2]}, Quaterniond(n[3], n[4], n[5], n[6])));
                 return true;
               });
  if (out.ok()) out->format = TrajectoryFormat::kEuroc;
  return out;
}

absl::StatusOr<Trajectory> ReadKittiTrajectory(const std::string& path, const std::string& times_path) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> times, ReadDataLines(times_path));
  absl::StatusOr<Trajectory> out = ReadRows(
      path, 12, "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz",
      [&](const Fields& fields, std::int64_t row, StampedPose& pose) -> absl::StatusOr<bool> {
        if (row >= static_cast<std::int64_t>(times.size())) {
          return absl::InvalidArgumentError(
              absl::StrCat("no time for this pose: ", times_path, " has ", times.size(), " lines"));
        }
        const absl::StatusOr<TimeNs> time_ns = ParseSeconds(SplitFields(times[row].text)[0]);
        if (!time_ns.ok()) return LineError(times_path, times[row].number, time_ns.status().message());
        pose.time_ns = *time_ns;
        std::array<double, 12> n;
        CAIRN_RETURN_IF_ERROR(ReadNumbers(fields, 0, 12, n.data()));
        if (AnyNan(n.data(), 12)) return false;
        const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> m(n.data());
        const Matrix3d rotation = m.leftCols<3>();
        if ((rotation * rotation.transpose() - Matrix3d::Identity()).norm() > 0.1 || rotation.determinant() < 0) {
          return absl::InvalidArgumentError("the first three columns of the 3x4 matrix are not a rotation");
        }
        pose.world_from_camera = SE3(rotation, m.col(3));
        return true;
      });
  if (out.ok()) out->format = TrajectoryFormat::kKitti;
  return out;
}

absl::StatusOr<Trajectory> ReadTrajectory(const std::string& path, bool may_be_empty) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TextLine> lines, ReadDataLines(path));
  if (lines.empty() && may_be_empty) return Trajectory();
  if (!lines.empty()) {
    const Fields fields = SplitFields(lines[0].text);
    if (absl::StrContains(lines[0].text, ',') && IsIntegerTime(fields[0])) {
      return ReadEurocTrajectory(path);
    }
    const std::filesystem::path times = std::filesystem::path(path).parent_path() / "times.txt";
    std::error_code ignored;
    if (fields.size() == 12 && std::filesystem::exists(times, ignored))
      return ReadKittiTrajectory(path, times.string());
  }
  return ReadTumTrajectory(path);
}

std::string FormatTumLine(const StampedPose& pose) {
  const Vector3d& t = pose.world_from_camera.translation();
  const Quaterniond& q = pose.world_from_camera.rotation();
  return absl::StrFormat("%s %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", FormatSeconds(pose.time_ns), t.x(), t.y(), t.z(),
                         q.x(), q.y(), q.z(), q.w());
}

std::string FormatTumTrajectory(const std::vector<StampedPose>& poses, const std::string& comment) {
  std::string text;
  if (!comment.empty()) absl::StrAppend(&text, "# ", comment, "\n");
  absl::StrAppend(&text, "# timestamp_s tx ty tz qx qy qz qw\n");
  for (const StampedPose& pose : poses) text += FormatTumLine(pose);
  return text;
}

absl::Status WriteTumTrajectory(const std::string& path, const std::vector<StampedPose>& poses,
                                const TrajectoryWriteOptions& options) {
  return WriteFileAtomically(path, FormatTumTrajectory(poses, options.comment), options.overwrite);
}

}  // namespace cairn::io
