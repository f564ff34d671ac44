// Messages of either side as values: the first byte says which message the others are.
#include <google/protobuf/stubs/logging.h>

#include <array>
#include <memory>

#include "wire/convert.h"
#include "wire/convert_admin.h"
#include "wire/convert_alignment.h"
#include "wire/convert_deltas.h"
#include "wire/convert_map_rows.h"
#include "wire/convert_sessions.h"
#include "wire/convert_status.h"
#include "wire/convert_tracks.h"
#include "wire/errors.h"

using namespace cairn;

namespace {

template <class Message>
void Convert(const std::string& bytes) {
  Message message;
  if (!message.ParseFromString(bytes)) return;
  const auto value = wire::FromProto(message);
  (void)value;
}

// Messages one after another, each behind its length in two bytes: a map, and then what changes in it.
void ReadUpdates(const std::string& bytes) {
  auto reader = std::make_unique<wire::UpdateReader>(nullptr);
  for (std::size_t at = 0; at + 2 <= bytes.size();) {
    const std::size_t length = static_cast<unsigned char>(bytes[at]) + 256 * static_cast<unsigned char>(bytes[at + 1]);
    v1::FollowMapResponse message;
    if (!message.ParseFromString(bytes.substr(at + 2, length))) return;
    const absl::StatusOr<bool> last = reader->Read(message);
    if (!last.ok()) return;
    if (*last) {
      const auto update = reader->Take();
      if (!update.ok()) return;
      const auto map = wire::Applied(*update);
      if (!map.ok()) return;
      reader = std::make_unique<wire::UpdateReader>(*map);
    }
    at += 2 + length;
  }
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  google::protobuf::SetLogHandler(nullptr);
  return 0;
}

namespace {

// By number: those that there are keep theirs, so that inputs that are kept mean what they did.
constexpr std::array kMessages = {Convert<v1::Camera>,
                                  Convert<v1::PosePrior>,
                                  Convert<v1::StartSession>,
                                  Convert<v1::LocalizeImageResponse>,
                                  Convert<v1::DescribeMapResponse>,
                                  Convert<v1::FrameAnswer>,
                                  Convert<v1::SessionSummary>,
                                  Convert<v1::TrackAnswer>};
constexpr std::uint8_t kError = 8, kUpdates = 9, kNumFirst = 10, kSecond = 240;
constexpr std::array kSecondMessages = {Convert<v1::ImageFeatures>,
                                        Convert<v1::LocalizeInMapsResponse>,
                                        Convert<v1::MapSummary>,
                                        Convert<v1::AlignMapRequest>,
                                        Convert<v1::AlignMapResponse>,
                                        Convert<v1::VerifyMapResponse>,
                                        Convert<v1::ReadLogRequest>,
                                        Convert<v1::ReadLogResponse>,
                                        Convert<v1::RemoveSessionResponse>,
                                        Convert<v1::GetStatusResponse>,
                                        Convert<v1::MapRegion>,
                                        Convert<v1::DeletedMap>,
                                        Convert<v1::SessionProgress>,
                                        Convert<v1::ComponentRow>,
                                        Convert<v1::SessionRow>,
                                        Convert<v1::GeoAnchor>};
static_assert(kSecond + kSecondMessages.size() == 256);

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  const std::uint8_t which = data[0];
  if (which >= kSecond) {
    kSecondMessages[which - kSecond](bytes);
  } else if (which % kNumFirst == kError) {
    (void)wire::StatusFrom(size > 1 ? data[1] : 0, "said", bytes);
  } else if (which % kNumFirst == kUpdates) {
    ReadUpdates(bytes);
  } else {
    kMessages[which % kNumFirst](bytes);
  }
  return 0;
}
