#include "base/shared_bytes.h"

#include <sys/mman.h>

#include <utility>

namespace cairn {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20;

// Memory of its own for so many bytes, which begins at a huge page; nothing if there is none.
std::shared_ptr<char> MapHugePages(std::size_t size) {
  // As much more as it takes to begin at one. What is not touched is no memory.
  const std::size_t length = size + kHugePage;
  void* start = mmap(nullptr, length, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (start == MAP_FAILED) return nullptr;
  void* begin = start;
  std::size_t space = length;
  std::align(kHugePage, size, begin, space);
  madvise(begin, size, MADV_HUGEPAGE);  // else in small ones
  return {static_cast<char*>(begin), [start, length](char*) { munmap(start, length); }};
}

}  // namespace

SharedBytes::SharedBytes(std::string bytes) {
  auto owner = std::make_shared<const std::string>(std::move(bytes));
  view_ = *owner;
  owner_ = std::move(owner);
}

SharedBytes SharedBytes::New(std::size_t size, std::span<char>* memory) {
  std::shared_ptr<char> owner;
  if (size >= kHugePage) owner = MapHugePages(size);
  if (owner == nullptr) owner = {new char[size], std::default_delete<char[]>()};
  *memory = {owner.get(), size};
  SharedBytes bytes;
  bytes.view_ = {owner.get(), size};
  bytes.owner_ = std::move(owner);
  return bytes;
}

}  // namespace cairn
