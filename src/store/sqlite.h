// A thin layer over SQLite's C API: connections, statements and transactions that clean up after themselves, errors as
// absl::Status with a Fault. Used inside cairn::store only. One thread at a time per connection.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace cairn::store {

using Bytes = std::span<const std::uint8_t>;

class Statement {
 public:
  enum class Type { kNull, kInteger, kReal, kText, kBlob };

  Statement() = default;
  Statement(sqlite3* connection, sqlite3_stmt* handle) : connection_(connection), handle_(handle) {}
  Statement(Statement&& other) noexcept;
  Statement& operator=(Statement&& other) noexcept;
  ~Statement();

  // Parameters count from 1. Text and blobs must live until the statement has been run. A failure shows in Step().
  void BindNull(int parameter);
  void Bind(int parameter, std::int64_t value);
  void Bind(int parameter, double value);
  void Bind(int parameter, absl::string_view text);
  void Bind(int parameter, Bytes blob);

  // True while there is a row. After the last row, or an error, the statement is ready to be bound and run again.
  absl::StatusOr<bool> Step();
  // Runs a statement to its end, ignoring rows.
  absl::Status Run();
  // Binds integers to the parameters from 1 on and runs.
  template <class... Ints>
  absl::Status RunWith(Ints... values) {
    int parameter = 0;
    (Bind(++parameter, static_cast<std::int64_t>(values)), ...);
    return Run();
  }
  void Reset();

  // A value as it is stored.
  struct Value {
    Type type = Type::kNull;
    std::int64_t bits = 0;  // the integer, or the bits of the double
    Bytes bytes;            // of a text or blob
  };

  // Columns of the current row count from 0. Text and blobs live until the next Step() or Reset().
  int num_columns() const;
  Type ColumnType(int column) const;
  std::int64_t Int(int column) const;
  double Real(int column) const;
  absl::string_view Text(int column) const;
  Bytes Blob(int column) const;
  // What type it has and what it is in one, in a third of the time.
  Value Get(int column) const;

 private:
  sqlite3* connection_ = nullptr;
  sqlite3_stmt* handle_ = nullptr;
  int bind_error_ = 0;
};

class Database {
 public:
  enum class Mode {
    kCreate,     // read and write; made if absent
    kReadWrite,  // must exist
    kQueryOnly,  // opened for reading and writing, so that SQLite can tidy up behind itself, but changes no content
    kReadOnly,   // without write permission
    kImmutable,  // on a medium where nothing can change meanwhile: needs no lock files
    kMemory,     // a new database in memory; `path` is ignored
  };

  static absl::StatusOr<std::unique_ptr<Database>> OpenFile(const std::string& path, Mode mode);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  // All statements must be gone.
  absl::Status Close();
  // However it is closed: the write-ahead log stays as it is.
  void LeaveLog();
  // Likewise, but leaves the write-ahead log as it is.
  absl::Status CloseWithoutFolding();

  absl::StatusOr<Statement> Prepare(absl::string_view sql);
  // One or several statements without parameters and results.
  absl::Status Execute(const std::string& sql);
  // The first column of the first row.
  absl::StatusOr<std::int64_t> QueryInt(absl::string_view sql);
  absl::StatusOr<std::string> QueryText(absl::string_view sql);

  // Rows that the last INSERT, UPDATE or DELETE changed.
  std::int64_t Changes() const;
  bool InTransaction() const;
  // How many pages this connection has read so far.
  std::int64_t PagesRead() const;

  // The first bytes of the file as it is on disk (docs/map-format.md); zeros beyond its end. Reads through SQLite's own
  // handle: opening the file a second time would drop the locks that this process holds on it.
  static constexpr std::size_t kHeaderBytes = 100;
  absl::StatusOr<std::array<std::uint8_t, kHeaderBytes>> ReadHeader();
  // Likewise any bytes, from `offset` on.
  absl::Status ReadRaw(std::span<std::uint8_t> bytes, std::int64_t offset);

  // As many of the first bytes of a blob as there is room for, without a copy of all of it on the way. False if the row
  // has no blob of so many.
  absl::StatusOr<bool> ReadBlob(const char* table, const char* column, std::int64_t row_id, std::span<char> bytes);

 private:
  explicit Database(sqlite3* handle) : handle_(handle) {}
  sqlite3* handle_;
};

// Rolls back unless committed.
class Transaction {
 public:
  enum class Kind { kRead, kWrite };
  static absl::StatusOr<Transaction> Begin(Database* database, Kind kind);
  Transaction(Transaction&& other) noexcept : database_(other.database_) { other.database_ = nullptr; }
  Transaction& operator=(Transaction&&) = delete;
  ~Transaction();
  absl::Status Commit();

 private:
  explicit Transaction(Database* database) : database_(database) {}
  Database* database_;
};

// The error of `connection` (null: of the code alone) as a Status: message, SQLite's extended code, and the Fault it
// means.
absl::Status SqliteError(sqlite3* connection, int code);

}  // namespace cairn::store
