// Numbers one after another in a blob, little-endian; whole numbers as LEB128 where they are mostly small.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>

#include "store/sqlite.h"

namespace cairn::store {

class ByteWriter {
 public:
  template <class T>
  void Fixed(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(value));
  }
  void Varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<char>(value | 0x80));
    bytes_.push_back(static_cast<char>(value));
  }
  // Of either sign.
  void Zigzag(std::int64_t value) {
    Varint(static_cast<std::uint64_t>(value) << 1 ^ static_cast<std::uint64_t>(value >> 63));
  }
  void Raw(const void* bytes, std::size_t size) { bytes_.append(static_cast<const char*>(bytes), size); }

  std::string Take() { return std::move(bytes_); }
  std::size_t size() const { return bytes_.size(); }

 private:
  std::string bytes_;
};

// Beyond the end everything is 0, and ok() false for good.
class ByteReader {
 public:
  explicit ByteReader(Bytes bytes) : at_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  bool ok() const { return ok_; }
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }

  template <class T>
  T Fixed() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    if (!Has(sizeof(T))) return value;
    std::memcpy(&value, at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  std::uint64_t Varint() {
    if (at_ != end_ && *at_ < 0x80 && ok_) return *at_++;  // most
    return LongVarint();
  }
  std::int64_t Zigzag() {
    const std::uint64_t value = Varint();
    return static_cast<std::int64_t>(value >> 1) ^ -static_cast<std::int64_t>(value & 1);
  }
  // At most `limit`, else not ok.
  std::uint64_t VarintUpTo(std::uint64_t limit) {
    const std::uint64_t value = Varint();
    if (value <= limit) return value;
    ok_ = false;
    return 0;
  }
  // Passes over so many whole numbers.
  void SkipVarints(std::uint64_t count) {
    for (; count > 0 && at_ != end_; ++at_) count -= *at_ < 0x80 ? 1 : 0;
    ok_ = ok_ && count == 0;
  }
  Bytes Raw(std::size_t size) {
    if (!Has(size)) return {};
    at_ += size;
    return {at_ - size, size};
  }

 private:
  std::uint64_t LongVarint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      if (!Has(1)) return 0;
      const std::uint8_t byte = *at_++;
      value |= static_cast<std::uint64_t>(byte & 0x7f) << shift;
      if ((byte & 0x80) == 0) return value;
    }
    ok_ = false;
    return 0;
  }
  bool Has(std::size_t size) {
    ok_ = ok_ && size <= left();
    return ok_;
  }

  const std::uint8_t* at_;
  const std::uint8_t* end_;
  bool ok_ = true;
};

}  // namespace cairn::store
