#include "server/rpc/serve.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <random>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "base/shown.h"
#include "base/told.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

bool IsRequestId(const std::string& text) {
  constexpr std::size_t kMaxLength = 64;
  return !text.empty() && text.size() <= kMaxLength && std::ranges::all_of(text, [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-';
  });
}

// Different from those before the last restart.
std::string NewRequestId() {
  static const std::uint32_t process = std::random_device{}();
  static std::atomic<std::uint64_t> last = 0;
  return absl::StrFormat("%08x-%06x", process, ++last);
}

}  // namespace

std::string RequestIdOf(const Caller& caller) {
  return IsRequestId(caller.request_id) ? caller.request_id : NewRequestId();
}

AdmittedCall::AdmittedCall(const CallContext& server, Client client, ClientLimits::Pass pass)
    : client_(std::move(client)), pass_(std::move(pass)), context_(server) {
  context_.client = &client_;
  if (server.access == nullptr) return;
  maps_ = std::make_unique<AuthorizedMaps>(server.maps, server.access, client_);
  context_.maps = maps_.get();
}

absl::StatusOr<std::unique_ptr<AdmittedCall>> AdmittedCall::Begin(const CallContext& server, const Caller& caller,
                                                                  const std::string& request_id) {
  absl::StatusOr<Client> client = Client{.peer = caller.peer};
  ClientLimits::Pass pass;
  if (server.access != nullptr) {
    client = server.access->Identify(caller);
    // Who is not known is counted by where it comes from.
    const std::string counted = client.ok() ? client->limited_as : absl::StrCat("peer ", caller.peer);
    if (!counted.empty()) {
      CAIRN_ASSIGN_OR_RETURN(pass, server.access->limits().Enter(counted, caller.bytes, ClientLimits::Clock::now()));
    }
    if (absl::IsUnauthenticated(client.status())) server.access->RecordUnknown(caller, request_id, client.status());
    CAIRN_RETURN_IF_ERROR(client.status());
  }
  client->request_id = request_id;
  return std::unique_ptr<AdmittedCall>(new AdmittedCall(server, *std::move(client), std::move(pass)));
}

void CountReceived(const CallContext& context, std::int64_t bytes) {
  if (context.received != nullptr) *context.received += bytes;
  if (context.access == nullptr || context.client == nullptr || context.client->limited_as.empty()) return;
  context.access->limits().ChargeAndWait(context.client->limited_as, bytes);
}

absl::Status Told(const CallContext& server, const absl::Status& status) {
  return server.maps_folder == nullptr ? status : WithoutDirectory(status, *server.maps_folder);
}

void Note(const CallContext& context, const Client& client, absl::string_view call, const Served& served,
          double seconds, std::int64_t received_bytes) {
  const wire::ErrorKind& kind = wire::KindOf(served.status);
  if (context.observer != nullptr) context.observer->OnCall(call, kind.reason, seconds);
  if (context.access != nullptr) {
    context.access->RecordRequest(client, std::string(call), served.status, seconds, received_bytes);
  }
  if (served.status.ok()) return;
  // What a client wrote may be quoted in it: one line of readable text, whatever that was.
  constexpr std::size_t kMaxLogged = 500;
  spdlog::warn("request {} {} {}: {}", served.request_id, std::string(call), std::string(kind.reason),
               Shown(served.status.message(), kMaxLogged));
}

}  // namespace cairn::server
