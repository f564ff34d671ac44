// What the columns of a file of poses are: from its header where that names them, else from what the numbers can be.
// One sign alone decides nothing: twelve numbers that are a matrix with a rotation in it are KITTI's even without
// times, and are not read as a time, a position and a quaternion.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "io/text_lines.h"
#include "io/time_column.h"
#include "io/trajectory.h"

namespace cairn::io {

struct TrajectoryLayout {
  TrajectoryFormat format = TrajectoryFormat::kTum;
  std::optional<int> time_column = 0;  // none: the times stand in another file
  std::optional<TimeUnit> named_unit;  // of the times, by the header
  TimeUnit usual_unit = TimeUnit::kSeconds;
  // Of a matrix, 3x4 or 4x4 row by row: its first column; else none.
  std::optional<int> matrix_column;
  std::array<int, 7> columns = {1, 2, 3, 4, 5, 6, 7};  // of x y z qx qy qz qw
  int num_columns = 8;                                 // that a line must have at least ...
  int most_columns = 8;                                // ... and may have
  std::string note;                                    // for people; empty: as usual

  // For messages: "t tx ty tz qx qy qz qw".
  std::string Describe() const;
};

// InvalidArgument names the file and the remedy. The table holds a line at least.
absl::StatusOr<TrajectoryLayout> FindTrajectoryLayout(const std::string& path, const TextTable& table);

}  // namespace cairn::io
