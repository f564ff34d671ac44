// Rows of a map file with values that nobody wrote, of whoever makes checksums that fit. The bytes are changes of a
// small map, one after another: table, row, column, the type of the new value, and the value. Whatever is in there, the
// map is loaded, or what is wrong with it is found; nothing else happens.
#include <array>
#include <cstring>
#include <fstream>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "store/sqlite.h"
#include "store/sqlite_map_store.h"
#include "store/tables.h"
#include "store/testing_maps.h"
#include "testing_scratch_folder.h"

using namespace cairn;
using store::Statement;

namespace {

constexpr std::size_t kNumTables = 15;
const std::array<const store::TableSpec*, kNumTables>& Tables() {
  static const std::array<const store::TableSpec*, kNumTables> tables = {&store::kMapTable,
                                                                         &store::kCamerasTable,
                                                                         &store::kLensesTable,
                                                                         &store::kSessionsTable,
                                                                         &store::kComponentsTable,
                                                                         &store::kLoopsTable,
                                                                         &store::kTrajectoriesTable,
                                                                         &store::kKeyframesTable,
                                                                         &store::kPointsTable,
                                                                         &store::kCovisibilityTable,
                                                                         &store::kChangesTable,
                                                                         &store::kFeaturesTable,
                                                                         &store::kKeyframePointsTable,
                                                                         &store::kVocabularyTable,
                                                                         &store::kTouchedTable};
  return tables;
}

void Require(bool good) {
  if (!good) std::abort();
}

// Bytes taken from the front; zeros when there are no more.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : bytes_(data, size) {}
  bool empty() const { return bytes_.empty(); }
  std::uint8_t Byte() { return Take<std::uint8_t>(); }
  template <class T>
  T Take() {
    T value{};
    const std::size_t count = std::min(sizeof(T), bytes_.size());
    std::memcpy(&value, bytes_.data(), count);
    bytes_ = bytes_.subspan(count);
    return value;
  }
  std::string Text(std::size_t size) {
    const std::size_t count = std::min(size, bytes_.size());
    std::string text(reinterpret_cast<const char*>(bytes_.data()), count);
    bytes_ = bytes_.subspan(count);
    return text;
  }

 private:
  store::Bytes bytes_;
};

// One of everything that a map can have.
std::string SmallMap(const ScratchFolder& folder) {
  const std::string path = folder.path("good.cairn");
  auto made = store::SqliteMapStore::Create(
      path, store::testing::TestInfo(), {.vocabulary = std::string(40, 'w'), .write = {.sync_every_commit = false}});
  Require(made.ok());
  store::testing::MapGrower grower(1, {.features = 8, .new_points = 3});
  store::testing::SnapshotPtr map = map::Snapshot::Empty(store::testing::TestInfo());
  const auto commit = [&](const map::Delta& delta) {
    map = *map->Apply(delta);
    Require((*made)->Commit(delta).ok());
  };
  commit(grower.Start(map));
  for (int i = 0; i < 4; ++i) commit(grower.AddKeyframe(map));
  commit(grower.Align(map));
  map::Edit edit(map);
  map::MapCamera camera = map->cameras().begin()->second;
  camera.lens = LensCorrection{1.001, 0.01, 0.0};
  edit.PutCamera(camera);
  map::Session session = map->sessions().begin()->second;
  session.loops.push_back({KeyframeId(4), 2, KeyframeId(1), 1, 50, 1.01, 0.25, 0.1, 60.5});
  session.trajectory = map::ReportedTrajectory{true, 4, 0, "refined: a loop was closed"};
  edit.PutSession(session);
  edit.AddComponent({ComponentId(), SessionId(1)});
  map::MapInfo info = map->info();
  info.geo_anchor = map::GeoAnchor{60.17, 24.94, 30.0};
  edit.SetInfo(info);
  commit(edit.Finish("what else there is"));
  Require((*made)->Close().ok());
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct Cell {
  Statement::Type type = Statement::Type::kNull;
  std::int64_t number = 0;
  double real = 0.0;
  std::string bytes;
};

Cell CellAt(const Statement& row, int column) {
  Cell cell;
  cell.type = row.ColumnType(column);
  if (cell.type == Statement::Type::kInteger) cell.number = row.Int(column);
  if (cell.type == Statement::Type::kReal) cell.real = row.Real(column);
  if (cell.type == Statement::Type::kText) cell.bytes = std::string(row.Text(column));
  if (cell.type == Statement::Type::kBlob) {
    const store::Bytes blob = row.Blob(column);
    cell.bytes.assign(reinterpret_cast<const char*>(blob.data()), blob.size());
  }
  return cell;
}

void Change(Input* input, Cell* cell) {
  switch (input->Byte() % 8) {
    case 0:
      *cell = {};
      break;
    case 1:
      *cell = {.type = Statement::Type::kInteger, .number = input->Take<std::int64_t>()};
      break;
    case 2:
      *cell = {.type = Statement::Type::kInteger, .number = input->Take<std::int8_t>()};
      break;
    case 3:
      *cell = {.type = Statement::Type::kReal, .real = input->Take<double>()};
      break;
    case 4:
      cell->type = Statement::Type::kText;
      cell->bytes = input->Text(input->Byte());
      break;
    case 5:
      cell->type = Statement::Type::kBlob;
      cell->bytes = input->Text(input->Byte());
      break;
    case 6: {  // a part of what is there
      const std::size_t at = cell->bytes.empty() ? 0 : input->Byte() % cell->bytes.size();
      const std::string part = input->Text(input->Byte() % 16);
      cell->bytes.replace(at, part.size(), part);
      break;
    }
    default:
      cell->bytes.resize(cell->bytes.size() * input->Byte() / 64);
  }
}

store::Row RowOf(const std::vector<Cell>& cells, std::size_t count) {
  store::Row row;
  for (std::size_t i = 0; i < count; ++i) {
    const Cell& cell = cells[i];
    if (cell.type == Statement::Type::kNull) row.Null();
    if (cell.type == Statement::Type::kInteger) row.Int(cell.number);
    if (cell.type == Statement::Type::kReal) row.Real(cell.real);
    if (cell.type == Statement::Type::kText) row.Text(cell.bytes);
    if (cell.type == Statement::Type::kBlob) row.Blob(store::AsBytes(cell.bytes));
  }
  return row;
}

// The next change that the input asks for, with the checksums that it needs. What SQLite does not take is left out.
void ChangeRow(Input* input, store::Database* database) {
  const store::TableSpec& table = *Tables()[input->Byte() % kNumTables];
  std::vector<Cell> cells;
  {
    auto rows = database->Prepare(table.SelectSql(absl::StrCat("LIMIT 1 OFFSET ", int{input->Byte()} % 8)));
    Require(rows.ok());
    const auto found = rows->Step();
    if (!found.ok() || !*found) return;
    for (int i = 0; i < rows->num_columns(); ++i) cells.push_back(CellAt(*rows, i));
  }
  const std::size_t column = input->Byte() % cells.size();
  const bool whole_row = table.columns.back() == "row_checksum";
  Change(input, &cells[column]);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto checked =
        std::find(table.columns.begin(), table.columns.end(), absl::StrCat(table.columns[i], "_checksum"));
    if (checked == table.columns.end()) continue;
    Cell& checksum = cells[static_cast<std::size_t>(checked - table.columns.begin())];
    checksum = {.type = Statement::Type::kInteger, .number = store::BlobChecksum(store::AsBytes(cells[i].bytes))};
  }
  auto put = database->Prepare(table.UpsertSql());
  Require(put.ok());
  const store::Row row = RowOf(cells, whole_row ? cells.size() - 1 : cells.size());
  if (whole_row) {
    row.BindWithChecksum(&*put);
  } else {
    row.Bind(&*put);
  }
  (void)put->Run();
}

void ReadAll(const std::string& path) {
  const auto map = store::SqliteMapStore::OpenReadOnly(path);
  if (!map.ok()) return;
  const auto loaded = (*map)->LoadSnapshot();
  const auto findings = (*map)->Verify();
  if (!loaded.ok() && findings.ok() && findings->empty()) std::abort();
  (void)(*map)->LoadVocabulary();
  (void)(*map)->ReadSummary();
  (void)(*map)->ReadChanges();
  (void)(*map)->ContentDigest();
  if (loaded.ok()) (void)(*map)->ReadDelta(**loaded);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const ScratchFolder folder;
  static const std::string good = SmallMap(folder);
  folder.Write("a.cairn", good);
  for (const char* beside : {"a.cairn-wal", "a.cairn-shm"}) std::remove(folder.path(beside).c_str());
  const std::string path = folder.path("a.cairn");
  {
    auto database = store::Database::OpenFile(path, store::Database::Mode::kReadWrite);
    Require(database.ok());
    Require((*database)->Execute("PRAGMA foreign_keys = OFF; PRAGMA synchronous = OFF; BEGIN").ok());
    Input input(data, size);
    for (int i = 0; i < 16 && !input.empty(); ++i) ChangeRow(&input, database->get());
    Require((*database)->Execute("COMMIT").ok());
  }
  ReadAll(path);
  return 0;
}
