// The binary form of a vocabulary. All numbers little endian:
//   8 bytes   "CAIRNVOC"
//   5 x u32   version, branching, depth, number of nodes n, number of words w
//   n x u8    children of each node, breadth first
//   (n-1) x 32 bytes   descriptors of the nodes but the root, same order
//   w x f32   word weights (idf), leaves in the same order
//   u64       xxHash64 (seed 0) of everything before
#include <bit>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/files.h"
#include "place/vocabulary.h"

namespace cairn::place {
namespace {

constexpr std::string_view kMagic = "CAIRNVOC";
constexpr std::uint32_t kVersion = 1;
constexpr std::size_t kHeaderSize = 8 + 5 * 4;
constexpr std::size_t kChecksumSize = 8;

template <class T>
void Put(std::string* out, T value) {
  static_assert(std::is_unsigned_v<T>);
  for (std::size_t i = 0; i < sizeof(T); ++i) out->push_back(static_cast<char>((value >> (8 * i)) & 0xFF));
}

template <class T>
T Get(std::string_view bytes, std::size_t offset) {
  static_assert(std::is_unsigned_v<T>);
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    value |= static_cast<T>(static_cast<T>(static_cast<unsigned char>(bytes[offset + i])) << (8 * i));
  }
  return value;
}

static_assert(std::endian::native == std::endian::little, "arrays are taken as they are");

template <class T>
void PutAll(std::string* out, std::span<const T> values) {
  out->append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

// From the beginning of `bytes`, which hold as much.
template <class T>
void TakeAll(std::string_view* bytes, std::span<T> values) {
  if (!values.empty()) std::memcpy(values.data(), bytes->data(), values.size_bytes());
  bytes->remove_prefix(values.size_bytes());
}

}  // namespace

std::uint64_t Vocabulary::HashOf(std::string_view bytes) { return XXH64(bytes.data(), bytes.size(), 0); }

std::string Vocabulary::SerializeWithoutChecksum() const {
  std::string out;
  out.reserve(kHeaderSize + child_count_.size() * 33 + weight_.size() * 4 + kChecksumSize);
  out.append(kMagic);
  Put(&out, kVersion);
  Put(&out, static_cast<std::uint32_t>(branching_));
  Put(&out, static_cast<std::uint32_t>(depth_));
  Put(&out, static_cast<std::uint32_t>(child_count_.size()));
  Put(&out, static_cast<std::uint32_t>(weight_.size()));
  PutAll(&out, std::span(child_count_));
  PutAll(&out, std::span(descriptor_).subspan(1));
  PutAll(&out, std::span(weight_));
  return out;
}

std::string Vocabulary::Serialize() const {
  std::string out = SerializeWithoutChecksum();
  Put(&out, hash_);
  return out;
}

absl::StatusOr<Vocabulary> Vocabulary::Parse(std::string_view bytes) {
  if (bytes.substr(0, kMagic.size()) != kMagic.substr(0, bytes.size()) || bytes.empty()) {
    return absl::InvalidArgumentError(
        "this is not a Cairn vocabulary (it does not start with CAIRNVOC); a DBoW2 text file must be imported first");
  }
  if (bytes.size() < kHeaderSize + kChecksumSize) {
    return absl::DataLossError(absl::StrCat("the vocabulary is truncated: only ", bytes.size(), " bytes"));
  }
  const auto version = Get<std::uint32_t>(bytes, 8);
  if (version != kVersion) {
    return absl::FailedPreconditionError(absl::StrCat("the vocabulary has format version ", version,
                                                      "; this program reads version ", kVersion,
                                                      (version > kVersion ? "; use a newer Cairn" : "")));
  }
  const std::uint64_t nodes = Get<std::uint32_t>(bytes, 20);
  const std::uint64_t words = Get<std::uint32_t>(bytes, 24);
  const std::uint64_t expected = kHeaderSize + nodes + (nodes - 1) * 32 + words * 4 + kChecksumSize;
  if (nodes < 2 || nodes > kMaxNodes || words >= nodes || bytes.size() != expected) {
    return absl::DataLossError(absl::StrCat("the vocabulary is truncated or damaged: it has ", bytes.size(),
                                            " bytes, but its header announces ", nodes, " nodes and ", words,
                                            " words"));
  }
  const std::string_view content = bytes.substr(0, bytes.size() - kChecksumSize);
  if (Get<std::uint64_t>(bytes, content.size()) != HashOf(content)) {
    return absl::DataLossError("the vocabulary is damaged: its checksum does not fit its content");
  }
  Vocabulary vocabulary;
  vocabulary.branching_ = static_cast<int>(Get<std::uint32_t>(bytes, 12));
  vocabulary.depth_ = static_cast<int>(Get<std::uint32_t>(bytes, 16));
  if (vocabulary.branching_ < 2 || vocabulary.branching_ > kMaxBranching || vocabulary.depth_ < 1 ||
      vocabulary.depth_ > kMaxDepth) {
    return absl::DataLossError(
        absl::StrCat("the vocabulary is damaged: branching ", vocabulary.branching_, ", depth ", vocabulary.depth_));
  }
  std::string_view rest = content.substr(kHeaderSize);
  vocabulary.child_count_.resize(nodes);
  vocabulary.descriptor_.resize(nodes);
  vocabulary.weight_.resize(words);
  TakeAll(&rest, std::span(vocabulary.child_count_));
  TakeAll(&rest, std::span(vocabulary.descriptor_).subspan(1));
  TakeAll(&rest, std::span(vocabulary.weight_));
  CAIRN_RETURN_IF_ERROR(vocabulary.Link());
  vocabulary.hash_ = Get<std::uint64_t>(bytes, content.size());  // a vocabulary has one form only
  return vocabulary;
}

absl::Status Vocabulary::Save(const std::string& path) const {
  return Annotate(WriteFileAtomically(path, Serialize(), /*overwrite=*/true), "saving the vocabulary");
}

absl::StatusOr<Vocabulary> Vocabulary::Load(const std::string& path) {
  const absl::StatusOr<std::string> bytes = ReadWholeFile(path);
  if (!bytes.ok()) return Annotate(bytes.status(), "loading the vocabulary");
  absl::StatusOr<Vocabulary> vocabulary = Parse(*bytes);
  if (!vocabulary.ok()) return Annotate(vocabulary.status(), path);
  return vocabulary;
}

}  // namespace cairn::place
