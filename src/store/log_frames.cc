#include "store/log_frames.h"

#include <algorithm>
#include <array>
#include <bit>
#include <fstream>
#include <optional>
#include <vector>

#include "store/sqlite_record.h"

namespace cairn::store {
namespace {

constexpr std::size_t kLogHeaderBytes = 32;
constexpr std::size_t kFrameHeaderBytes = 24;
constexpr std::size_t kSaltsAt = 16, kFrameSaltsAt = 8, kSaltBytes = 8;
constexpr std::size_t kHeaderSumAt = 24, kFrameSumAt = 16;
constexpr std::uint32_t kLogMagic = 0x377f0682;  // the lowest bit: checksums over big-endian words
constexpr std::uint32_t kDefaultPageBytes = 4096;

using Salts = std::array<std::uint8_t, kSaltBytes>;

Salts SaltsAt(const std::uint8_t* at) {
  Salts salts;
  std::copy_n(at, kSaltBytes, salts.begin());
  return salts;
}

// The running checksum over everything so far.
struct Sum {
  std::uint32_t a = 0, b = 0;

  void Add(Bytes bytes, bool big_endian) {
    for (std::size_t i = 0; i + 8 <= bytes.size(); i += 8) {
      const std::uint8_t* at = bytes.data() + i;
      a += (big_endian ? BigEndian32(at) : LittleEndian32(at)) + b;
      b += (big_endian ? BigEndian32(at + 4) : LittleEndian32(at + 4)) + a;
    }
  }
  static Sum StoredAt(const std::uint8_t* at) { return {BigEndian32(at), BigEndian32(at + 4)}; }
  bool operator==(const Sum&) const = default;
};

bool Fill(std::ifstream& in, std::vector<std::uint8_t>& buffer) {
  in.read(reinterpret_cast<char*>(buffer.data()), static_cast<std::streamsize>(buffer.size()));
  return in.gcount() == static_cast<std::streamsize>(buffer.size());
}

struct LogHeader {
  bool good = false;
  bool big_endian = false;
  std::uint32_t page_bytes = 0;
  Salts salts{};
  Sum sum;
};

LogHeader ParseHeader(Bytes bytes) {
  LogHeader header;
  const std::uint32_t magic = BigEndian32(bytes.data());
  header.big_endian = (magic & 1) != 0;
  header.page_bytes = BigEndian32(bytes.data() + 8);
  header.salts = SaltsAt(bytes.data() + kSaltsAt);
  header.sum.Add(bytes.first(kHeaderSumAt), header.big_endian);
  header.good = (magic & ~1u) == kLogMagic && IsPageSize(header.page_bytes) &&
                header.sum == Sum::StoredAt(bytes.data() + kHeaderSumAt);
  return header;
}

// Of the frame that comes next; none at the end.
std::optional<Salts> NextSalts(std::ifstream& in) {
  std::vector<std::uint8_t> header(kFrameHeaderBytes);
  const auto start = in.tellg();
  const bool found = Fill(in, header);
  in.clear();
  in.seekg(start);
  if (!found) return std::nullopt;
  return SaltsAt(header.data() + kFrameSaltsAt);
}

// What a damaged header leaves open: the size of a page by the bytes it has, the order of bytes by that of this
// machine, which wrote the log; the salts are those of the first frame.
void Guess(std::ifstream& in, LogHeader* header) {
  if (!IsPageSize(header->page_bytes)) header->page_bytes = kDefaultPageBytes;
  header->big_endian = std::endian::native == std::endian::big;
  header->salts = NextSalts(in).value_or(Salts());
}

}  // namespace

std::uint32_t ForEachLogFrame(const std::string& path, const std::function<void(const LogFrame&)>& visit) {
  std::ifstream in(path, std::ios::binary);
  std::vector<std::uint8_t> header_bytes(kLogHeaderBytes);
  if (!Fill(in, header_bytes)) return 0;
  LogHeader header = ParseHeader(header_bytes);
  if (!header.good) Guess(in, &header);
  bool in_order = header.good;
  Sum before = header.sum;  // what the frame before carries
  std::vector<std::uint8_t> frame(kFrameHeaderBytes + header.page_bytes);
  for (bool first = true; Fill(in, frame); first = false) {
    const bool same_use = SaltsAt(frame.data() + kFrameSaltsAt) == header.salts;
    const Bytes page = Bytes(frame).subspan(kFrameHeaderBytes);
    Sum sum = before;
    sum.Add(Bytes(frame).first(kFrameSaltsAt), header.big_endian);
    sum.Add(page, header.big_endian);
    before = Sum::StoredAt(frame.data() + kFrameSumAt);
    // Whatever its salts say, a frame that goes on from the one before is of the same use of the file. Without a header
    // there is nothing to check the first by.
    const bool intact = sum == before || (first && !header.good);
    // Either damaged, or the first of an earlier use.
    if (!intact && !same_use && NextSalts(in) != header.salts) break;
    in_order = in_order && intact && same_use;
    visit({BigEndian32(frame.data()), BigEndian32(frame.data() + 4) != 0, in_order, intact, page});
  }
  return header.page_bytes;
}

}  // namespace cairn::store
