// The pieces of SQLite's file format that are read without SQLite: records, and the numbers in headers
// (https://www.sqlite.org/fileformat2.html, sections 1.3 and 2.1). For what SQLite does not tell: whose a write-ahead
// log is (write_ahead_log.h), and what is left of a file that it refuses (salvage.h). Nothing that is read is trusted.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "store/sqlite.h"

namespace cairn::store {

inline constexpr std::size_t kSqliteHeaderBytes = 100;
inline constexpr std::size_t kPageSizeAt = 16;
inline constexpr std::size_t kFirstFreePageAt = 32;
inline constexpr std::size_t kFreePagesAt = 36;
inline constexpr std::size_t kSchemaCookieAt = 40;
inline constexpr std::size_t kUserVersionAt = 60;
inline constexpr std::size_t kApplicationIdAt = 68;

std::uint32_t BigEndian32(const std::uint8_t* at);
std::uint32_t BigEndian16(const std::uint8_t* at);
std::uint32_t LittleEndian32(const std::uint8_t* at);

// Of a database's header; what it says, which need not be a size that a page can have.
std::uint32_t PageBytesOf(Bytes header);
bool IsPageSize(std::uint32_t bytes);

// A variable-length integer at `*at`, which is moved behind it. False at the end of the bytes.
bool ReadVarint(Bytes bytes, std::size_t* at, std::uint64_t* value);

// One column of a record; refers to the record's bytes.
struct RecordColumn {
  std::uint64_t serial_type = 0;
  Bytes bytes;

  Statement::Type Type() const;
  std::int64_t Int() const;  // 0 if it is none
  double Real() const;       // 0 if it is none
  std::string Text() const;  // empty if it is none
};

// None if the bytes are not a record, or do not hold all of it.
std::optional<std::vector<RecordColumn>> ParseRecord(Bytes bytes);

}  // namespace cairn::store
