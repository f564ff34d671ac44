#include "store/ready_file.h"

#include <utility>

#include "store/fault.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/row.h"
#include "store/sqlite_map_store.h"

namespace cairn::store {
namespace {

constexpr absl::string_view kSelectPage = "SELECT revision, bytes_checksum, bytes FROM ready_pages WHERE id = ?";

absl::StatusOr<std::optional<std::string>> PageOf(Statement* select, ReadyKind kind, std::uint32_t number,
                                                  Revision* revision) {
  const std::int64_t row_id = ReadyRowId(kind, number);
  select->Bind(1, row_id);
  CAIRN_ASSIGN_OR_RETURN(const bool found, select->Step());
  if (!found) return std::nullopt;
  const auto written = static_cast<Revision>(select->Int(0));
  const absl::StatusOr<Bytes> content = OpenReadyPage(row_id, written, select->Int(1), select->Blob(2));
  if (!content.ok()) {
    select->Reset();
    return content.status();
  }
  std::string copy(reinterpret_cast<const char*>(content->data()), content->size());
  select->Reset();
  if (revision != nullptr) *revision = written;
  return copy;
}

bool HasTable(Database* database) {
  const auto count = database->QueryInt("SELECT count(*) FROM sqlite_master WHERE name = 'ready_pages'");
  return count.ok() && *count == 1;
}

}  // namespace

absl::StatusOr<std::optional<std::string>> ReadReadyPage(Database* database, ReadyKind kind, std::uint32_t number,
                                                         Revision* revision) {
  if (!HasTable(database)) return std::nullopt;
  CAIRN_ASSIGN_OR_RETURN(Statement select, database->Prepare(kSelectPage));
  return PageOf(&select, kind, number, revision);
}

absl::StatusOr<std::optional<ReadyIndex>> ReadReadyIndex(Database* database) {
  Revision revision = 0;
  CAIRN_ASSIGN_OR_RETURN(const std::optional<std::string> page,
                         ReadReadyPage(database, ReadyKind::kIndex, 0, &revision));
  if (!page) return std::nullopt;
  CAIRN_ASSIGN_OR_RETURN(ReadyIndex index, ReadyIndex::Unpack(AsBytes(*page)));
  if (index.revision != revision) return absl::DataLossError("the index is of another revision than its page");
  return index;
}

ReadyFile::ReadyFile(std::string path, std::string resolved, ReadyIndex index, image::OrbParameters orb,
                     std::shared_ptr<map::FeatureCache> cache)
    : path_(std::move(path)),
      resolved_(std::move(resolved)),
      index_(std::move(index)),
      orb_(orb),
      cache_(std::move(cache)) {
  centers_.reserve(index_.keyframes().size());
  place_of_.resize(index_.next_keyframe.value());
  for (const ReadyKeyframe& keyframe : index_.keyframes()) {
    place_of_[keyframe.id.value()] = static_cast<std::uint32_t>(centers_.size());
    centers_.push_back(keyframe.camera_from_map.Inverse().translation());
  }
}

absl::Status ReadyFile::Open(const FileIdentity& identity) {
  CAIRN_ASSIGN_OR_RETURN(database_, OpenForReading(resolved_, &immutable_stamp_));
  if (!identity.IsAt(resolved_)) return MakeFault(Fault::kMoved, "it was replaced while it was opened; open it again");
  CAIRN_ASSIGN_OR_RETURN(select_, database_->Prepare(kSelectPage));
  return absl::OkStatus();
}

map::FeatureHandle ReadyFile::Features(const ReadyKeyframe& keyframe) {
  const std::lock_guard lock(mutex_);
  map::FeatureHandle& handle = handles_[keyframe.id];
  if (!handle) handle = cache_->OnDemand(keyframe.id, keyframe.num_features);
  return handle;
}

absl::StatusOr<std::string> ReadyFile::Read(ReadyKind kind, std::uint32_t number) {
  const std::lock_guard lock(mutex_);
  Revision revision = 0;
  CAIRN_ASSIGN_OR_RETURN(std::optional<std::string> page, PageOf(&select_, kind, number, &revision));
  if (!page) return absl::DataLossError("it is missing");
  if (revision > index_.revision || (!immutable_stamp_.empty() && FileStamp(resolved_) != immutable_stamp_)) {
    return MakeFault(Fault::kBusy, "it was written while it was read; open it again");
  }
  return *std::move(page);
}

const map::Snapshot* ReadyFile::TablesAfter(const absl::Status& why) {
  if (FaultOf(why) == Fault::kBusy) return nullptr;
  const std::lock_guard lock(tables_mutex_);
  if (tables_tried_) return tables_.get();
  tables_tried_ = true;
  LoadOptions load;
  load.feature_budget_bytes = 0;
  auto store = SqliteMapStore::OpenReadOnly(path_);
  if (!store.ok()) return nullptr;
  auto tables = (*store)->LoadSnapshot(load);
  if (tables.ok() && (*tables)->revision() == index_.revision) tables_ = *std::move(tables);
  return tables_.get();
}

void ReadyFile::Note(const absl::Status& error, ReadyKind kind, std::uint32_t number) {
  if (FaultOf(error) != Fault::kNone) return cache_->Note(Annotate(error, absl::StrCat("map ", path_)));
  cache_->Note(Annotate(DamagedBy({std::string(kReadyTable), ReadyRowId(kind, number), std::string(error.message())}),
                        absl::StrCat("map ", path_)));
}

double ReadyFile::FocalOf(CameraId id) const {
  for (const auto& [camera, focal] : index_.focal_px) {
    if (camera == id) return focal;
  }
  return 1.0;
}

}  // namespace cairn::store
