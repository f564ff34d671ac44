// Writing updates; convert_deltas_reading.cc reads them.
#include "wire/convert_deltas.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "store/blobs.h"
#include "wire/convert.h"
#include "wire/convert_map_rows.h"

namespace cairn::wire {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers in bytes are copied as they are");

constexpr std::size_t kVocabularyPartBytes = 1 << 20;

// Collects rows, and sends them as they become enough for a message.
class RowSender {
 public:
  explicit RowSender(const std::function<bool(const v1::FollowMapResponse&)>& send) : send_(send) {}

  // To which a row of about `bytes` is added.
  v1::UpdateRows* Room(std::size_t bytes) {
    if (size_ > 0 && size_ + bytes > kUpdateMessageBytes) Flush();
    size_ += bytes;
    return message_.mutable_rows();
  }
  // The same for a row that is made already.
  template <class Row>
  void Add(Row row, google::protobuf::RepeatedPtrField<Row>* (v1::UpdateRows::*rows)()) {
    const std::size_t bytes = row.ByteSizeLong();
    *((Room(bytes)->*rows)()->Add()) = std::move(row);
  }
  void Flush() {
    if (size_ == 0 || !good_) return;
    bytes_ += static_cast<std::int64_t>(message_.rows().ByteSizeLong());
    good_ = send_(message_);
    message_.Clear();
    size_ = 0;
  }

  bool good() const { return good_; }
  std::int64_t bytes() const { return bytes_; }

 private:
  const std::function<bool(const v1::FollowMapResponse&)>& send_;
  v1::FollowMapResponse message_;
  std::size_t size_ = 0;  // of its rows, roughly
  std::int64_t bytes_ = 0;
  bool good_ = true;
};

void WriteFeatures(const map::KeyframeFeatures& features, v1::FeaturesRow* out) {
  store::PackedFeatures packed = store::PackFeatures(features);
  out->set_count(static_cast<std::uint32_t>(packed.count));
  out->set_keypoint_layout(static_cast<std::uint32_t>(packed.layout));
  out->set_word_bytes(static_cast<std::uint32_t>(packed.word_bytes));
  out->set_keypoints(std::move(packed.keypoints));
  out->set_descriptors(std::move(packed.descriptors));
  out->set_words(std::move(packed.words));
}

// What of a map is sent.
struct Part {
  const map::Snapshot& map;
  const std::vector<KeyframeId>* only;  // null: all

  bool Contains(KeyframeId id) const { return only == nullptr || std::ranges::binary_search(*only, id); }
  const map::Keyframe* Find(KeyframeId id) const { return Contains(id) ? map.keyframes().Find(id) : nullptr; }
  // The keyframe whose descriptor is the point's; none: no keyframe of the part observes it.
  KeyframeId ReferenceOf(const map::MapPoint& point) const {
    if (Contains(point.reference.keyframe)) return point.reference.keyframe;
    for (const map::Observation& observation : point.observations) {
      if (Contains(observation.keyframe)) return observation.keyframe;
    }
    return {};
  }
};

void WriteKeyframe(const map::Keyframe& keyframe, const map::ChangedKeyframe& changed, const Part& part,
                   v1::KeyframeRow* out) {
  out->set_id(keyframe.id.value());
  out->set_session(keyframe.session.value());
  out->set_camera(keyframe.camera.value());
  out->set_component(keyframe.component.value());
  out->set_time_ns(keyframe.time_ns);
  out->set_frame_index(keyframe.frame_index);
  ToProto(keyframe.camera_from_map, out->mutable_camera_from_map());
  ToProto(keyframe.camera_from_direct, out->mutable_camera_from_direct());
  out->set_direct_segment(keyframe.direct_segment);
  if (keyframe.parent && part.Contains(keyframe.parent)) out->set_parent(keyframe.parent.value());
  for (const KeyframeId child : keyframe.children) {
    if (part.Contains(child)) out->add_children(child.value());
  }
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    if (!part.Contains(edge.keyframe)) continue;
    out->add_covisible(edge.keyframe.value());
    out->add_shared_points(static_cast<std::uint32_t>(edge.shared_points));
  }
  if (changed.features) WriteFeatures(*keyframe.features.Get(), out->mutable_features());
  if (!changed.points) return;
  out->set_has_points(true);
  out->set_points(store::PackPointIds(keyframe.points));
}

void WriteIds(const std::vector<PointId>& ids, v1::PointIds* out) {
  out->set_count(static_cast<std::uint32_t>(ids.size()));
  out->set_ids(store::PackPointIds(ids));
}

void WriteKeyframes(const Part& part, const map::ChangedRows& rows, RowSender* sender) {
  for (const map::ChangedKeyframe& changed : rows.keyframes) {
    if (!sender->good()) return;
    const map::Keyframe* keyframe = part.Find(changed.id);
    if (keyframe == nullptr) {
      sender->Room(8)->add_removed_keyframes(changed.id.value());
      continue;
    }
    v1::KeyframeRow row;
    WriteKeyframe(*keyframe, changed, part, &row);
    sender->Add(std::move(row), &v1::UpdateRows::mutable_keyframes);
  }
}

void WritePoints(const Part& part, const map::ChangedRows& rows, RowSender* sender) {
  constexpr std::size_t kPointsPerMessage = 4096;
  constexpr std::size_t kPointBytes = 40;
  std::vector<PointId> removed, put;
  for (const PointId id : rows.points) {
    const map::MapPoint* point = part.map.points().Find(id);
    (point != nullptr && part.ReferenceOf(*point) ? put : removed).push_back(id);
  }
  for (std::size_t first = 0; first < put.size() && sender->good(); first += kPointsPerMessage) {
    const std::size_t end = std::min(put.size(), first + kPointsPerMessage);
    sender->Flush();
    v1::PointRows* out = sender->Room((end - first) * kPointBytes)->mutable_points();
    WriteIds({put.begin() + static_cast<std::ptrdiff_t>(first), put.begin() + static_cast<std::ptrdiff_t>(end)},
             out->mutable_ids());
    std::string* positions = out->mutable_positions();
    for (std::size_t i = first; i < end; ++i) {
      const map::MapPoint& point = part.map.point(put[i]);
      positions->append(reinterpret_cast<const char*>(point.position.data()), kPointPositionBytes);
      out->add_reference_keyframes(part.ReferenceOf(point).value());
      out->add_times_visible(static_cast<std::uint32_t>(point.times_visible));
      out->add_times_found(static_cast<std::uint32_t>(point.times_found));
    }
  }
  for (std::size_t first = 0; first < removed.size() && sender->good(); first += 8 * kPointsPerMessage) {
    const std::size_t end = std::min(removed.size(), first + 8 * kPointsPerMessage);
    sender->Flush();
    WriteIds({removed.begin() + static_cast<std::ptrdiff_t>(first), removed.begin() + static_cast<std::ptrdiff_t>(end)},
             sender->Room(end - first)->mutable_removed_points());
  }
}

// Rows of a small table.
template <class IdType, class T, class Row>
void WriteTable(const std::vector<IdType>& ids, const std::map<IdType, T>& table,
                google::protobuf::RepeatedPtrField<Row>* (v1::UpdateRows::*put)(),
                void (v1::UpdateRows::*add_removed)(std::uint32_t), RowSender* sender) {
  for (const IdType id : ids) {
    if (!sender->good()) return;
    const auto found = table.find(id);
    if (found == table.end()) {
      (sender->Room(8)->*add_removed)(id.value());
      continue;
    }
    Row row;
    ToProto(found->second, &row);
    sender->Add(std::move(row), put);
  }
}

v1::FollowMapResponse BeginOf(const map::Snapshot& map, const map::ChangedRows& rows, std::size_t vocabulary_bytes) {
  v1::FollowMapResponse message;
  v1::UpdateBegin* begin = message.mutable_begin();
  begin->set_whole(rows.whole);
  begin->set_base(rows.base);
  begin->set_revision(map.revision());
  if (rows.whole || rows.info) ToProto(map.info(), begin->mutable_head());
  begin->set_next_keyframe(map.next_keyframe().value());
  begin->set_next_point(map.next_point().value());
  begin->set_next_camera(map.next_camera().value());
  begin->set_next_session(map.next_session().value());
  begin->set_next_component(map.next_component().value());
  begin->set_vocabulary_bytes(static_cast<std::int64_t>(vocabulary_bytes));
  return message;
}

}  // namespace

bool WriteUpdate(const map::Snapshot& map, const map::ChangedRows& rows, absl::string_view vocabulary,
                 const std::vector<KeyframeId>* only, const std::function<bool(const v1::FollowMapResponse&)>& send) {
  const Part part{map, only};
  if (!send(BeginOf(map, rows, vocabulary.size()))) return false;
  for (; !vocabulary.empty(); vocabulary.remove_prefix(std::min(vocabulary.size(), kVocabularyPartBytes))) {
    v1::FollowMapResponse message;
    message.set_vocabulary(std::string(vocabulary.substr(0, kVocabularyPartBytes)));
    if (!send(message)) return false;
  }
  RowSender sender(send);
  WriteTable<CameraId, map::MapCamera, v1::CameraRow>(rows.cameras, map.cameras(), &v1::UpdateRows::mutable_cameras,
                                                      &v1::UpdateRows::add_removed_cameras, &sender);
  // A session is never removed, only marked so.
  for (const SessionId id : rows.sessions) {
    const auto found = map.sessions().find(id);
    if (found == map.sessions().end()) continue;
    v1::SessionRow row;
    ToProto(found->second, &row);
    sender.Add(std::move(row), &v1::UpdateRows::mutable_sessions);
  }
  WriteTable<ComponentId, map::Component, v1::ComponentRow>(rows.components, map.components(),
                                                            &v1::UpdateRows::mutable_components,
                                                            &v1::UpdateRows::add_removed_components, &sender);
  WriteKeyframes(part, rows, &sender);
  WritePoints(part, rows, &sender);
  sender.Flush();
  if (!sender.good()) return false;
  v1::FollowMapResponse end;
  end.mutable_end()->set_rows_bytes(sender.bytes());
  end.mutable_end()->set_keyframes(static_cast<std::int64_t>(only != nullptr ? only->size() : map.keyframes().size()));
  end.mutable_end()->set_points(only != nullptr ? -1 : static_cast<std::int64_t>(map.points().size()));
  return send(end);
}

}  // namespace cairn::wire
