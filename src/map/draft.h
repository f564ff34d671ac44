// What an Edit has changed of one table, by dense id, over the table itself: reads are two steps, whatever the size of
// the table, and nothing but the pages that are looked at is allocated.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "map/table.h"

namespace cairn::map {

// Reads fill pages too: not for several threads at once, const or not.
template <class IdType, class T>
class Draft {
 public:
  // `base` must outlive it; `next` is above every id in it.
  Draft(const Table<IdType, T>& base, IdType next) : base_(&base), pages_((next.value() >> kBits) + 1) {}

  // As it is now; null if there is none or it was erased.
  const T* Find(IdType id) const {
    const std::size_t page = id.value() >> kBits;
    if (page >= pages_.size()) return nullptr;
    return (pages_[page] ? *pages_[page] : Fill(page)).now[id.value() & kMask];
  }

  // To be changed in place; it must exist. Copied at the first call.
  T& Mutable(IdType id) {
    Page& page = PageOf(id);
    const std::uint32_t at = id.value() & kMask;
    if (!page.changed[at]) Set(id, std::make_shared<T>(*page.now[at]));
    return *page.changed[at];
  }

  // Null erases.
  void Set(IdType id, std::shared_ptr<T> value) {
    Page& page = PageOf(id);
    const std::uint32_t at = id.value() & kMask;
    page.now[at] = value.get();
    page.changed[at] = std::move(value);
    page.touched |= std::uint64_t{1} << at;
  }

  // A byte per id for the owner's use, 0 at first.
  std::uint8_t& Mark(IdType id) { return PageOf(id).mark[id.value() & kMask]; }

  // Calls visit(id, const std::shared_ptr<T>&) for everything that was set or made mutable, in the order of ids.
  template <class Visit>
  void ForEachTouched(Visit&& visit) const {
    for (std::size_t p = 0; p < pages_.size(); ++p) {
      if (!pages_[p]) continue;
      for (std::uint64_t left = pages_[p]->touched; left != 0; left &= left - 1) {
        const auto at = static_cast<std::uint32_t>(__builtin_ctzll(left));
        visit(IdType(static_cast<std::uint32_t>(p << kBits) | at), pages_[p]->changed[at]);
      }
    }
  }

 private:
  static constexpr int kBits = 6;
  static constexpr std::uint32_t kMask = (1u << kBits) - 1;

  struct Page {
    std::array<const T*, 1u << kBits> now;
    std::array<std::shared_ptr<T>, 1u << kBits> changed;
    std::array<std::uint8_t, 1u << kBits> mark = {};
    std::uint64_t touched = 0;
  };

  Page& Fill(std::size_t page) const {
    pages_[page] = std::make_unique<Page>();
    const auto first = static_cast<std::uint32_t>(page << kBits);
    for (std::uint32_t i = 0; i <= kMask; ++i) pages_[page]->now[i] = base_->Find(IdType(first + i));
    return *pages_[page];
  }

  Page& PageOf(IdType id) {
    const std::size_t page = id.value() >> kBits;
    if (page >= pages_.size()) pages_.resize(page + 1);
    return pages_[page] ? *pages_[page] : Fill(page);
  }

  const Table<IdType, T>* base_;
  mutable std::vector<std::unique_ptr<Page>> pages_;
};

}  // namespace cairn::map
