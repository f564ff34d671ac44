#include "store/ready_map.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include "map/viewing.h"
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

// What sources of one file share.
class ReadyFile {
 public:
  ReadyFile(std::string path, std::string resolved, ReadyIndex index, image::OrbParameters orb,
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

  absl::Status Open(const FileIdentity& identity) {
    CAIRN_ASSIGN_OR_RETURN(database_, OpenForReading(resolved_, &immutable_stamp_));
    if (!identity.IsAt(resolved_))
      return MakeFault(Fault::kMoved, "it was replaced while it was opened; open it again");
    CAIRN_ASSIGN_OR_RETURN(select_, database_->Prepare(kSelectPage));
    return absl::OkStatus();
  }

  const ReadyIndex& index() const { return index_; }

  // The features of a keyframe of the index: the same handle whoever asks.
  map::FeatureHandle Features(const ReadyKeyframe& keyframe) {
    const std::lock_guard lock(mutex_);
    map::FeatureHandle& handle = handles_[keyframe.id];
    if (!handle) handle = cache_->OnDemand(keyframe.id, keyframe.num_features);
    return handle;
  }

  // As it was when the index was written.
  absl::StatusOr<std::string> Read(ReadyKind kind, std::uint32_t number) {
    const std::lock_guard lock(mutex_);
    Revision revision = 0;
    CAIRN_ASSIGN_OR_RETURN(std::optional<std::string> page, PageOf(&select_, kind, number, &revision));
    if (!page) return absl::DataLossError("it is missing");
    if (revision > index_.revision || (!immutable_stamp_.empty() && FileStamp(resolved_) != immutable_stamp_)) {
      return MakeFault(Fault::kBusy, "it was written while it was read; open it again");
    }
    return *std::move(page);
  }

  // The map of the index from its tables, for when a page cannot be read; null if that is no help: the map has moved
  // on, or is damaged itself.
  const map::Snapshot* TablesAfter(const absl::Status& why) {
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

  void Note(const absl::Status& error, ReadyKind kind, std::uint32_t number) {
    if (FaultOf(error) != Fault::kNone) return cache_->Note(Annotate(error, absl::StrCat("map ", path_)));
    cache_->Note(Annotate(DamagedBy({std::string(kReadyTable), ReadyRowId(kind, number), std::string(error.message())}),
                          absl::StrCat("map ", path_)));
  }

  const Vector3d& CenterOf(KeyframeId id) const { return centers_[place_of_[id.value()]]; }
  double FocalOf(CameraId id) const {
    for (const auto& [camera, focal] : index_.focal_px) {
      if (camera == id) return focal;
    }
    return 1.0;
  }
  const image::OrbParameters& orb() const { return orb_; }

 private:
  const std::string path_, resolved_;
  const ReadyIndex index_;
  const image::OrbParameters orb_;
  const std::shared_ptr<map::FeatureCache> cache_;
  std::vector<Vector3d> centers_;        // of the keyframes of the index
  std::vector<std::uint32_t> place_of_;  // there, by id
  std::string immutable_stamp_;

  std::mutex tables_mutex_;  // guards these two
  bool tables_tried_ = false;
  std::shared_ptr<const map::Snapshot> tables_;

  std::mutex mutex_;  // guards what follows
  std::unordered_map<KeyframeId, map::FeatureHandle> handles_;
  std::unique_ptr<Database> database_;
  Statement select_;  // after the database: it goes first
};

// The pages of one table. `Derived` fills one.
template <class Derived, class T, std::uint32_t kPerPage>
class PagedTable : public map::TableSource<T> {
 public:
  using Page = std::array<std::shared_ptr<const T>, kPerPage>;

  PagedTable(std::shared_ptr<ReadyFile> file, std::uint32_t end)
      : file_(std::move(file)), end_(end), pages_((std::size_t{end} + kPerPage - 1) / kPerPage) {}
  ~PagedTable() override {
    for (std::atomic<Page*>& page : pages_) delete page.load();
  }

  std::uint32_t end() const override { return end_; }
  const void* content() const override { return file_.get(); }

  const std::shared_ptr<const T>& Find(std::uint32_t id) const override {
    static const std::shared_ptr<const T> none;
    const auto& self = static_cast<const Derived&>(*this);
    if (id >= end_ || !self.Has(id)) return none;
    std::atomic<Page*>& slot = pages_[id / kPerPage];
    Page* page = slot.load(std::memory_order_acquire);
    if (page == nullptr) {
      const std::lock_guard lock(mutex_);
      page = slot.load(std::memory_order_relaxed);
      if (page == nullptr) {
        page = new Page(self.Load(id / kPerPage));
        slot.store(page, std::memory_order_release);
      }
    }
    return (*page)[id % kPerPage];
  }

  std::size_t bytes() const { return bytes_.load(std::memory_order_relaxed); }

 protected:
  const std::shared_ptr<ReadyFile> file_;
  mutable std::atomic<std::size_t> bytes_ = 0;

 private:
  const std::uint32_t end_;
  mutable std::vector<std::atomic<Page*>> pages_;
  mutable std::mutex mutex_;  // of those who load a page
};

class KeyframePages final : public PagedTable<KeyframePages, map::Keyframe, kKeyframesPerPage> {
 public:
  explicit KeyframePages(std::shared_ptr<ReadyFile> file) : PagedTable(file, file->index().next_keyframe.value()) {}

  std::size_t size() const override { return file_->index().keyframes().size(); }
  bool Has(std::uint32_t id) const { return file_->index().Find(KeyframeId(id)) != nullptr; }

  Page Load(std::uint32_t number) const {
    Page page;
    auto keyframes = [&]() -> absl::StatusOr<std::vector<std::shared_ptr<map::Keyframe>>> {
      CAIRN_ASSIGN_OR_RETURN(const std::string content, file_->Read(ReadyKind::kKeyframes, number));
      return UnpackReadyKeyframes(number, file_->index(), AsBytes(content));
    }();
    if (!keyframes.ok()) keyframes = WithoutPage(number, keyframes.status());
    std::size_t bytes = sizeof(Page);
    for (auto& keyframe : *keyframes) {
      keyframe->features = file_->Features(*file_->index().Find(keyframe->id));
      bytes += sizeof(map::Keyframe) + keyframe->points.capacity() * sizeof(PointId) +
               keyframe->covisible.capacity() * sizeof(map::CovisibilityEdge) +
               keyframe->children.capacity() * sizeof(KeyframeId);
      page[keyframe->id.value() % kKeyframesPerPage] = std::move(keyframe);
    }
    bytes_.fetch_add(bytes, std::memory_order_relaxed);
    return page;
  }

 private:
  std::vector<std::shared_ptr<map::Keyframe>> WithoutPage(std::uint32_t number, const absl::Status& why) const {
    const map::Snapshot* tables = file_->TablesAfter(why);
    if (tables == nullptr) file_->Note(why, ReadyKind::kKeyframes, number);
    std::vector<std::shared_ptr<map::Keyframe>> keyframes;
    for (std::uint32_t i = 0; i < kKeyframesPerPage; ++i) {
      const ReadyKeyframe* known = file_->index().Find(KeyframeId(number * kKeyframesPerPage + i));
      if (known == nullptr) continue;
      auto& keyframe = keyframes.emplace_back(std::make_shared<map::Keyframe>());
      const map::Keyframe* stored = tables == nullptr ? nullptr : tables->keyframes().Find(known->id);
      if (stored != nullptr) {
        *keyframe = *stored;
        continue;
      }
      keyframe->id = known->id;
      keyframe->session = known->session;
      keyframe->camera = known->camera;
      keyframe->component = known->component;
      keyframe->camera_from_map = known->camera_from_map;
      keyframe->points.resize(known->num_features);
    }
    return keyframes;
  }
};

class PointPages final : public PagedTable<PointPages, map::MapPoint, kPointsPerPage> {
 public:
  explicit PointPages(std::shared_ptr<ReadyFile> file) : PagedTable(file, file->index().next_point.value()) {}

  std::size_t size() const override { return file_->index().num_points(); }
  bool Has(std::uint32_t id) const { return file_->index().HasPoint(PointId(id)); }

  Page Load(std::uint32_t number) const {
    // Points of a page lie together in memory, and go together.
    const auto points = std::make_shared<std::vector<map::MapPoint>>();
    const absl::Status read = [&]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(const std::string content, file_->Read(ReadyKind::kPoints, number));
      return UnpackReadyPoints(number, file_->index(), AsBytes(content), points.get());
    }();
    if (!read.ok()) return WithoutPage(number, read);
    Complete(points.get());
    return Held(points);
  }

 private:
  Page Held(const std::shared_ptr<std::vector<map::MapPoint>>& points) const {
    Page page;
    std::size_t bytes = sizeof(Page) + points->capacity() * sizeof(map::MapPoint);
    for (map::MapPoint& point : *points) {
      bytes += point.observations.capacity() * sizeof(map::Observation);
      page[point.id.value() % kPointsPerPage] = std::shared_ptr<const map::MapPoint>(points, &point);
    }
    bytes_.fetch_add(bytes, std::memory_order_relaxed);
    return page;
  }

  Page WithoutPage(std::uint32_t number, const absl::Status& why) const {
    const auto points = std::make_shared<std::vector<map::MapPoint>>();
    const map::Snapshot* tables = file_->TablesAfter(why);
    if (tables == nullptr) {
      file_->Note(why, ReadyKind::kPoints, number);
      StandIns(number, points.get());
      Complete(points.get());
      return Held(points);
    }
    for (std::uint32_t i = 0; i < kPointsPerPage; ++i) {
      const map::MapPoint* stored = tables->points().Find(PointId(number * kPointsPerPage + i));
      if (stored != nullptr) points->push_back(*stored);
    }
    return Held(points);
  }

  // What follows from features and from where the keyframes are.
  void Complete(std::vector<map::MapPoint>* points) const {
    std::unordered_map<KeyframeId, std::shared_ptr<const map::KeyframeFeatures>> features;
    std::vector<Vector3d> centers;
    for (map::MapPoint& point : *points) {
      const ReadyKeyframe& reference = *file_->index().Find(point.reference.keyframe);
      auto& of_reference = features[reference.id];
      if (of_reference == nullptr) of_reference = file_->Features(reference).Get();
      point.descriptor = of_reference->features.descriptors[point.reference.feature];
      centers.clear();
      for (const map::Observation& observation : point.observations) {
        centers.push_back(file_->CenterOf(observation.keyframe));
      }
      map::SetViewing(map::ComputeViewing(point.position, centers, file_->CenterOf(reference.id),
                                          of_reference->features.keypoints[point.reference.feature].octave,
                                          file_->FocalOf(reference.camera), file_->orb()),
                      &point);
    }
  }

  // Each seen once, so that whoever looks who sees it finds somebody.
  void StandIns(std::uint32_t number, std::vector<map::MapPoint>* points) const {
    points->clear();
    const auto& keyframes = file_->index().keyframes();
    const auto with_features =
        std::ranges::find_if(keyframes, [](const ReadyKeyframe& keyframe) { return keyframe.num_features > 0; });
    if (with_features == keyframes.end()) return;
    for (std::uint32_t i = 0; i < kPointsPerPage; ++i) {
      const PointId id(number * kPointsPerPage + i);
      if (!file_->index().HasPoint(id)) continue;
      map::MapPoint& point = points->emplace_back();
      point.id = id;
      point.reference = {with_features->id, 0};
      point.observations = {point.reference};
    }
  }
};

class ReadySource final : public map::EntitySource {
 public:
  explicit ReadySource(std::shared_ptr<ReadyFile> file)
      : file_(std::move(file)),
        keyframes_(std::make_shared<const KeyframePages>(file_)),
        points_(std::make_shared<const PointPages>(file_)) {}

  std::shared_ptr<const map::TableSource<map::Keyframe>> keyframes() const override { return keyframes_; }
  std::shared_ptr<const map::TableSource<map::MapPoint>> points() const override { return points_; }
  std::size_t bytes() const override { return keyframes_->bytes() + points_->bytes(); }
  std::shared_ptr<const map::EntitySource> Anew() const override { return std::make_shared<const ReadySource>(file_); }

 private:
  const std::shared_ptr<ReadyFile> file_;
  const std::shared_ptr<const KeyframePages> keyframes_;
  const std::shared_ptr<const PointPages> points_;
};

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

absl::StatusOr<std::shared_ptr<const map::EntitySource>> OpenReadySource(const std::string& path,
                                                                         const std::string& resolved,
                                                                         const FileIdentity& identity, ReadyIndex index,
                                                                         const image::OrbParameters& orb,
                                                                         std::shared_ptr<map::FeatureCache> cache) {
  auto file = std::make_shared<ReadyFile>(path, resolved, std::move(index), orb, std::move(cache));
  CAIRN_RETURN_IF_ERROR(file->Open(identity));
  return std::make_shared<const ReadySource>(std::move(file));
}

}  // namespace cairn::store
