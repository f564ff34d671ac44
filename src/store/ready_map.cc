#include "store/ready_map.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "map/viewing.h"
#include "store/row.h"

namespace cairn::store {
namespace {

// Keyframes are asked for one by one: the best places of an image are all over the map.
class KeyframePages final : public map::TableSource<map::Keyframe> {
 public:
  explicit KeyframePages(std::shared_ptr<ReadyFile> file)
      : file_(std::move(file)), pages_((end() + kKeyframesPerPage - 1) / kKeyframesPerPage) {}
  ~KeyframePages() override {
    for (std::atomic<Page*>& page : pages_) delete page.load();
  }

  std::size_t size() const override { return file_->index().keyframes().size(); }
  std::uint32_t end() const override { return file_->index().next_keyframe.value(); }
  const void* content() const override { return file_.get(); }

  const std::shared_ptr<const map::Keyframe>& Find(std::uint32_t id) const override {
    static const std::shared_ptr<const map::Keyframe> none;
    const ReadyKeyframe* known = file_->index().Find(KeyframeId(id));
    if (known == nullptr) return none;
    std::atomic<Page*>& slot = pages_[id / kKeyframesPerPage];
    Entry* entry = nullptr;
    if (Page* page = slot.load(std::memory_order_acquire)) {
      entry = &page->entries[id % kKeyframesPerPage];
      if (entry->ready.load(std::memory_order_acquire)) return entry->keyframe;
    }
    const std::lock_guard lock(mutex_);
    Page* page = slot.load(std::memory_order_relaxed);
    if (page == nullptr) {
      page = Load(id / kKeyframesPerPage).release();
      slot.store(page, std::memory_order_release);
    }
    entry = &page->entries[id % kKeyframesPerPage];
    if (!entry->ready.load(std::memory_order_relaxed)) {
      entry->keyframe = Unpacked(*page, *known);
      entry->ready.store(true, std::memory_order_release);
    }
    return entry->keyframe;
  }

  std::size_t bytes() const { return bytes_.load(std::memory_order_relaxed); }

 private:
  struct Entry {
    std::atomic<bool> ready = false;
    std::shared_ptr<const map::Keyframe> keyframe;
  };
  struct Page {
    absl::Status status;  // what follows cannot be read
    std::string content;
    ReadyKeyframeEnds ends{};
    std::array<Entry, kKeyframesPerPage> entries;
  };

  std::unique_ptr<Page> Load(std::uint32_t number) const {
    auto page = std::make_unique<Page>();
    page->status = [&]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(page->content, file_->Read(ReadyKind::kKeyframes, number));
      CAIRN_ASSIGN_OR_RETURN(page->ends, FindReadyKeyframes(number, file_->index(), AsBytes(page->content)));
      return absl::OkStatus();
    }();
    bytes_.fetch_add(sizeof(Page) + page->content.capacity(), std::memory_order_relaxed);
    return page;
  }

  std::shared_ptr<const map::Keyframe> Unpacked(const Page& page, const ReadyKeyframe& known) const {
    auto keyframe = [&]() -> absl::StatusOr<std::shared_ptr<map::Keyframe>> {
      CAIRN_RETURN_IF_ERROR(page.status);
      const std::uint32_t place = known.id.value() % kKeyframesPerPage;
      const Bytes part = AsBytes(page.content).subspan(page.ends[place], page.ends[place + 1] - page.ends[place]);
      return UnpackReadyKeyframe(file_->index(), known, part);
    }();
    if (!keyframe.ok()) keyframe = WithoutPage(known, keyframe.status());
    map::Keyframe& unpacked = **keyframe;
    unpacked.features = file_->Features(known);
    bytes_.fetch_add(sizeof(map::Keyframe) + unpacked.points.capacity() * sizeof(PointId) +
                         unpacked.covisible.capacity() * sizeof(map::CovisibilityEdge) +
                         unpacked.children.capacity() * sizeof(KeyframeId),
                     std::memory_order_relaxed);
    return *std::move(keyframe);
  }

  std::shared_ptr<map::Keyframe> WithoutPage(const ReadyKeyframe& known, const absl::Status& why) const {
    auto keyframe = std::make_shared<map::Keyframe>();
    const map::Snapshot* tables = file_->TablesAfter(why);
    const map::Keyframe* stored = tables == nullptr ? nullptr : tables->keyframes().Find(known.id);
    if (stored != nullptr) {
      *keyframe = *stored;
      return keyframe;
    }
    if (tables == nullptr) file_->Note(why, ReadyKind::kKeyframes, known.id.value() / kKeyframesPerPage);
    keyframe->id = known.id;
    keyframe->session = known.session;
    keyframe->camera = known.camera;
    keyframe->component = known.component;
    keyframe->camera_from_map = known.camera_from_map;
    keyframe->points.resize(known.num_features);
    return keyframe;
  }

  const std::shared_ptr<ReadyFile> file_;
  mutable std::atomic<std::size_t> bytes_ = 0;
  mutable std::vector<std::atomic<Page*>> pages_;
  mutable std::mutex mutex_;  // of those who load a page or unpack a keyframe
};

// Points of a page lie together in memory, and go together.
class PointPages final : public map::TableSource<map::MapPoint> {
 public:
  explicit PointPages(std::shared_ptr<ReadyFile> file)
      : file_(std::move(file)), pages_((end() + kPointsPerPage - 1) / kPointsPerPage) {}
  ~PointPages() override {
    for (std::atomic<Page*>& page : pages_) delete page.load();
  }

  std::size_t size() const override { return file_->index().num_points(); }
  std::uint32_t end() const override { return file_->index().next_point.value(); }
  const void* content() const override { return file_.get(); }

  const std::shared_ptr<const map::MapPoint>& Find(std::uint32_t id) const override {
    static const std::shared_ptr<const map::MapPoint> none;
    if (!file_->index().HasPoint(PointId(id))) return none;
    std::atomic<Page*>& slot = pages_[id / kPointsPerPage];
    Page* page = slot.load(std::memory_order_acquire);
    if (page == nullptr) {
      const std::lock_guard lock(mutex_);
      page = slot.load(std::memory_order_relaxed);
      if (page == nullptr) {
        page = new Page(Load(id / kPointsPerPage));
        slot.store(page, std::memory_order_release);
      }
    }
    return (*page)[id % kPointsPerPage];
  }

  std::size_t bytes() const { return bytes_.load(std::memory_order_relaxed); }

 private:
  using Page = std::array<std::shared_ptr<const map::MapPoint>, kPointsPerPage>;

  Page Load(std::uint32_t number) const {
    const auto points = std::make_shared<std::vector<map::MapPoint>>();
    const absl::Status read = [&]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(const std::string content, file_->Read(ReadyKind::kPoints, number));
      return UnpackReadyPoints(number, file_->index(), AsBytes(content), points.get());
    }();
    if (!read.ok()) return WithoutPage(number, read);
    Complete(points.get());
    return Held(points);
  }

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

  const std::shared_ptr<ReadyFile> file_;
  mutable std::atomic<std::size_t> bytes_ = 0;
  mutable std::vector<std::atomic<Page*>> pages_;
  mutable std::mutex mutex_;  // of those who load a page
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
