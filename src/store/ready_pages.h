// The map ready to be queried (docs/map-format.md, "Ready pages"): what the tables say of one revision, once more, in
// the order in which questions are asked, so that a reader need not put the rows of the whole map together. It follows
// from the tables, is written when a writer closes the map, and left out whenever anything is wrong with it.
//
// This is how its pages are written; all that is read is checked, so that nothing in a page leads out of the map.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "map/entities.h"
#include "map/snapshot.h"
#include "store/sqlite.h"

namespace cairn::store {

enum class ReadyKind : std::uint32_t { kIndex = 0, kKeyframes = 1, kPoints = 2, kPlaces = 3, kSummary = 4 };

inline constexpr std::uint32_t kKeyframesPerPage = 16;  // ids
inline constexpr std::uint32_t kPointsPerPage = 256;

// The key of a page in table `ready_pages`.
constexpr std::int64_t ReadyRowId(ReadyKind kind, std::uint32_t number) {
  return static_cast<std::int64_t>(kind) << 32 | number;
}

extern const absl::string_view kReadyTable;
// Makes the table if there is none.
extern const absl::string_view kReadyTableSql;

// The blob of a page: its key and revision, so that neither can change unnoticed, and the content.
std::string SealReadyPage(std::int64_t row_id, Revision revision, absl::string_view content);
// The content, of the columns `revision`, `bytes_checksum` and `bytes`; DataLoss (without a fault) if they do not fit.
// Refers to `bytes`.
absl::StatusOr<Bytes> OpenReadyPage(std::int64_t row_id, Revision revision, std::int64_t checksum, Bytes bytes);

// What is known of every keyframe without a look at its page.
struct ReadyKeyframe {
  KeyframeId id;
  SessionId session;
  CameraId camera;
  ComponentId component;
  SE3 camera_from_map;
  std::uint32_t num_features = 0;
};

// The first page: what there is.
class ReadyIndex {
 public:
  Revision revision = 0;
  KeyframeId next_keyframe{1};
  PointId next_point{1};
  std::vector<std::pair<CameraId, double>> focal_px;
  std::vector<std::vector<KeyframeId>> segments;  // of the place index; also those that have left the map since

  // After AddKeyframe()s in ascending order, and AddPoint()s.
  const std::vector<ReadyKeyframe>& keyframes() const { return keyframes_; }
  const ReadyKeyframe* Find(KeyframeId id) const;  // null: none
  bool HasPoint(PointId id) const {
    const std::size_t word = id.value() / 64;
    return word < points_.size() && (points_[word] >> (id.value() % 64) & 1) != 0;
  }
  std::size_t num_points() const { return num_points_; }

  // `next_keyframe` and `next_point` are as they will be.
  void AddKeyframe(const ReadyKeyframe& keyframe);
  void AddPoint(PointId id);

  std::string Pack() const;
  static absl::StatusOr<ReadyIndex> Unpack(Bytes bytes);

 private:
  std::vector<ReadyKeyframe> keyframes_;
  std::vector<std::uint32_t> place_of_;  // by id, place + 1
  std::vector<std::uint64_t> points_;    // a bit per id
  std::size_t num_points_ = 0;
};

// The index of a map; nothing if its ids are too scattered for pages of them. `segments` is left empty.
absl::StatusOr<std::optional<ReadyIndex>> IndexOf(const map::Snapshot& map);

// Pages of keyframes and points that have ids in their range, ascending. What the index says is left out, as are
// features and what follows from them (map/viewing.h).
std::string PackReadyKeyframes(std::span<const map::Keyframe* const> keyframes);
std::string PackReadyPoints(std::span<const map::MapPoint* const> points);

// Where the keyframes of a page are in its content, by place on the page, and where the last one ends; those that are
// not there are empty. DataLoss (without a fault) if it does not hold what the index says.
using ReadyKeyframeEnds = std::array<std::uint32_t, kKeyframesPerPage + 1>;
absl::StatusOr<ReadyKeyframeEnds> FindReadyKeyframes(std::uint32_t number, const ReadyIndex& index, Bytes content);
// One of them back, without features, from its part of the content.
absl::StatusOr<std::shared_ptr<map::Keyframe>> UnpackReadyKeyframe(const ReadyIndex& index, const ReadyKeyframe& known,
                                                                   Bytes part);

// Points back, with the reference's keyframe and feature, but without descriptor and viewing. `number`: of the page.
absl::Status UnpackReadyPoints(std::uint32_t number, const ReadyIndex& index, Bytes bytes,
                               std::vector<map::MapPoint>* points);

}  // namespace cairn::store
