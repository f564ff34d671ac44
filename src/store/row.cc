#include "store/row.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
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
  // Long texts and blobs do not occur in rows; the buffer holds most rows without an allocation.
  std::array<char, 512> buffer;
  std::string longer;
  std::size_t size = 0;
  for (const Cell& cell : cells_) size += 1 + sizeof(std::int64_t) + cell.bytes.size();
  char* encoded = buffer.data();
  if (size > buffer.size()) {
    longer.resize(size);
    encoded = longer.data();
  }
  char* end = encoded;
  const auto append = [&end](char letter, std::int64_t value) {
    *end++ = letter;
    std::memcpy(end, &value, sizeof(value));
    end += sizeof(value);
  };
  for (const Cell& cell : cells_) {
    switch (cell.type) {
      case Statement::Type::kInteger:
        append('i', cell.bits);
        break;
      case Statement::Type::kReal:
        append('r', cell.bits);
        break;
      case Statement::Type::kText:
      case Statement::Type::kBlob:
        append(cell.type == Statement::Type::kText ? 't' : 'b', static_cast<std::int64_t>(cell.bytes.size()));
        if (!cell.bytes.empty()) std::memcpy(end, cell.bytes.data(), cell.bytes.size());
        end += cell.bytes.size();
        break;
      case Statement::Type::kNull:
        *end++ = 'n';
        break;
    }
  }
  const std::uint64_t hash = XXH64(encoded, static_cast<std::size_t>(end - encoded), 0);
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(hash));
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
  for (int column = 0; column < last; ++column) cells_.push_back(statement.Get(column));
  const Cell checksum = statement.Get(last);
  return checksum.type == Statement::Type::kInteger && checksum.bits == Checksum();
}

std::int64_t Row::IntAt(int cell) const {
  const Cell& value = cells_[static_cast<std::size_t>(cell)];
  if (value.type == Statement::Type::kInteger) return value.bits;
  return value.type == Statement::Type::kReal ? static_cast<std::int64_t>(std::bit_cast<double>(value.bits)) : 0;
}

double Row::RealAt(int cell) const {
  const Cell& value = cells_[static_cast<std::size_t>(cell)];
  if (value.type == Statement::Type::kReal) return std::bit_cast<double>(value.bits);
  return value.type == Statement::Type::kInteger ? static_cast<double>(value.bits) : 0.0;
}

}  // namespace cairn::store
