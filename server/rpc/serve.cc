#include "server/rpc/serve.h"

#include <spdlog/spdlog.h>

#include <atomic>

#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"
#include "wire/errors.h"

namespace cairn::server {

std::string NewRequestId() {
  static std::atomic<std::uint64_t> last = 0;
  return absl::StrFormat("%08x", ++last);
}

void Note(const CallContext& context, absl::string_view call, const Served& served, double seconds) {
  const wire::ErrorKind& kind = wire::KindOf(served.status);
  if (context.observer != nullptr) context.observer->OnCall(call, kind.reason, seconds);
  if (served.status.ok()) return;
  // What a client wrote may be quoted in it: one line of readable text, whatever that was.
  constexpr std::size_t kMaxLogged = 500;
  spdlog::warn("request {} {} {}: {}", served.request_id, std::string(call), std::string(kind.reason),
               absl::CHexEscape(served.status.message().substr(0, kMaxLogged)));
}

}  // namespace cairn::server
