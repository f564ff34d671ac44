#include "store/row.h"

#include <algorithm>
#include <bit>
#include <utility>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace cairn::store {

static_assert(std::endian::native == std::endian::little, "the map format is little-endian");

std::int64_t BlobChecksum(Bytes bytes) { return std::bit_cast<std::int64_t>(XXH64(bytes.data(), bytes.size(), 0)); }

Row& Row::Int(std::int64_t value) {
  cells_.push_back({Statement::Type::kInteger, value, {}});
  return *this;
}

Row& Row::Real(double value) {
  cells_.push_back({Statement::Type::kReal, std::bit_cast<std::int64_t>(value), {}});
  return *this;
}

Row& Row::Text(absl::string_view value) {
  cells_.push_back({Statement::Type::kText, 0, AsBytes(value)});
  return *this;
}

Row& Row::TextCopy(std::string value) {
  owned_.push_front(std::move(value));
  return Text(owned_.front());
}

Row& Row::Blob(Bytes value) {
  cells_.push_back({Statement::Type::kBlob, 0, value});
  return *this;
}

Row& Row::Null() {
  cells_.push_back({});
  return *this;
}

std::int64_t Row::Checksum() const {
  // Long texts and blobs do not occur in rows; 512 bytes hold most rows without another allocation.
  std::string encoded;
  encoded.reserve(512);
  const auto append = [&encoded](std::int64_t value) {
    encoded.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  for (const Cell& cell : cells_) {
    switch (cell.type) {
      case Statement::Type::kInteger:
        encoded.push_back('i');
        append(cell.bits);
        break;
      case Statement::Type::kReal:
        encoded.push_back('r');
        append(cell.bits);
        break;
      case Statement::Type::kText:
      case Statement::Type::kBlob:
        encoded.push_back(cell.type == Statement::Type::kText ? 't' : 'b');
        append(static_cast<std::int64_t>(cell.bytes.size()));
        encoded.append(reinterpret_cast<const char*>(cell.bytes.data()), cell.bytes.size());
        break;
      case Statement::Type::kNull:
        encoded.push_back('n');
        break;
    }
  }
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(XXH64(encoded.data(), encoded.size(), 0)));
}

void Row::Bind(Statement* statement) const {
  int parameter = 0;
  for (const Cell& cell : cells_) {
    ++parameter;
    switch (cell.type) {
      case Statement::Type::kInteger:
        statement->Bind(parameter, cell.bits);
        break;
      case Statement::Type::kReal:
        statement->Bind(parameter, std::bit_cast<double>(cell.bits));
        break;
      case Statement::Type::kText:
        statement->Bind(parameter,
                        absl::string_view(reinterpret_cast<const char*>(cell.bytes.data()), cell.bytes.size()));
        break;
      case Statement::Type::kBlob:
        statement->Bind(parameter, cell.bytes);
        break;
      case Statement::Type::kNull:
        statement->BindNull(parameter);
        break;
    }
  }
}

void Row::BindWithChecksum(Statement* statement) const {
  Bind(statement);
  statement->Bind(static_cast<int>(cells_.size()) + 1, Checksum());
}

bool Row::SameAs(const Row& other) const {
  return std::equal(cells_.begin(), cells_.end(), other.cells_.begin(), other.cells_.end(),
                    [](const Cell& a, const Cell& b) {
                      return a.type == b.type && a.bits == b.bits &&
                             std::equal(a.bytes.begin(), a.bytes.end(), b.bytes.begin(), b.bytes.end());
                    });
}

bool Row::ReadWithChecksum(const Statement& statement) {
  cells_.clear();
  const int last = statement.num_columns() - 1;
  for (int column = 0; column < last; ++column) {
    switch (statement.ColumnType(column)) {
      case Statement::Type::kInteger:
        Int(statement.Int(column));
        break;
      case Statement::Type::kReal:
        Real(statement.Real(column));
        break;
      case Statement::Type::kText:
        Text(statement.Text(column));
        break;
      case Statement::Type::kBlob:
        Blob(statement.Blob(column));
        break;
      case Statement::Type::kNull:
        Null();
        break;
    }
  }
  return statement.ColumnType(last) == Statement::Type::kInteger && statement.Int(last) == Checksum();
}

}  // namespace cairn::store
