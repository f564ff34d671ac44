// Bytes that several keep: copies share them, and they stay where they are while somebody has one.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace cairn {

class SharedBytes {
 public:
  SharedBytes() = default;
  explicit SharedBytes(std::string bytes);
  // Not yet written: what `memory` is set to is, before anybody reads. Megabytes lie in huge pages where the system
  // gives them (madvise(2), MADV_HUGEPAGE), as the first touch of 4 KB at a time takes longer than to read them.
  static SharedBytes New(std::size_t size, std::span<char>* memory);

  std::string_view view() const { return view_; }
  std::size_t size() const { return view_.size(); }
  // Those from `offset` on, at most size(), of the same.
  SharedBytes From(std::size_t offset) const {
    SharedBytes rest = *this;
    rest.view_.remove_prefix(offset);
    return rest;
  }

 private:
  std::shared_ptr<const void> owner_;
  std::string_view view_;
};

}  // namespace cairn
