// Updates of a map on the wire, message by message (follow.proto): what has changed, or all of it. What is read is
// checked as far as it is needed to make a map::Delta of it; whether that makes a good map, Snapshot::Apply() says.
#pragma once

#include <cairn/v1/follow.pb.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "map/changed_rows.h"
#include "map/delta.h"
#include "map/snapshot.h"

namespace cairn::wire {

// Messages of rows are about so large; one keyframe or session at least is in each.
inline constexpr std::size_t kUpdateMessageBytes = 256 << 10;
inline constexpr std::size_t kPointPositionBytes = 3 * sizeof(double);  // in PointRows

// Calls `send` for each message of the update that leads whoever has the map at rows.base (or nothing, if rows.whole)
// to `map`. `vocabulary`: its bytes, if they are to be sent. `only`: of a region, its keyframes, ascending; null: all.
// False as soon as `send` is.
bool WriteUpdate(const map::Snapshot& map, const map::ChangedRows& rows, absl::string_view vocabulary,
                 const std::vector<KeyframeId>* only, const std::function<bool(const v1::FollowMapResponse&)>& send);

// What an update says.
struct MapUpdate {
  bool whole = false;
  // `delta` is of this map: what the reader had, or an empty one if the update is whole.
  std::shared_ptr<const map::Snapshot> base;
  map::Delta delta;
  // Of the map after it; points of a region are not counted, -1.
  std::int64_t keyframes = 0;
  std::int64_t points = 0;
  std::string vocabulary;  // as it was sent; empty: it was not
  std::int64_t bytes = 0;  // of the messages, serialized
};

// Of a region: whether something comes into it whose id was given out before. No change of what is held can say so;
// Applied() makes the map anew then, and so must everybody who makes something else of the change.
bool NeedsRebuilding(const MapUpdate& update);
// The map after it. Errors as Snapshot::Apply().
absl::StatusOr<std::shared_ptr<const map::Snapshot>> Applied(const MapUpdate& update);

// Reads one update. For one thread.
class UpdateReader {
 public:
  // An update may not be larger, whatever the server says.
  static constexpr std::int64_t kMaxBytes = std::int64_t{8} << 30;

  // `held`: what the reader has of the map; null: nothing.
  explicit UpdateReader(std::shared_ptr<const map::Snapshot> held) : held_(std::move(held)) {}

  // The next message; true if it was the last one, and Take() may be called. InvalidArgument for what is no update, or
  // no change of what is held.
  absl::StatusOr<bool> Read(const v1::FollowMapResponse& message);

  absl::StatusOr<MapUpdate> Take();

  // False: no message was read yet.
  bool begun() const { return begun_; }

 private:
  absl::Status Begin(const v1::UpdateBegin& begin);
  absl::Status AddRows(const v1::UpdateRows& rows);
  absl::Status AddKeyframe(const v1::KeyframeRow& row);
  absl::Status AddFeatures(const v1::FeaturesRow& row, const map::Keyframe* before, map::Keyframe* keyframe);
  absl::Status AddPoints(const v1::PointRows& rows);
  absl::Status AddRemovedPoints(const v1::PointIds& ids);
  const Pinhole* PinholeOf(CameraId id) const;

  const std::shared_ptr<const map::Snapshot> held_;
  bool begun_ = false;
  std::int64_t vocabulary_bytes_ = 0;
  std::int64_t rows_bytes_ = 0;
  map::MapInfo info_;  // of the map after the update
  std::vector<std::shared_ptr<map::MapPoint>> points_;
  MapUpdate update_;
};

}  // namespace cairn::wire
