#include "store/page_image.h"

#include <algorithm>
#include <cerrno>
#include <filesystem>

#include "store/file_paths.h"
#include "store/log_frames.h"

namespace cairn::store {
namespace {

constexpr std::uint32_t kDefaultPageBytes = 4096;
constexpr std::uint8_t kIndexInterior = 0x02, kTableInterior = 0x05, kIndexLeaf = 0x0a, kTableLeaf = 0x0d;

}  // namespace

absl::StatusOr<PageImage> PageImage::Open(const std::string& path, const std::string& log) {
  PageImage image;
  image.file_.open(path, std::ios::binary);
  std::error_code error;
  image.file_bytes_ = std::filesystem::file_size(path, error);
  if (!image.file_ || error) return SystemFault(absl::StrCat("reading ", path), error ? error.value() : errno);
  std::vector<std::uint8_t> header(kSqliteHeaderBytes);
  image.file_.read(reinterpret_cast<char*>(header.data()), static_cast<std::streamsize>(header.size()));
  image.file_.clear();
  image.page_bytes_ = PageBytesOf(header);
  if (!IsPageSize(image.page_bytes_)) image.page_bytes_ = kDefaultPageBytes;
  image.num_pages_ = static_cast<std::uint32_t>((image.file_bytes_ + image.page_bytes_ - 1) / image.page_bytes_);
  if (!log.empty()) {
    ForEachLogFrame(log, [&](const LogFrame& frame) {
      if (frame.page == 0 || frame.bytes.size() != image.page_bytes_) return;
      // A page that is damaged there may be better in the file, or later in the log.
      if (!frame.intact && image.from_log_.contains(frame.page)) return;
      image.from_log_[frame.page].assign(frame.bytes.begin(), frame.bytes.end());
    });
    // Bounded by what the file and its log can hold.
    const std::uint32_t most = image.num_pages_ + static_cast<std::uint32_t>(image.from_log_.size());
    for (const auto& [page, bytes] : image.from_log_) {
      if (page <= most) image.num_pages_ = std::max(image.num_pages_, page);
    }
  }
  image.FindFreePages();
  return image;
}

std::uint32_t PageImage::user_version() {
  std::vector<std::uint8_t> first;
  return ReadPage(1, &first) ? BigEndian32(first.data() + kUserVersionAt) : 0;
}

bool PageImage::ReadPage(std::uint32_t number, std::vector<std::uint8_t>* page) {
  if (number == 0) return false;
  if (const auto found = from_log_.find(number); found != from_log_.end()) {
    *page = found->second;
    return true;
  }
  const std::uint64_t offset = std::uint64_t{page_bytes_} * (number - 1);
  if (offset >= file_bytes_) return false;
  page->assign(page_bytes_, 0);
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(offset));
  file_.read(reinterpret_cast<char*>(page->data()), static_cast<std::streamsize>(page->size()));
  return file_.gcount() > 0;
}

void PageImage::FindFreePages() {
  free_.assign(std::size_t{num_pages_} + 1, false);
  std::vector<std::uint8_t> page;
  if (!ReadPage(1, &page)) return;
  std::uint32_t trunk = BigEndian32(page.data() + kFirstFreePageAt);
  const std::uint32_t expected = BigEndian32(page.data() + kFreePagesAt);
  std::uint32_t found = 0;
  const auto take = [&](std::uint32_t number) {
    if (number == 0 || number > num_pages_ || free_[number]) return false;
    free_[number] = true;
    ++found;
    return true;
  };
  while (trunk != 0) {
    if (!take(trunk) || !ReadPage(trunk, &page)) break;
    trunk = BigEndian32(page.data());
    const std::uint32_t leaves = std::min(BigEndian32(page.data() + 4), page_bytes_ / 4 - 2);
    for (std::uint32_t i = 0; i < leaves; ++i) take(BigEndian32(page.data() + 8 + 4 * std::size_t{i}));
  }
  knows_free_pages_ = found == expected;
  // A list that is damaged itself must not hide pages that are in use.
  if (!knows_free_pages_) free_.assign(free_.size(), false);
}

void PageImage::ForEachRow(const std::function<void(const RawRow&)>& visit) {
  std::vector<std::uint8_t> page;
  for (std::uint32_t number = 1; number <= num_pages_; ++number) {
    if (!free_[number] && ReadPage(number, &page)) VisitPage(number, page, visit);
  }
}

void PageImage::VisitPage(std::uint32_t number, Bytes page, const std::function<void(const RawRow&)>& visit) {
  const std::size_t start = number == 1 ? kSqliteHeaderBytes : 0;
  const std::uint8_t kind = page[start];
  if (kind == kTableInterior) return;
  if (kind == kTableLeaf || kind == kIndexLeaf || kind == kIndexInterior) {
    VisitCells(page, start, kind, visit);
    return;
  }
  // An overflow page, or one whose first byte is wrong: rows show by their checksums.
  VisitCells(page, start, kTableLeaf, visit);
  VisitCells(page, start, kIndexLeaf, visit);
}

void PageImage::VisitCells(Bytes page, std::size_t start, std::uint8_t kind,
                           const std::function<void(const RawRow&)>& visit) {
  const bool is_table = kind == kTableLeaf;
  const std::size_t pointers = start + (kind == kIndexInterior ? 12 : 8);
  // The number of cells is in the header, which may be damaged: the pointers end where no cell can be.
  const std::size_t most = (page.size() - pointers) / 2;
  std::vector<std::uint8_t> payload;
  for (std::size_t i = 0; i < most; ++i) {
    std::size_t at = BigEndian16(page.data() + pointers + 2 * i);
    if (at < pointers + 2 * (i + 1) || at >= page.size()) break;
    if (kind == kIndexInterior) at += 4;
    RawRow row;
    row.has_number = is_table;
    std::uint64_t size = 0, number = 0;
    if (!ReadVarint(page, &at, &size) || (is_table && !ReadVarint(page, &at, &number))) continue;
    row.number = static_cast<std::int64_t>(number);
    if (!ReadPayload(page, at, size, is_table, &payload)) continue;
    auto columns = ParseRecord(payload);
    if (!columns) continue;
    row.columns = *std::move(columns);
    visit(row);
  }
}

bool PageImage::ReadPayload(Bytes page, std::size_t at, std::uint64_t size, bool is_table,
                            std::vector<std::uint8_t>* payload) {
  // Section 1.6, "Cell payload overflow pages".
  const std::uint64_t usable = page_bytes_;  // maps reserve no bytes of a page
  const std::uint64_t max_local = is_table ? usable - 35 : (usable - 12) * 64 / 255 - 23;
  const std::uint64_t min_local = (usable - 12) * 32 / 255 - 23;
  std::uint64_t local = size;
  if (size > max_local) {
    const std::uint64_t rest = min_local + (size - min_local) % (usable - 4);
    local = rest <= max_local ? rest : min_local;
  }
  if (size > file_bytes_ + std::uint64_t{page_bytes_} * from_log_.size() || at + local > page.size()) return false;
  payload->assign(page.begin() + static_cast<std::ptrdiff_t>(at),
                  page.begin() + static_cast<std::ptrdiff_t>(at + local));
  if (local == size) return true;
  if (at + local + 4 > page.size()) return false;
  payload->reserve(size);
  std::uint32_t next = BigEndian32(page.data() + at + local);
  std::vector<std::uint8_t> overflow;
  while (payload->size() < size) {
    if (!ReadPage(next, &overflow)) return false;
    const std::uint64_t take = std::min<std::uint64_t>(size - payload->size(), usable - 4);
    payload->insert(payload->end(), overflow.begin() + 4, overflow.begin() + 4 + static_cast<std::ptrdiff_t>(take));
    next = BigEndian32(overflow.data());
  }
  return true;
}

}  // namespace cairn::store
