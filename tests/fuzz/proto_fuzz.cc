// Messages of either side as values: the first byte says which message the others are.
#include <google/protobuf/stubs/logging.h>

#include "wire/convert.h"
#include "wire/convert_deltas.h"
#include "wire/convert_sessions.h"
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

// Messages one after another, each behind its length in two bytes.
void ReadUpdate(const std::string& bytes) {
  wire::UpdateReader reader(nullptr);
  for (std::size_t at = 0; at + 2 <= bytes.size();) {
    const std::size_t length = static_cast<unsigned char>(bytes[at]) + 256 * static_cast<unsigned char>(bytes[at + 1]);
    v1::FollowMapResponse message;
    if (!message.ParseFromString(bytes.substr(at + 2, length))) return;
    const absl::StatusOr<bool> last = reader.Read(message);
    if (!last.ok()) return;
    if (*last) {
      (void)reader.Take();
      return;
    }
    at += 2 + length;
  }
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  google::protobuf::SetLogHandler(nullptr);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  constexpr std::uint8_t kFeatures = 240;  // apart, so that the others mean what they did in inputs that are kept
  switch (data[0] == kFeatures ? kFeatures : data[0] % 10) {
    case 0:
      Convert<v1::Camera>(bytes);
      break;
    case 1:
      Convert<v1::PosePrior>(bytes);
      break;
    case 2:
      Convert<v1::StartSession>(bytes);
      break;
    case 3:
      Convert<v1::LocalizeImageResponse>(bytes);
      break;
    case 4:
      Convert<v1::DescribeMapResponse>(bytes);
      break;
    case 5:
      Convert<v1::FrameAnswer>(bytes);
      break;
    case 6:
      Convert<v1::SessionSummary>(bytes);
      break;
    case 7:
      Convert<v1::TrackAnswer>(bytes);
      break;
    case 8:
      (void)wire::StatusFrom(size > 1 ? data[1] : 0, "said", bytes);
      break;
    case kFeatures:
      Convert<v1::ImageFeatures>(bytes);
      break;
    default:
      ReadUpdate(bytes);
  }
  return 0;
}
