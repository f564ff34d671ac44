#include "store/ready_pages.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "store/byte_stream.h"
#include "store/row.h"

namespace cairn::store {
namespace {

constexpr std::uint32_t kLayout = 1;
// Beyond so many ids per entity, and these at any rate, pages would be mostly empty.
constexpr std::uint64_t kMostIdsPerEntity = 64, kAlwaysFine = 1 << 16;
constexpr std::uint64_t kMostFeatures = 1 << 20;  // of a keyframe: a page of few bytes must not fill the memory

absl::Status Bad(absl::string_view what) { return absl::DataLossError(what); }

bool TooScattered(std::uint64_t next, std::uint64_t count) { return next > kMostIdsPerEntity * count + kAlwaysFine; }

void PutPose(const SE3& pose, ByteWriter* out) {
  const Quaterniond& q = pose.rotation();
  const Vector3d& t = pose.translation();
  for (const double value : {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()}) out->Fixed(value);
}

bool TakePose(ByteReader* in, SE3* pose) {
  double v[7];
  for (double& value : v) value = in->Fixed<double>();
  const Quaterniond rotation(v[3], v[0], v[1], v[2]);
  const Vector3d translation(v[4], v[5], v[6]);
  *pose = SE3::FromUnit(rotation, translation);
  return std::abs(rotation.norm() - 1.0) < 1e-6 && translation.allFinite();
}

std::int64_t Signed(std::uint32_t id) { return static_cast<std::int64_t>(id); }

// Takes an id that is written as the difference to another; 0 if it is none.
std::uint32_t TakeId(ByteReader* in, std::uint32_t from) {
  const std::int64_t difference = in->Zigzag();
  constexpr std::int64_t kMost = std::numeric_limits<std::uint32_t>::max();
  if (difference < -kMost || difference > kMost) return 0;
  const std::int64_t id = Signed(from) + difference;
  return id < 1 || id > kMost ? 0 : static_cast<std::uint32_t>(id);
}

}  // namespace

const absl::string_view kReadyTable = "ready_pages";
const absl::string_view kReadyTableSql =
    "CREATE TABLE IF NOT EXISTS ready_pages (\n"
    "  id INTEGER PRIMARY KEY,\n"
    "  revision INTEGER NOT NULL,\n"
    "  bytes_checksum INTEGER NOT NULL,\n"
    "  bytes BLOB NOT NULL\n"
    ")";

std::string SealReadyPage(std::int64_t row_id, Revision revision, absl::string_view content) {
  ByteWriter out;
  out.Fixed(row_id);
  out.Fixed(static_cast<std::uint64_t>(revision));
  out.Raw(content.data(), content.size());
  return out.Take();
}

absl::StatusOr<Bytes> OpenReadyPage(std::int64_t row_id, Revision revision, std::int64_t checksum, Bytes bytes) {
  if (checksum != BlobChecksum(bytes)) return Bad("wrong checksum");
  ByteReader in(bytes);
  const auto inner_id = in.Fixed<std::int64_t>();
  const auto inner_revision = in.Fixed<std::uint64_t>();
  if (!in.ok() || inner_id != row_id || inner_revision != revision) return Bad("it is another page's content");
  return in.Raw(in.left());
}

// --- the index ---

const ReadyKeyframe* ReadyIndex::Find(KeyframeId id) const {
  if (id.value() >= place_of_.size() || place_of_[id.value()] == 0) return nullptr;
  return &keyframes_[place_of_[id.value()] - 1];
}

void ReadyIndex::AddKeyframe(const ReadyKeyframe& keyframe) {
  place_of_.resize(next_keyframe.value());
  keyframes_.push_back(keyframe);
  place_of_[keyframe.id.value()] = static_cast<std::uint32_t>(keyframes_.size());
}

void ReadyIndex::AddPoint(PointId id) {
  points_.resize(next_point.value() / 64 + std::size_t{1});
  points_[id.value() / 64] |= std::uint64_t{1} << (id.value() % 64);
  ++num_points_;
}

std::string ReadyIndex::Pack() const {
  ByteWriter out;
  out.Varint(kLayout);
  out.Varint(revision);
  out.Varint(next_keyframe.value());
  out.Varint(next_point.value());
  out.Varint(focal_px.size());
  for (const auto& [camera, focal] : focal_px) {
    out.Varint(camera.value());
    out.Fixed(focal);
  }
  out.Varint(keyframes_.size());
  std::uint32_t last = 0;
  for (const ReadyKeyframe& keyframe : keyframes_) {
    out.Varint(keyframe.id.value() - last);
    out.Varint(keyframe.session.value());
    out.Varint(keyframe.camera.value());
    out.Varint(keyframe.component.value());
    out.Varint(keyframe.num_features);
    PutPose(keyframe.camera_from_map, &out);
    last = keyframe.id.value();
  }
  out.Varint(points_.size());
  out.Raw(points_.data(), points_.size() * sizeof(points_[0]));
  out.Varint(segments.size());
  for (const std::vector<KeyframeId>& segment : segments) {
    out.Varint(segment.size());
    last = 0;
    for (const KeyframeId id : segment) {
      out.Zigzag(Signed(id.value()) - Signed(last));
      last = id.value();
    }
  }
  return out.Take();
}

absl::StatusOr<ReadyIndex> ReadyIndex::Unpack(Bytes bytes) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint32_t>::max();
  ByteReader in(bytes);
  ReadyIndex index;
  if (in.Varint() != kLayout) return Bad("a layout that this software does not know");
  index.revision = in.Varint();
  index.next_keyframe = KeyframeId(static_cast<std::uint32_t>(in.VarintUpTo(kMost)));
  index.next_point = PointId(static_cast<std::uint32_t>(in.VarintUpTo(kMost)));
  const std::uint64_t cameras = in.VarintUpTo(bytes.size());
  for (std::uint64_t i = 0; i < cameras && in.ok(); ++i) {
    const CameraId camera(static_cast<std::uint32_t>(in.VarintUpTo(kMost)));
    const auto focal = in.Fixed<double>();
    if (!(focal > 0.0) || !std::isfinite(focal)) return Bad("a focal length is out of range");
    index.focal_px.emplace_back(camera, focal);
  }
  const std::uint64_t keyframes = in.VarintUpTo(bytes.size());
  if (!in.ok() || TooScattered(index.next_keyframe.value(), keyframes)) return Bad("it is cut off");
  index.keyframes_.reserve(keyframes);
  std::uint64_t last = 0;
  for (std::uint64_t i = 0; i < keyframes && in.ok(); ++i) {
    ReadyKeyframe keyframe;
    const std::uint64_t gap = in.VarintUpTo(kMost);
    last += gap;
    keyframe.session = SessionId(static_cast<std::uint32_t>(in.VarintUpTo(kMost)));
    keyframe.camera = CameraId(static_cast<std::uint32_t>(in.VarintUpTo(kMost)));
    keyframe.component = ComponentId(static_cast<std::uint32_t>(in.VarintUpTo(kMost)));
    keyframe.num_features = static_cast<std::uint32_t>(in.VarintUpTo(kMostFeatures));
    if (!TakePose(&in, &keyframe.camera_from_map) || gap == 0 || last >= index.next_keyframe.value()) {
      return Bad("a keyframe is out of range");
    }
    keyframe.id = KeyframeId(static_cast<std::uint32_t>(last));
    index.AddKeyframe(keyframe);
  }
  const std::uint64_t words = in.VarintUpTo(index.next_point.value() / 64 + std::uint64_t{1});
  const Bytes bits = in.Raw(words * sizeof(std::uint64_t));
  index.points_.resize(words);
  if (!bits.empty()) std::memcpy(index.points_.data(), bits.data(), bits.size());
  if (!index.points_.empty() && (index.points_[0] & 1) != 0) return Bad("point 0 is no point");
  for (const std::uint64_t word : index.points_) index.num_points_ += static_cast<std::size_t>(std::popcount(word));
  const std::uint64_t segments = in.VarintUpTo(bytes.size());
  for (std::uint64_t i = 0; i < segments && in.ok(); ++i) {
    const std::uint64_t entries = in.VarintUpTo(in.left());
    std::vector<KeyframeId>& segment = index.segments.emplace_back();
    std::uint32_t before = 0;
    for (std::uint64_t k = 0; k < entries && in.ok(); ++k) {
      before = TakeId(&in, before);
      if (before == 0) return Bad("a keyframe of the place index is out of range");
      segment.emplace_back(before);
    }
  }
  if (!in.ok() || in.left() != 0) return Bad("it does not end where it should");
  return index;
}

absl::StatusOr<std::optional<ReadyIndex>> IndexOf(const map::Snapshot& map) {
  ReadyIndex index;
  index.revision = map.revision();
  index.next_keyframe = map.next_keyframe();
  index.next_point = map.next_point();
  if (TooScattered(index.next_keyframe.value(), map.keyframes().size()) ||
      TooScattered(index.next_point.value(), map.points().size() + map.keyframes().size())) {
    return std::nullopt;
  }
  for (const auto& [id, camera] : map.cameras()) index.focal_px.emplace_back(id, camera.pinhole.fx_px);
  map.keyframes().ForEach([&](const auto& keyframe) {
    index.AddKeyframe({keyframe->id, keyframe->session, keyframe->camera, keyframe->component,
                       keyframe->camera_from_map, static_cast<std::uint32_t>(keyframe->features.size())});
  });
  map.points().ForEach([&](const auto& point) { index.AddPoint(point->id); });
  return index;
}

// --- keyframes ---

std::string PackReadyKeyframes(std::span<const map::Keyframe* const> keyframes) {
  ByteWriter out;
  for (const map::Keyframe* keyframe : keyframes) {
    const std::uint32_t id = keyframe->id.value();
    out.Zigzag(keyframe->time_ns);
    out.Zigzag(keyframe->frame_index);
    PutPose(keyframe->camera_from_direct, &out);
    out.Zigzag(keyframe->direct_segment);
    out.Zigzag(keyframe->parent ? Signed(keyframe->parent.value()) - Signed(id) : 0);
    out.Varint(keyframe->children.size());
    for (const KeyframeId child : keyframe->children) out.Zigzag(Signed(child.value()) - Signed(id));
    out.Varint(keyframe->covisible.size());
    for (const map::CovisibilityEdge& edge : keyframe->covisible) {
      out.Zigzag(Signed(edge.keyframe.value()) - Signed(id));
      out.Varint(static_cast<std::uint64_t>(edge.shared_points));
    }
    const auto observed = keyframe->points.size() - static_cast<std::size_t>(std::count(
                                                        keyframe->points.begin(), keyframe->points.end(), PointId()));
    out.Varint(observed);
    std::size_t next = 0;
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < keyframe->points.size(); ++i) {
      if (!keyframe->points[i]) continue;
      out.Varint(i - next);
      out.Zigzag(Signed(keyframe->points[i].value()) - Signed(last));
      next = i + 1;
      last = keyframe->points[i].value();
    }
  }
  return out.Take();
}

namespace {

absl::Status TakeKeyframe(const ReadyIndex& index, const ReadyKeyframe& known, ByteReader* in,
                          map::Keyframe* keyframe) {
  keyframe->id = known.id;
  keyframe->session = known.session;
  keyframe->camera = known.camera;
  keyframe->component = known.component;
  keyframe->camera_from_map = known.camera_from_map;
  const auto take = [&](bool* none_is_fine) {
    const KeyframeId id(TakeId(in, known.id.value()));
    if (none_is_fine != nullptr && id == known.id) {
      *none_is_fine = true;
      return KeyframeId();
    }
    return index.Find(id) == nullptr ? KeyframeId() : id;
  };
  keyframe->time_ns = in->Zigzag();
  keyframe->frame_index = in->Zigzag();
  if (!TakePose(in, &keyframe->camera_from_direct)) return Bad("a pose is no rigid transform");
  keyframe->direct_segment = in->Zigzag();
  bool no_parent = false;
  keyframe->parent = take(&no_parent);
  if (!keyframe->parent && !no_parent) return Bad("a parent is not there");
  const std::uint64_t children = in->VarintUpTo(in->left());
  for (std::uint64_t i = 0; i < children && in->ok(); ++i) {
    keyframe->children.push_back(take(nullptr));
    if (!keyframe->children.back()) return Bad("a child is not there");
  }
  const std::uint64_t edges = in->VarintUpTo(in->left());
  keyframe->covisible.reserve(edges);
  for (std::uint64_t i = 0; i < edges && in->ok(); ++i) {
    const KeyframeId other = take(nullptr);
    const std::uint64_t shared = in->VarintUpTo(std::numeric_limits<int>::max());
    if (!other) return Bad("a neighbour is not there");
    keyframe->covisible.push_back({other, static_cast<int>(shared)});
  }
  const std::uint64_t observed = in->VarintUpTo(in->left());
  keyframe->points.resize(known.num_features);
  std::uint64_t next = 0;
  std::uint32_t last = 0;
  for (std::uint64_t i = 0; i < observed && in->ok(); ++i) {
    const std::uint64_t feature = next + in->VarintUpTo(known.num_features);
    last = TakeId(in, last);
    if (feature >= known.num_features || !index.HasPoint(PointId(last))) return Bad("a feature's point is not there");
    keyframe->points[feature] = PointId(last);
    next = feature + 1;
  }
  return in->ok() ? absl::OkStatus() : Bad("it is cut off");
}

}  // namespace

absl::StatusOr<ReadyKeyframeEnds> FindReadyKeyframes(std::uint32_t number, const ReadyIndex& index, Bytes content) {
  constexpr std::size_t kPose = 7 * sizeof(double);
  ByteReader in(content);
  ReadyKeyframeEnds ends{};
  for (std::uint32_t i = 0; i < kKeyframesPerPage; ++i) {
    if (index.Find(KeyframeId(number * kKeyframesPerPage + i)) != nullptr) {
      in.SkipVarints(2);                                  // time, number of the frame
      in.Raw(kPose);                                      // camera_from_direct
      in.SkipVarints(2);                                  // segment, parent
      in.SkipVarints(in.Varint());                        // children
      in.SkipVarints(2 * in.VarintUpTo(content.size()));  // neighbours, each with the points that both see
      in.SkipVarints(2 * in.VarintUpTo(content.size()));  // features that have a point, each with it
      if (!in.ok()) return Bad("it is cut off");
    }
    ends[i + 1] = static_cast<std::uint32_t>(content.size() - in.left());
  }
  if (in.left() != 0) return Bad("there is more than it should hold");
  return ends;
}

absl::StatusOr<std::shared_ptr<map::Keyframe>> UnpackReadyKeyframe(const ReadyIndex& index, const ReadyKeyframe& known,
                                                                   Bytes part) {
  ByteReader in(part);
  auto keyframe = std::make_shared<map::Keyframe>();
  CAIRN_RETURN_IF_ERROR(TakeKeyframe(index, known, &in, keyframe.get()));
  if (in.left() != 0) return Bad("there is more than it should hold");
  return keyframe;
}

// --- points ---

std::string PackReadyPoints(std::span<const map::MapPoint* const> points) {
  ByteWriter out;
  for (const map::MapPoint* point : points) {
    for (const double value : {point->position.x(), point->position.y(), point->position.z()}) out.Fixed(value);
    out.Zigzag(point->times_visible);
    out.Zigzag(point->times_found);
    out.Varint(point->observations.size());
    std::uint32_t last = 0;
    std::size_t reference = 0;
    for (std::size_t i = 0; i < point->observations.size(); ++i) {
      const map::Observation& observation = point->observations[i];
      out.Varint(observation.keyframe.value() - last);
      out.Varint(observation.feature);
      if (observation == point->reference) reference = i;
      last = observation.keyframe.value();
    }
    out.Varint(reference);
  }
  return out.Take();
}

namespace {

absl::Status TakePoint(const ReadyIndex& index, ByteReader* in, map::MapPoint* point) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint32_t>::max();
  constexpr std::int64_t kMostCount = std::numeric_limits<int>::max();
  const auto x = in->Fixed<double>(), y = in->Fixed<double>(), z = in->Fixed<double>();
  point->position = Vector3d(x, y, z);
  if (!point->position.allFinite()) return Bad("a position is not finite");
  const std::int64_t visible = in->Zigzag(), found = in->Zigzag();
  if (std::abs(visible) > kMostCount || std::abs(found) > kMostCount) return Bad("a count is out of range");
  point->times_visible = static_cast<int>(visible);
  point->times_found = static_cast<int>(found);
  const std::uint64_t count = in->VarintUpTo(in->left());
  if (count == 0) return Bad("a point without observations");
  point->observations.reserve(count);
  std::uint64_t last = 0;
  for (std::uint64_t i = 0; i < count && in->ok(); ++i) {
    const std::uint64_t gap = in->VarintUpTo(kMost), feature = in->VarintUpTo(kMost);
    last += gap;
    const ReadyKeyframe* keyframe =
        last > kMost || gap == 0 ? nullptr : index.Find(KeyframeId(static_cast<std::uint32_t>(last)));
    if (keyframe == nullptr || feature >= keyframe->num_features) return Bad("an observation is of no keyframe");
    point->observations.push_back({keyframe->id, static_cast<std::uint32_t>(feature)});
  }
  const std::uint64_t reference = in->Varint();
  if (!in->ok() || reference >= point->observations.size()) return Bad("it is cut off");
  point->reference = point->observations[reference];
  return absl::OkStatus();
}

}  // namespace

absl::Status UnpackReadyPoints(std::uint32_t number, const ReadyIndex& index, Bytes bytes,
                               std::vector<map::MapPoint>* points) {
  ByteReader in(bytes);
  points->clear();
  std::size_t count = 0;
  for (std::uint32_t i = 0; i < kPointsPerPage; ++i) {
    count += index.HasPoint(PointId(number * kPointsPerPage + i)) ? 1 : 0;
  }
  points->reserve(count);
  for (std::uint32_t i = 0; i < kPointsPerPage; ++i) {
    const PointId id(number * kPointsPerPage + i);
    if (!index.HasPoint(id)) continue;
    map::MapPoint& point = points->emplace_back();
    point.id = id;
    CAIRN_RETURN_IF_ERROR(TakePoint(index, &in, &point));
  }
  return in.left() == 0 ? absl::OkStatus() : Bad("there is more than it should hold");
}

}  // namespace cairn::store
