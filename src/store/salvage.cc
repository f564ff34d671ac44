#include "store/salvage.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <utility>

#include "store/migrations.h"
#include "store/page_image.h"
#include "store/tables.h"

namespace cairn::store {
namespace {

using Type = Statement::Type;

// A blob and the column that holds its checksum, by their places in TableSpec::columns.
struct CheckedBlob {
  std::size_t checksum;
  std::size_t blob;
};

// How rows of a table are told from whatever else has as many columns.
struct SalvagedTable {
  const TableSpec* spec;
  std::vector<CheckedBlob> blobs = {};  // empty: the last column is the checksum of the row
  absl::string_view blob_begins = {};   // the only one does
};

std::vector<SalvagedTable> AllTables(std::size_t format) {
  // Before format 4 tables `vocabulary` and `keyframe_points` look alike; docs/vocabulary.md, "File format".
  const absl::string_view vocabulary_begins = format < 4 ? "CAIRNVOC" : "";
  return {{&kMapTable},
          {&kCamerasTable},
          {&kLensesTable},
          {&kSessionsTable},
          {&kComponentsTable},
          {&kLoopsTable},
          {&kTrajectoriesTable},
          {&kKeyframesTable},
          {&kPointsTable},
          {&kCovisibilityTable},
          {&kChangesTable},
          {&kFeaturesTable, {{4, 7}, {5, 8}, {6, 9}}},
          {&kVocabularyTable, {{1, 2}}, vocabulary_begins},
          {&kKeyframePointsTable, {{1, 2}}}};
}

bool BeginsWith(Bytes bytes, absl::string_view prefix) {
  const Bytes wanted = AsBytes(prefix);
  return bytes.size() >= wanted.size() && std::equal(wanted.begin(), wanted.end(), bytes.begin());
}

// The statement that a row goes into, and where its columns stand in the file.
class TableSink {
 public:
  static absl::StatusOr<std::optional<TableSink>> Make(Database* database, const SalvagedTable& table) {
    TableSink sink(table);
    CAIRN_ASSIGN_OR_RETURN(Statement info, database->Prepare(absl::StrCat("SELECT name, pk FROM pragma_table_info('",
                                                                          table.spec->name, "') ORDER BY cid")));
    std::vector<std::string> declared;
    int keys = 0;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, info.Step());
      if (!found) break;
      declared.emplace_back(info.Text(0));
      keys += info.Int(1) > 0 ? 1 : 0;
    }
    if (declared.empty()) return std::optional<TableSink>();  // the format does not have it
    sink.num_columns_ = declared.size();
    // Tables of several keys are WITHOUT ROWID; in the others the key is the number of the row.
    sink.has_number_ = keys == 1;
    std::vector<absl::string_view> columns;
    bool has_revision = false;
    for (const absl::string_view column : table.spec->columns) {
      const auto at = std::ranges::find(declared, column);
      if (at == declared.end()) continue;  // of a later format
      sink.places_.push_back(static_cast<std::size_t>(at - declared.begin()));
      columns.push_back(column);
      has_revision = has_revision || (column == "revision" && table.spec != &kChangesTable);
    }
    // A table before format 4 may have columns that went; their rows have as many, in another order of meaning.
    if (columns.size() != declared.size() && table.spec->before_4.size() == declared.size()) {
      sink.places_.clear();
      columns.assign(table.spec->before_4.begin(), table.spec->before_4.end());
      for (const absl::string_view column : columns) {
        sink.places_.push_back(static_cast<std::size_t>(std::ranges::find(declared, column) - declared.begin()));
      }
    }
    std::string sql = absl::StrCat("INSERT INTO ", table.spec->name, " (");
    std::string values, updates;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      absl::StrAppend(&sql, i == 0 ? "" : ", ", columns[i]);
      absl::StrAppend(&values, i == 0 ? "?" : ", ?");
      if (i < table.spec->num_keys) continue;
      absl::StrAppend(&updates, updates.empty() ? "" : ", ", columns[i], " = excluded.", columns[i]);
    }
    absl::StrAppend(&sql, ") VALUES (", values, ") ON CONFLICT DO UPDATE SET ", updates);
    // Of two versions of a row, the one that a later change put.
    if (has_revision) absl::StrAppend(&sql, " WHERE excluded.revision >= ", table.spec->name, ".revision");
    CAIRN_ASSIGN_OR_RETURN(sink.put_, database->Prepare(sql));
    return sink;
  }

  // Whether the row is one of this table, by its checksums, and was kept.
  bool Take(const RawRow& raw) {
    if (raw.columns.size() != num_columns_ || raw.has_number != has_number_) return false;
    Row row = AsRow(raw);
    if (blobs_.empty()) {
      const RecordColumn& last = raw.columns[places_.back()];
      if (last.Type() != Type::kInteger || last.Int() != row.Checksum()) return false;
    } else {
      for (const CheckedBlob& checked : blobs_) {
        const RecordColumn& blob = raw.columns[places_[checked.blob]];
        if (blob.Type() != Type::kBlob || !BeginsWith(blob.bytes, blob_begins_)) return false;
        if (raw.columns[places_[checked.checksum]].Int() != BlobChecksum(blob.bytes)) return false;
      }
    }
    if (blobs_.empty()) {
      row.BindWithChecksum(&put_);
    } else {
      row.Bind(&put_);
    }
    // Values that the table does not take are those of no row that was ever written.
    return put_.Run().ok();
  }

 private:
  explicit TableSink(const SalvagedTable& table) : blobs_(table.blobs), blob_begins_(table.blob_begins) {}

  // In the order of the table's columns; without the checksum of the row.
  Row AsRow(const RawRow& raw) const {
    Row row;
    const std::size_t count = places_.size() - (blobs_.empty() ? 1 : 0);
    for (std::size_t i = 0; i < count; ++i) {
      const RecordColumn& column = raw.columns[places_[i]];
      if (i == 0 && has_number_) {
        row.Int(raw.number);
        continue;
      }
      switch (column.Type()) {
        case Type::kInteger:
          row.Int(column.Int());
          break;
        case Type::kReal:
          row.Real(column.Real());
          break;
        case Type::kText:
          row.TextCopy(column.Text());
          break;
        case Type::kBlob:
          row.Blob(column.bytes);
          break;
        case Type::kNull:
          row.Null();
          break;
      }
    }
    return row;
  }

  std::vector<CheckedBlob> blobs_;
  absl::string_view blob_begins_;
  bool has_number_ = false;
  std::size_t num_columns_ = 0;
  std::vector<std::size_t> places_;  // in the file, of the columns in their order
  Statement put_;
};

absl::StatusOr<Salvaged> SalvageAs(std::size_t format, PageImage& image) {
  Salvaged salvaged;
  CAIRN_ASSIGN_OR_RETURN(salvaged.rows, Database::OpenFile("", Database::Mode::kMemory));
  CAIRN_RETURN_IF_ERROR(Migrate(salvaged.rows.get(), BuiltInMigrations().first(format)));
  CAIRN_RETURN_IF_ERROR(salvaged.rows->Execute("PRAGMA foreign_keys = OFF"));
  std::vector<TableSink> sinks;
  for (const SalvagedTable& table : AllTables(format)) {
    CAIRN_ASSIGN_OR_RETURN(auto sink, TableSink::Make(salvaged.rows.get(), table));
    if (sink) sinks.push_back(*std::move(sink));
  }
  CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(salvaged.rows.get(), Transaction::Kind::kWrite));
  image.ForEachRow([&](const RawRow& row) {
    for (TableSink& sink : sinks) {
      if (!sink.Take(row)) continue;
      ++salvaged.num_rows;
      return;
    }
  });
  sinks.clear();
  CAIRN_RETURN_IF_ERROR(transaction.Commit());
  return salvaged;
}

}  // namespace

absl::StatusOr<Salvaged> SalvageRows(const std::string& path, const std::string& log) {
  CAIRN_ASSIGN_OR_RETURN(PageImage image, PageImage::Open(path, log));
  const std::size_t newest = BuiltInMigrations().size();
  const std::size_t said = image.user_version();
  const bool is_known = said >= 1 && said <= newest;
  CAIRN_ASSIGN_OR_RETURN(Salvaged best, SalvageAs(is_known ? said : newest, image));
  // The header may be wrong: tables of another format hold rows of theirs only.
  for (std::size_t format = newest; format >= 1; --format) {
    const auto has_keyframes = best.rows->QueryInt("SELECT count(*) FROM keyframes");
    if (has_keyframes.ok() && *has_keyframes > 0) break;
    CAIRN_ASSIGN_OR_RETURN(Salvaged other, SalvageAs(format, image));
    if (other.num_rows > best.num_rows) best = std::move(other);
  }
  if (best.num_rows == 0) return absl::DataLossError("nothing in it is a row of a Cairn map");
  if (!image.knows_free_pages()) {
    best.notes.emplace_back(
        "the list of unused pages is damaged: something that had been removed from the map may be back");
  }
  return best;
}

}  // namespace cairn::store
