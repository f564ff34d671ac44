// What is in a map as rows and columns, sorted and filtered by any column: for people, scripts and viewers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::inspect {

enum class Kind { kKeyframes, kPoints, kSessions, kComponents, kCameras };

struct Column {
  std::string name;  // with its unit as suffix: "error_px"
  bool text = false;
  int decimals = 0;   // of numbers that are not whole
  std::string brief;  // a start of the name that no other column shares, where columns must be narrow; empty: the name
};

// One value. Nothing: not known, as the error of a keyframe that observes no point.
struct Cell {
  enum class Kind { kNothing, kWhole, kReal, kFlag, kText };

  Cell() = default;
  Cell(std::int64_t value) : kind(Kind::kWhole), whole(value) {}
  Cell(double value) : kind(Kind::kReal), real(value) {}
  Cell(bool value) : kind(Kind::kFlag), whole(value ? 1 : 0) {}
  Cell(std::string value) : kind(Kind::kText), text(std::move(value)) {}

  // Of all but texts and nothing.
  double Number() const { return kind == Kind::kReal ? real : static_cast<double>(whole); }

  Kind kind = Kind::kNothing;
  std::int64_t whole = 0;  // of a flag 0 or 1
  double real = 0.0;
  std::string text;
};

struct Listing {
  std::vector<Column> columns;
  std::vector<std::vector<Cell>> rows;
  std::size_t total = 0;  // rows that fit the filters, of which `limit` are here
};

struct ListingQuery {
  std::string sort = "id";  // a column, or a start of its name that no other shares
  bool descending = false;
  // COLUMN OPERATOR VALUE, with a column as above and =, !=, <, <=, >, >=, and ~ for texts that contain VALUE; all must
  // hold. What is not known fits only !=.
  std::vector<std::string> filters;
  std::size_t limit = 0;  // 0: all
};

// Columns of a kind, in their order; "id" is the first. Positions (x, y, z) and lengths are metres in the world where
// the component is aligned, else map units of the component.
std::vector<Column> ColumnsOf(Kind kind);

// Filters, sorts and limits the rows of a listing. InvalidArgument for a column, an operator or a value that makes no
// sense. Rows that are equal in the column they are sorted by keep their order; what is not known comes last.
absl::Status Arrange(const ListingQuery& query, Listing* listing);

// Whether List() looks at no more rows than it gives: of the first or last keyframes or points by their ids, without
// filters.
bool LooksAtFew(Kind kind, const ListingQuery& query);

// Everything of a kind, arranged; in the order of ids before.
absl::StatusOr<Listing> List(const map::Snapshot& map, Kind kind, const ListingQuery& query = {});
// The one row of this id; none if there is none. Of a keyframe or a point no others are looked at than those it refers
// to.
std::optional<Listing> ListOne(const map::Snapshot& map, Kind kind, std::uint32_t id);

// A cell as text, "" if not known.
std::string CellText(const Column& column, const Cell& cell);

}  // namespace cairn::inspect
