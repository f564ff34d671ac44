#include "io/trajectory_layout.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace cairn::io {
namespace {

using Fields = std::vector<absl::string_view>;

constexpr std::array<absl::string_view, 7> kNames = {"x", "y", "z", "qx", "qy", "qz", "qw"};

// The first line without NaN, as numbers; empty if a field of it is none.
std::vector<double> FirstNumbers(const TextTable& table) {
  for (const TextLine& line : table.lines) {
    std::vector<double> numbers;
    bool all = true;
    for (const absl::string_view field : SplitFields(line.text)) {
      double value = 0.0;
      if (!absl::SimpleAtod(field, &value)) {
        all = false;
        break;
      }
      numbers.push_back(value);
    }
    const bool nan = std::any_of(numbers.begin(), numbers.end(), [](double n) { return std::isnan(n); });
    if (!nan) return all ? numbers : std::vector<double>();
  }
  return {};
}

// Whether 12 or 16 numbers from `first` on are the rows of a rigid motion.
bool IsMotion(const std::vector<double>& numbers, std::size_t first) {
  const std::size_t count = numbers.size() - first;
  if (count != 12 && count != 16) return false;
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> m(numbers.data() + first);
  const Matrix3d rotation = m.leftCols<3>();
  if (!((rotation * rotation.transpose() - Matrix3d::Identity()).norm() < 0.1 && rotation.determinant() > 0)) {
    return false;
  }
  const double* last = numbers.data() + first + 12;
  return count == 12 || (last[0] == 0 && last[1] == 0 && last[2] == 0 && last[3] == 1);
}

std::optional<TrajectoryLayout> MatrixLayout(const TextTable& table) {
  const std::vector<double> numbers = FirstNumbers(table);
  for (const int first : {0, 1}) {
    if (static_cast<int>(numbers.size()) <= first || !IsMotion(numbers, static_cast<std::size_t>(first))) continue;
    TrajectoryLayout layout;
    layout.format = TrajectoryFormat::kKitti;
    layout.time_column = first == 0 ? std::nullopt : std::optional<int>(0);
    layout.matrix_column = first;
    layout.num_columns = layout.most_columns = static_cast<int>(numbers.size());
    return layout;
  }
  return std::nullopt;
}

// What a column is by its name: an index into kNames, or nothing. p_RS_R_x, tx, position.x and q_RS_w, orientation.w,
// but not v_RS_R_x or b_w_RS_S_x.
std::optional<int> PartOfPose(absl::string_view name) {
  name = absl::StripAsciiWhitespace(name.substr(0, name.find_first_of("[(")));
  std::vector<std::string> words = absl::StrSplit(name, absl::ByAnyChar("_. /"), absl::SkipEmpty());
  if (words.empty()) return std::nullopt;
  const std::string last = words.back();
  if (words.size() == 1) {
    if (last.size() == 2 && (last[0] == 't' || last[0] == 'p') && last[1] >= 'x' && last[1] <= 'z')
      return last[1] - 'x';
    const auto found = std::find(kNames.begin(), kNames.end(), last);
    if (found == kNames.end()) return std::nullopt;
    return static_cast<int>(found - kNames.begin());
  }
  if (last.size() != 1 || absl::string_view("xyzw").find(last[0]) == absl::string_view::npos) return std::nullopt;
  const int axis = last[0] == 'w' ? 3 : last[0] - 'x';
  const auto any = [&](std::initializer_list<absl::string_view> wanted) {
    return std::any_of(words.begin(), words.end() - 1, [&](const std::string& w) {
      return std::find(wanted.begin(), wanted.end(), w) != wanted.end();
    });
  };
  const std::string& first = words.front();
  if (first == "v" || first == "b" || first == "a" || any({"twist", "velocity", "covariance"})) return std::nullopt;
  if (first == "q" || any({"q", "quat", "quaternion", "orientation", "rotation", "rot"})) return 3 + axis;
  if (axis < 3 && (first == "p" || first == "t" || any({"p", "pos", "position", "translation", "trans"}))) return axis;
  return std::nullopt;
}

bool IsIntegerTime(absl::string_view text) { return text.size() >= 15 && !absl::StrContains(text, '.'); }

// The layout that a header names, if it names all that a pose has.
absl::StatusOr<std::optional<TrajectoryLayout>> NamedLayout(const std::string& path, const TextTable& table) {
  const std::vector<std::string> names = ColumnNames(table.header);
  if (names.empty()) return std::optional<TrajectoryLayout>();
  const std::size_t num_fields = SplitFields(table.lines[0].text).size();
  std::map<int, int> column_of;
  std::optional<int> time;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::optional<int> part = PartOfPose(names[i]);
    if (part && !column_of.emplace(*part, static_cast<int>(i)).second) return std::optional<TrajectoryLayout>();
    const std::string bare = names[i].substr(0, names[i].find_first_of("[("));
    const bool counts = UnitOfColumn(bare) == TimeUnit::kFrames;
    if (!part && !time && !counts && NamesTime(bare)) time = static_cast<int>(i);
  }
  // A remark that ends with names is none: it has other words in front.
  const bool begins = NamesTime(names[0]) || PartOfPose(names[0]) || absl::StrContains(table.header, ',');
  if (column_of.size() != kNames.size() || !begins) return std::optional<TrajectoryLayout>();
  if (names.size() > num_fields) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": the header names ", names.size(), " columns, but line ",
                                                   table.lines[0].number, " has ", num_fields));
  }
  if (!time) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": no column of the header is a time: ", absl::StrJoin(names, ", "),
                     "; name it `timestamp`, or write lines of `t tx ty tz qx qy qz qw`"));
  }
  TrajectoryLayout layout;
  layout.time_column = *time;
  layout.named_unit = UnitOfColumn(names[static_cast<std::size_t>(*time)]);
  layout.num_columns = *time + 1;
  layout.most_columns = static_cast<int>(names.size());
  for (const auto& [part, column] : column_of) {
    layout.columns[static_cast<std::size_t>(part)] = column;
    layout.num_columns = std::max(layout.num_columns, column + 1);
  }
  // The ground truth of EuRoC is the body's; it names the frames R (reference) and S (sensor).
  const Fields first = SplitFields(table.lines[0].text);
  const bool as_euroc = absl::StrContains(table.lines[0].text, ',') && IsIntegerTime(first[0]);
  if (as_euroc || absl::StrContains(table.header, "RS_R")) layout.format = TrajectoryFormat::kEuroc;
  const TrajectoryLayout usual;
  constexpr std::array<int, 7> kEurocColumns = {1, 2, 3, 5, 6, 7, 4};
  const bool as_usual =
      layout.columns == usual.columns || (layout.format == TrajectoryFormat::kEuroc && layout.columns == kEurocColumns);
  if (!as_usual || layout.time_column != usual.time_column) {
    layout.note = absl::StrCat("the columns are those that its header names: ", layout.Describe());
  }
  if (layout.format == TrajectoryFormat::kEuroc) layout.usual_unit = TimeUnit::kNanoseconds;
  return std::optional<TrajectoryLayout>(layout);
}

}  // namespace

std::string TrajectoryLayout::Describe() const {
  if (matrix_column) {
    const bool whole = num_columns - *matrix_column == 16;
    return absl::StrCat(time_column ? "t " : "", "r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz",
                        whole ? " 0 0 0 1" : "");
  }
  std::map<int, std::string> by_column;
  if (time_column) by_column[*time_column] = format == TrajectoryFormat::kEuroc ? "ns" : "t";
  const char* const position = format == TrajectoryFormat::kEuroc ? "" : "t";
  for (std::size_t i = 0; i < kNames.size(); ++i)
    by_column[columns[i]] = absl::StrCat(i < 3 ? position : "", kNames[i]);
  return absl::StrJoin(by_column, format == TrajectoryFormat::kEuroc ? ", " : " ",
                       [](std::string* out, const auto& entry) { out->append(entry.second); });
}

absl::StatusOr<TrajectoryLayout> FindTrajectoryLayout(const std::string& path, const TextTable& table) {
  if (!table.header.empty()) {
    CAIRN_ASSIGN_OR_RETURN(std::optional<TrajectoryLayout> named, NamedLayout(path, table));
    if (named) return *std::move(named);
  }
  if (std::optional<TrajectoryLayout> matrix = MatrixLayout(table)) return *std::move(matrix);
  TrajectoryLayout layout;
  const Fields first = SplitFields(table.lines[0].text);
  if (absl::StrContains(table.lines[0].text, ',') && IsIntegerTime(first[0])) {
    layout.format = TrajectoryFormat::kEuroc;
    layout.usual_unit = TimeUnit::kNanoseconds;
    layout.columns = {1, 2, 3, 5, 6, 7, 4};
    layout.most_columns = 17;  // with velocity and biases
    if (table.header.empty()) {
      layout.note = "no header names the columns: read as EuRoC's, qw before qx qy qz, of the body";
    }
  }
  return layout;
}

}  // namespace cairn::io
