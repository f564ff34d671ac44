// The file under a map that is ready to be queried: its index, which is in memory, and its pages, which are read when
// they are asked for.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/status.h"
#include "map/feature_cache.h"
#include "map/snapshot.h"
#include "store/file_paths.h"
#include "store/ready_pages.h"
#include "store/sqlite.h"

namespace cairn::store {

// A page within a transaction; nothing if there is none, or no table. DataLoss (without a fault) if it is damaged.
absl::StatusOr<std::optional<std::string>> ReadReadyPage(Database* database, ReadyKind kind, std::uint32_t number,
                                                         Revision* revision = nullptr);
// Likewise the first page.
absl::StatusOr<std::optional<ReadyIndex>> ReadReadyIndex(Database* database);

// Of one revision; thread-safe. Sources that were made anew share it.
class ReadyFile {
 public:
  // The map at `path`, which messages name so; `resolved` as SQLite knows it.
  ReadyFile(std::string path, std::string resolved, ReadyIndex index, image::OrbParameters orb,
            std::shared_ptr<map::FeatureCache> cache);

  absl::Status Open(const FileIdentity& identity);

  const ReadyIndex& index() const { return index_; }
  const image::OrbParameters& orb() const { return orb_; }
  const Vector3d& CenterOf(KeyframeId id) const { return centers_[place_of_[id.value()]]; }
  double FocalOf(CameraId id) const;
  // The features of a keyframe of the index: the same handle whoever asks.
  map::FeatureHandle Features(const ReadyKeyframe& keyframe);

  // A page's content as it was when the index was written.
  absl::StatusOr<std::string> Read(ReadyKind kind, std::uint32_t number);
  // The map of the index from its tables, for when a page cannot be read; null if that is no help: the map has moved
  // on, or is damaged itself.
  const map::Snapshot* TablesAfter(const absl::Status& why);
  // Tells the cache of what cannot be read.
  void Note(const absl::Status& error, ReadyKind kind, std::uint32_t number);

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

}  // namespace cairn::store
