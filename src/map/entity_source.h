// Keyframes and points that are not in memory: they come from where the map is kept when somebody looks at them, in
// pages of their neighbours in ids, which then stay as long as the source does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace cairn::map {

// Below the changes of a Table. Thread-safe, and the same answer every time.
template <class T>
class TableSource {
 public:
  virtual ~TableSource() = default;
  virtual std::size_t size() const = 0;
  // Above every id.
  virtual std::uint32_t end() const = 0;
  // The same for sources that hold the same values, whether they were looked at or not.
  virtual const void* content() const = 0;
  // Null if there is none. What cannot be read is there all the same, without content that means anything; whoever
  // owns the source is told (FeatureCache::status).
  virtual const std::shared_ptr<const T>& Find(std::uint32_t id) const = 0;
};

struct Keyframe;
struct MapPoint;

// Both tables of one revision.
class EntitySource {
 public:
  virtual ~EntitySource() = default;
  virtual std::shared_ptr<const TableSource<Keyframe>> keyframes() const = 0;
  virtual std::shared_ptr<const TableSource<MapPoint>> points() const = 0;
  // About how much of the memory is taken by what was looked at.
  virtual std::size_t bytes() const = 0;
  // The same, of which nothing was looked at yet.
  virtual std::shared_ptr<const EntitySource> Anew() const = 0;
};

}  // namespace cairn::map
