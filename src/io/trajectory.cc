#include "io/trajectory.h"

#include <array>
#include <cmath>
#include <filesystem>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "io/atomic_file.h"
#include "io/text_lines.h"
#include "io/trajectory_layout.h"

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

// KITTI's times stand beside the poses, or where the data set has them: poses/00.txt, sequences/00/times.txt.
std::optional<std::string> TimesBeside(const std::string& path) {
  const std::filesystem::path file(path), folder = file.parent_path();
  std::error_code ignored;
  for (const std::filesystem::path& times :
       {folder / "times.txt", folder / ".." / "sequences" / file.stem() / "times.txt"}) {
    if (std::filesystem::is_regular_file(times, ignored)) return times.lexically_normal().string();
  }
  return std::nullopt;
}

// The times of poses that stand in a list of their own, of which further columns are file names or exposures.
absl::StatusOr<std::vector<TimeNs>> TimesOf(const std::string& path, std::size_t num_poses, Trajectory* out) {
  const std::optional<std::string> beside = TimesBeside(path);
  if (!beside) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     " holds poses as matrices (KITTI) without times: put their times.txt, a time a line, beside it, "
                     "or a time in front of each line"));
  }
  CAIRN_ASSIGN_OR_RETURN(const TextTable table, ReadTable(*beside));
  std::vector<TimeText> texts;
  for (const TextLine& line : table.lines) texts.push_back({line.number, SplitFields(line.text)[0]});
  if (texts.size() < num_poses) {
    return LineError(path, static_cast<int>(texts.size()) + 1,
                     absl::StrCat("no time for this pose: ", *beside, " has ", texts.size(), " lines"));
  }
  if (texts.size() > num_poses) {
    out->notes.push_back(absl::StrCat(path, ": ", num_poses, " poses, but ", texts.size(), " times in ", *beside,
                                      ": taken for the first of them"));
  }
  TimeColumnRules rules;
  rules.of_images = false;
  rules.example = "# time [ms]";
  CAIRN_ASSIGN_OR_RETURN(TimeColumn times, ReadTimeColumn(*beside, texts, rules));
  if (!times.note.empty()) out->notes.push_back(times.note);
  return std::move(times.times_ns);
}

absl::StatusOr<SE3> MatrixPose(const double* numbers) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> m(numbers);
  const Matrix3d rotation = m.leftCols<3>();
  if ((rotation * rotation.transpose() - Matrix3d::Identity()).norm() > 0.1 || rotation.determinant() < 0) {
    return absl::InvalidArgumentError("the first three columns of the 3x4 matrix are not a rotation");
  }
  return SE3(rotation, m.col(3));
}

// The pose of a line; none where a number is NaN.
absl::StatusOr<std::optional<SE3>> PoseOf(const Fields& fields, const TrajectoryLayout& layout) {
  std::array<double, 12> n{};
  if (layout.matrix_column) {
    CAIRN_RETURN_IF_ERROR(ReadNumbers(fields, static_cast<std::size_t>(*layout.matrix_column), 12, n.data()));
    if (AnyNan(n.data(), 12)) return std::optional<SE3>();
    CAIRN_ASSIGN_OR_RETURN(const SE3 pose, MatrixPose(n.data()));
    return std::optional<SE3>(pose);
  }
  for (std::size_t i = 0; i < layout.columns.size(); ++i) {
    CAIRN_RETURN_IF_ERROR(ReadNumbers(fields, static_cast<std::size_t>(layout.columns[i]), 1, &n[i]));
  }
  if (AnyNan(n.data(), 7)) return std::optional<SE3>();
  CAIRN_ASSIGN_OR_RETURN(const SE3 pose, PoseFrom({n[0], n[1], n[2]}, Quaterniond(n[6], n[3], n[4], n[5])));
  return std::optional<SE3>(pose);
}

absl::StatusOr<std::vector<TimeNs>> TimesIn(const std::string& path, const TextTable& table,
                                            const TrajectoryLayout& layout, Trajectory* out) {
  std::vector<TimeText> texts;
  for (const TextLine& line : table.lines) {
    const Fields fields = SplitFields(line.text);
    if (static_cast<int>(fields.size()) < layout.num_columns) {
      return LineError(
          path, line.number,
          absl::StrCat(fields.size(), " columns instead of ", layout.num_columns, ", `", layout.Describe(), "`"));
    }
    // What else such files have in further columns is left out; but a decimal comma makes columns of one number.
    if (HasDecimalCommas(line.text)) {
      CAIRN_RETURN_IF_ERROR(CheckNoMoreFields(path, line, fields.size(), static_cast<std::size_t>(layout.most_columns),
                                              layout.Describe()));
    }
    if (layout.time_column) texts.push_back({line.number, fields[static_cast<std::size_t>(*layout.time_column)]});
  }
  if (!layout.time_column) return TimesOf(path, table.lines.size(), out);
  TimeColumnRules rules;
  rules.usual = layout.usual_unit;
  rules.named = layout.named_unit;
  rules.of_images = false;
  rules.example = "# t_ms tx ty tz qx qy qz qw";
  CAIRN_ASSIGN_OR_RETURN(TimeColumn times, ReadTimeColumn(path, texts, rules));
  out->time_unit = times.unit;
  out->counts_frames = times.counts;
  if (!times.note.empty()) out->notes.push_back(times.note);
  return std::move(times.times_ns);
}

}  // namespace

absl::StatusOr<Trajectory> ReadTrajectory(const std::string& path, bool may_be_empty) {
  CAIRN_ASSIGN_OR_RETURN(const TextTable table, ReadTable(path));
  Trajectory out;
  if (table.lines.empty()) {
    if (may_be_empty) return out;
    return absl::InvalidArgumentError(
        absl::StrCat(path, " holds no poses; expected lines of `", TrajectoryLayout().Describe(), "`"));
  }
  CAIRN_ASSIGN_OR_RETURN(const TrajectoryLayout layout, FindTrajectoryLayout(path, table));
  out.format = layout.format;
  if (!layout.note.empty()) out.notes.push_back(absl::StrCat(path, ": ", layout.note));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<TimeNs> times_ns, TimesIn(path, table, layout, &out));
  for (std::size_t row = 0; row < table.lines.size(); ++row) {
    const absl::StatusOr<std::optional<SE3>> pose = PoseOf(SplitFields(table.lines[row].text), layout);
    if (!pose.ok()) return LineError(path, table.lines[row].number, pose.status().message());
    if (pose->has_value()) {
      out.poses.push_back({times_ns[row], **pose});
      out.rows.push_back(static_cast<std::int64_t>(row));
    }
    ++out.num_rows;
  }
  return out;
}

std::string FormatTumLine(const StampedPose& pose) {
  const Vector3d& t = pose.world_from_camera.translation();
  const Quaterniond& q = pose.world_from_camera.rotation();
  std::string line = FormatSeconds(pose.time_ns);
  for (const double number : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
    absl::StrAppend(&line, " ", FormatPoseNumber(number));
  }
  return line + "\n";
}

std::string FormatPoseNumber(double number) {
  const bool is_zero = std::abs(number) < 0.5e-9;
  return absl::StrFormat("%.9f", is_zero ? 0.0 : number);
}

std::string FormatTumTrajectory(const std::vector<StampedPose>& poses, const std::string& comment) {
  std::string text;
  if (!comment.empty()) absl::StrAppend(&text, "# ", InOneLine(comment), "\n");
  absl::StrAppend(&text, "# timestamp_s tx ty tz qx qy qz qw\n");
  for (const StampedPose& pose : poses) text += FormatTumLine(pose);
  return text;
}

absl::Status WriteTumTrajectory(const std::string& path, const std::vector<StampedPose>& poses,
                                const TrajectoryWriteOptions& options) {
  return WriteFileAtomically(path, FormatTumTrajectory(poses, options.comment), options.overwrite);
}

}  // namespace cairn::io
