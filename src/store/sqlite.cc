#include "store/sqlite.h"

#include <sqlite3.h>

#include <bit>
#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/escaping.h"
#include "store/fault.h"

namespace cairn::store {
namespace {

constexpr int kBusyTimeoutMs = 5000;

bool IsOutOfSpace(int system_errno) {
  return system_errno == ENOSPC || system_errno == EFBIG || system_errno == EDQUOT;
}

// The operating system's reason for an input or output error. sqlite3_system_errno() knows it only if nothing else went
// on meanwhile; the files of the database remember it.
int SystemErrno(sqlite3* connection) {
  if (connection == nullptr) return 0;
  if (const int known = sqlite3_system_errno(connection); known != 0) return known;
  for (const int which : {SQLITE_FCNTL_FILE_POINTER, SQLITE_FCNTL_JOURNAL_POINTER}) {
    sqlite3_file* file = nullptr;
    int last = 0;
    if (sqlite3_file_control(connection, "main", which, &file) == SQLITE_OK && file != nullptr &&
        file->pMethods != nullptr && file->pMethods->xFileControl(file, SQLITE_FCNTL_LAST_ERRNO, &last) == SQLITE_OK &&
        last != 0) {
      return last;
    }
  }
  return 0;
}

Fault FaultOfCode(int code, int system_errno) {
  switch (code & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_FORMAT:
    case SQLITE_SCHEMA:
    case SQLITE_TOOBIG:
    case SQLITE_MISMATCH:
    case SQLITE_ERROR:  // our own SQL is right, so the tables it names are not
      return Fault::kDamaged;
    case SQLITE_FULL:
      return Fault::kFull;
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return Fault::kReadOnly;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
    case SQLITE_PROTOCOL:
      return Fault::kBusy;
    case SQLITE_CANTOPEN:
      if (system_errno == EACCES || system_errno == EROFS || system_errno == EPERM) return Fault::kReadOnly;
      return IsOutOfSpace(system_errno) ? Fault::kFull : Fault::kIo;
    case SQLITE_IOERR:
      if (code == SQLITE_IOERR_CORRUPTFS) return Fault::kDamaged;
      return IsOutOfSpace(system_errno) ? Fault::kFull : Fault::kIo;
    default:
      return Fault::kIo;
  }
}

absl::string_view Advice(Fault fault) {
  switch (fault) {
    case Fault::kDamaged:
      return "the file is damaged";
    case Fault::kFull:
      return "there is no room left on the disk, or the file may not grow further; nothing of this change is stored";
    case Fault::kReadOnly:
      return "no permission to write the file or its folder";
    case Fault::kBusy:
      return "the map is being written by another process; try again later";
    default:
      return "the database could not be used";
  }
}

}  // namespace

absl::Status SqliteError(sqlite3* connection, int code) {
  if (code == SQLITE_OK) return absl::OkStatus();
  const int extended = connection != nullptr ? sqlite3_extended_errcode(connection) : code;
  if ((extended & 0xff) == (code & 0xff)) code = extended;
  const char* text = connection != nullptr ? sqlite3_errmsg(connection) : sqlite3_errstr(code);
  const int primary = code & 0xff;
  const bool is_system = primary == SQLITE_IOERR || primary == SQLITE_CANTOPEN || primary == SQLITE_FULL;
  const int system_errno = is_system ? SystemErrno(connection) : 0;
  std::string detail = absl::StrCat("SQLite: ", text, ", code ", code);
  if (system_errno != 0) absl::StrAppend(&detail, ", ", std::strerror(system_errno));
  if (primary == SQLITE_CONSTRAINT) {
    return absl::InvalidArgumentError(absl::StrCat("the change breaks a rule of the map file (", detail, ")"));
  }
  if (primary == SQLITE_NOMEM) return absl::ResourceExhaustedError(absl::StrCat("out of memory (", detail, ")"));
  const Fault fault = FaultOfCode(code, system_errno);
  return MakeFault(fault, absl::StrCat(Advice(fault), " (", detail, ")"));
}

// --- Statement ---

Statement::Statement(Statement&& other) noexcept { *this = std::move(other); }

Statement& Statement::operator=(Statement&& other) noexcept {
  std::swap(connection_, other.connection_);
  std::swap(handle_, other.handle_);
  std::swap(bind_error_, other.bind_error_);
  return *this;
}

Statement::~Statement() { sqlite3_finalize(handle_); }

void Statement::BindNull(int parameter) {
  if (const int rc = sqlite3_bind_null(handle_, parameter); rc != SQLITE_OK) bind_error_ = rc;
}

void Statement::Bind(int parameter, std::int64_t value) {
  if (const int rc = sqlite3_bind_int64(handle_, parameter, value); rc != SQLITE_OK) bind_error_ = rc;
}

void Statement::Bind(int parameter, double value) {
  if (const int rc = sqlite3_bind_double(handle_, parameter, value); rc != SQLITE_OK) bind_error_ = rc;
}

void Statement::Bind(int parameter, absl::string_view text) {
  const char* data = text.data() != nullptr ? text.data() : "";
  const int rc = sqlite3_bind_text64(handle_, parameter, data, text.size(), SQLITE_STATIC, SQLITE_UTF8);
  if (rc != SQLITE_OK) bind_error_ = rc;
}

void Statement::Bind(int parameter, Bytes blob) {
  const int rc = blob.empty() ? sqlite3_bind_zeroblob(handle_, parameter, 0)
                              : sqlite3_bind_blob64(handle_, parameter, blob.data(), blob.size(), SQLITE_STATIC);
  if (rc != SQLITE_OK) bind_error_ = rc;
}

absl::StatusOr<bool> Statement::Step() {
  if (bind_error_ != SQLITE_OK) return SqliteError(connection_, std::exchange(bind_error_, SQLITE_OK));
  const int rc = sqlite3_step(handle_);
  if (rc == SQLITE_ROW) return true;
  if (rc == SQLITE_DONE) {
    sqlite3_reset(handle_);
    return false;
  }
  absl::Status status = SqliteError(connection_, rc);
  sqlite3_reset(handle_);
  return status;
}

absl::Status Statement::Run() {
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool row, Step());
    if (!row) return absl::OkStatus();
  }
}

void Statement::Reset() { sqlite3_reset(handle_); }

int Statement::num_columns() const { return sqlite3_column_count(handle_); }

namespace {

Statement::Type TypeOf(int code) {
  switch (code) {
    case SQLITE_INTEGER:
      return Statement::Type::kInteger;
    case SQLITE_FLOAT:
      return Statement::Type::kReal;
    case SQLITE_TEXT:
      return Statement::Type::kText;
    case SQLITE_BLOB:
      return Statement::Type::kBlob;
    default:
      return Statement::Type::kNull;
  }
}

}  // namespace

Statement::Type Statement::ColumnType(int column) const { return TypeOf(sqlite3_column_type(handle_, column)); }

Statement::Value Statement::Get(int column) const {
  // Connections are of one thread at a time (SQLITE_OPEN_NOMUTEX), so that these values may be looked at as they are:
  // https://sqlite.org/c3ref/value.html.
  sqlite3_value* stored = sqlite3_column_value(handle_, column);
  Value value;
  value.type = TypeOf(sqlite3_value_type(stored));
  switch (value.type) {
    case Type::kInteger:
      value.bits = sqlite3_value_int64(stored);
      break;
    case Type::kReal:
      value.bits = std::bit_cast<std::int64_t>(sqlite3_value_double(stored));
      break;
    case Type::kText: {
      const auto* text = sqlite3_value_text(stored);
      if (text != nullptr) value.bytes = {text, static_cast<std::size_t>(sqlite3_value_bytes(stored))};
      break;
    }
    case Type::kBlob: {
      const auto* blob = static_cast<const std::uint8_t*>(sqlite3_value_blob(stored));
      if (blob != nullptr) value.bytes = {blob, static_cast<std::size_t>(sqlite3_value_bytes(stored))};
      break;
    }
    case Type::kNull:
      break;
  }
  return value;
}

std::int64_t Statement::Int(int column) const { return sqlite3_column_int64(handle_, column); }

double Statement::Real(int column) const { return sqlite3_column_double(handle_, column); }

absl::string_view Statement::Text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(handle_, column));
  if (text == nullptr) return {};
  return {text, static_cast<std::size_t>(sqlite3_column_bytes(handle_, column))};
}

Bytes Statement::Blob(int column) const {
  const auto* blob = static_cast<const std::uint8_t*>(sqlite3_column_blob(handle_, column));
  if (blob == nullptr) return {};
  return {blob, static_cast<std::size_t>(sqlite3_column_bytes(handle_, column))};
}

// --- Database ---

namespace {

// A file name as an SQLite URI, which understands immutable=1.
std::string FileUri(const std::string& path, absl::string_view query) {
  std::string uri = path.front() == '/' ? "file://" : "file:";
  for (const char c : path) {
    if (c == '%' || c == '?' || c == '#') {
      absl::StrAppend(&uri, "%", absl::BytesToHexString(absl::string_view(&c, 1)));
    } else {
      uri.push_back(c);
    }
  }
  return absl::StrCat(uri, "?", query);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Database>> Database::OpenFile(const std::string& path, Mode mode) {
  int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_READWRITE;
  std::string name = path;
  if (mode == Mode::kCreate) flags |= SQLITE_OPEN_CREATE;
  if (mode == Mode::kReadOnly) flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_READONLY;
  if (mode == Mode::kImmutable) {
    flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_READONLY | SQLITE_OPEN_URI;
    name = FileUri(path, "immutable=1");
  }
  if (mode == Mode::kMemory) {
    flags |= SQLITE_OPEN_CREATE | SQLITE_OPEN_MEMORY;
    name = ":memory:";
  }
  sqlite3* handle = nullptr;
  const int rc = sqlite3_open_v2(name.c_str(), &handle, flags, nullptr);
  std::unique_ptr<Database> database(new Database(handle));
  if (rc != SQLITE_OK) return SqliteError(handle, rc);
  sqlite3_extended_result_codes(handle, 1);
  sqlite3_busy_timeout(handle, kBusyTimeoutMs);
  // Nothing inside a file that came from elsewhere may run code or bend SQLite's own tables.
  sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  // These do not touch the file.
  CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA foreign_keys = ON; PRAGMA cell_size_check = ON"));
  if (mode == Mode::kQueryOnly) CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA query_only = ON"));
  return database;
}

Database::~Database() { sqlite3_close_v2(handle_); }

absl::Status Database::Close() {
  if (const int rc = sqlite3_close(handle_); rc != SQLITE_OK) return SqliteError(handle_, rc);
  handle_ = nullptr;
  return absl::OkStatus();
}

void Database::LeaveLog() { sqlite3_db_config(handle_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr); }

absl::Status Database::CloseWithoutFolding() {
  LeaveLog();
  return Close();
}

absl::StatusOr<Statement> Database::Prepare(absl::string_view sql) {
  sqlite3_stmt* statement = nullptr;
  const int rc = sqlite3_prepare_v3(handle_, sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT,
                                    &statement, nullptr);
  if (rc != SQLITE_OK) return SqliteError(handle_, rc);
  return Statement(handle_, statement);
}

absl::Status Database::Execute(const std::string& sql) {
  return SqliteError(handle_, sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr));
}

absl::StatusOr<std::int64_t> Database::QueryInt(absl::string_view sql) {
  CAIRN_ASSIGN_OR_RETURN(Statement statement, Prepare(sql));
  CAIRN_ASSIGN_OR_RETURN(const bool row, statement.Step());
  if (!row) return MakeFault(Fault::kDamaged, absl::StrCat("no answer to: ", sql));
  return statement.Int(0);
}

absl::StatusOr<std::string> Database::QueryText(absl::string_view sql) {
  CAIRN_ASSIGN_OR_RETURN(Statement statement, Prepare(sql));
  CAIRN_ASSIGN_OR_RETURN(const bool row, statement.Step());
  if (!row) return MakeFault(Fault::kDamaged, absl::StrCat("no answer to: ", sql));
  return std::string(statement.Text(0));
}

std::int64_t Database::Changes() const { return sqlite3_changes64(handle_); }

bool Database::InTransaction() const { return sqlite3_get_autocommit(handle_) == 0; }

std::int64_t Database::PagesRead() const {
  int now = 0, highest = 0;
  sqlite3_db_status(handle_, SQLITE_DBSTATUS_CACHE_MISS, &now, &highest, 0);
  return now;
}

absl::StatusOr<std::array<std::uint8_t, Database::kHeaderBytes>> Database::ReadHeader() {
  std::array<std::uint8_t, kHeaderBytes> header{};
  CAIRN_RETURN_IF_ERROR(ReadRaw(header, 0));
  return header;
}

absl::Status Database::ReadRaw(std::span<std::uint8_t> bytes, std::int64_t offset) {
  sqlite3_file* file = nullptr;
  int rc = sqlite3_file_control(handle_, "main", SQLITE_FCNTL_FILE_POINTER, &file);
  if (rc != SQLITE_OK) return SqliteError(handle_, rc);
  rc = file->pMethods->xRead(file, bytes.data(), static_cast<int>(bytes.size()), offset);
  if (rc != SQLITE_OK && rc != SQLITE_IOERR_SHORT_READ) return SqliteError(nullptr, rc);
  return absl::OkStatus();
}

absl::StatusOr<bool> Database::ReadBlob(const char* table, const char* column, std::int64_t row_id,
                                        std::span<char> bytes) {
  sqlite3_blob* blob = nullptr;
  int rc = sqlite3_blob_open(handle_, "main", table, column, row_id, /*flags=*/0, &blob);
  if (rc == SQLITE_ERROR) return false;  // no such row, or something else in it
  if (rc != SQLITE_OK) return SqliteError(handle_, rc);
  const bool enough = bytes.size() <= static_cast<std::size_t>(sqlite3_blob_bytes(blob));
  if (enough) rc = sqlite3_blob_read(blob, bytes.data(), static_cast<int>(bytes.size()), 0);
  const absl::Status status = SqliteError(handle_, rc);
  sqlite3_blob_close(blob);
  if (!status.ok()) return status;
  return enough;
}

// --- Transaction ---

absl::StatusOr<Transaction> Transaction::Begin(Database* database, Kind kind) {
  CAIRN_RETURN_IF_ERROR(database->Execute(kind == Kind::kWrite ? "BEGIN IMMEDIATE" : "BEGIN"));
  return Transaction(database);
}

Transaction::~Transaction() {
  // SQLite has rolled back by itself after some errors; a failing ROLLBACK leaves nothing to be done either.
  if (database_ != nullptr && database_->InTransaction()) database_->Execute("ROLLBACK").IgnoreError();
}

absl::Status Transaction::Commit() {
  CAIRN_RETURN_IF_ERROR(database_->Execute("COMMIT"));
  database_ = nullptr;
  return absl::OkStatus();
}

}  // namespace cairn::store
