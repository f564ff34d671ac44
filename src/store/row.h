// One row of a table as values, whatever the table: what is bound, what is read, what the row's checksum covers.
#pragma once

#include <cstdint>
#include <forward_list>
#include <string>
#include <vector>

#include "store/sqlite.h"

namespace cairn::store {

// xxHash64 with seed 0, as the signed integer that SQLite stores.
std::int64_t BlobChecksum(Bytes bytes);
inline Bytes AsBytes(absl::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// Text and blobs are views: they must outlive the row, but for TextCopy().
class Row {
 public:
  Row() { cells_.reserve(16); }
  Row(Row&&) = default;
  Row& operator=(Row&&) = default;

  Row& Int(std::int64_t value);
  Row& Real(double value);
  Row& Text(absl::string_view value);
  Row& TextCopy(std::string value);
  Row& Blob(Bytes value);
  Row& Null();

  std::size_t size() const { return cells_.size(); }

  // The low 32 bits of the xxHash64 (seed 0) of all cells in order, each as one letter and its value: 'i' and 8 bytes,
  // 'r' and the 8 bytes of the IEEE double, 't' or 'b' and the length in 8 bytes and the bytes, 'n' for NULL; all
  // little-endian.
  std::int64_t Checksum() const;

  // Binds the cells from parameter 1 on, and their checksum after them.
  void BindWithChecksum(Statement* statement) const;
  // The cells alone.
  void Bind(Statement* statement) const;

  // Equal to the bit: 0.0 and -0.0 differ, as do 1 and 1.0.
  bool SameAs(const Row& other) const;

  // The cells of the statement's current row but for the last, which holds their checksum; false if that does not fit.
  bool ReadWithChecksum(const Statement& statement);

  // A cell as a statement gives it, for who has read many rows: without asking SQLite again. Cells count from 0.
  std::int64_t IntAt(int cell) const;
  double RealAt(int cell) const;

 private:
  using Cell = Statement::Value;
  std::vector<Cell> cells_;
  std::forward_list<std::string> owned_;
};

}  // namespace cairn::store
