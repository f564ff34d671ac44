#include "store/sqlite_record.h"

#include <array>
#include <bit>

namespace cairn::store {
namespace {

constexpr std::uint64_t kRealType = 7, kZeroType = 8, kOneType = 9, kFirstBlobType = 12;

bool IsInteger(std::uint64_t type) { return (type >= 1 && type < kRealType) || type == kZeroType || type == kOneType; }

std::size_t SizeOfType(std::uint64_t type) {
  constexpr std::array<std::size_t, 12> kSizes = {0, 1, 2, 3, 4, 6, 8, 8, 0, 0, 0, 0};
  return type < kSizes.size() ? kSizes[type] : static_cast<std::size_t>((type - kFirstBlobType) / 2);
}

}  // namespace

std::uint32_t BigEndian32(const std::uint8_t* at) {
  return static_cast<std::uint32_t>(at[0]) << 24 | static_cast<std::uint32_t>(at[1]) << 16 |
         static_cast<std::uint32_t>(at[2]) << 8 | at[3];
}

std::uint32_t BigEndian16(const std::uint8_t* at) { return static_cast<std::uint32_t>(at[0]) << 8 | at[1]; }

std::uint32_t LittleEndian32(const std::uint8_t* at) {
  return static_cast<std::uint32_t>(at[3]) << 24 | static_cast<std::uint32_t>(at[2]) << 16 |
         static_cast<std::uint32_t>(at[1]) << 8 | at[0];
}

std::uint32_t PageBytesOf(Bytes header) {
  const std::uint32_t bytes = BigEndian16(header.data() + kPageSizeAt);
  return bytes == 1 ? 65536 : bytes;
}

bool IsPageSize(std::uint32_t bytes) { return bytes >= 512 && bytes <= 65536 && std::has_single_bit(bytes); }

bool ReadVarint(Bytes bytes, std::size_t* at, std::uint64_t* value) {
  *value = 0;
  for (int i = 0; i < 9; ++i) {
    if (*at >= bytes.size()) return false;
    const std::uint8_t byte = bytes[(*at)++];
    if (i == 8) {
      *value = *value << 8 | byte;
      return true;
    }
    *value = *value << 7 | (byte & 0x7f);
    if ((byte & 0x80) == 0) return true;
  }
  return true;
}

Statement::Type RecordColumn::Type() const {
  if (IsInteger(serial_type)) return Statement::Type::kInteger;
  if (serial_type == kRealType) return Statement::Type::kReal;
  if (serial_type < kFirstBlobType) return Statement::Type::kNull;
  return serial_type % 2 == 0 ? Statement::Type::kBlob : Statement::Type::kText;
}

std::int64_t RecordColumn::Int() const {
  if (serial_type == kOneType) return 1;
  if (!IsInteger(serial_type) || bytes.empty()) return 0;
  std::uint64_t value = (bytes[0] & 0x80) != 0 ? ~std::uint64_t{0} : 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return std::bit_cast<std::int64_t>(value);
}

double RecordColumn::Real() const {
  if (serial_type != kRealType) return 0.0;
  std::uint64_t value = 0;
  for (const std::uint8_t byte : bytes) value = value << 8 | byte;
  return std::bit_cast<double>(value);
}

std::string RecordColumn::Text() const {
  if (Type() != Statement::Type::kText) return {};
  return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

std::optional<std::vector<RecordColumn>> ParseRecord(Bytes bytes) {
  std::size_t at = 0;
  std::uint64_t header_bytes = 0;
  if (!ReadVarint(bytes, &at, &header_bytes) || header_bytes > bytes.size()) return std::nullopt;
  const Bytes header = bytes.first(header_bytes);
  std::size_t body = header_bytes;
  std::vector<RecordColumn> columns;
  while (at < header.size()) {
    RecordColumn column;
    if (!ReadVarint(header, &at, &column.serial_type)) return std::nullopt;
    const std::size_t size = SizeOfType(column.serial_type);
    if (size > bytes.size() - body) return std::nullopt;
    column.bytes = bytes.subspan(body, size);
    body += size;
    columns.push_back(column);
  }
  return columns;
}

}  // namespace cairn::store
