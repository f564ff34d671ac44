#include "server/grpc/answer.h"

#include <string>

#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

constexpr const char* kRequestId = "x-request-id";

std::string MetadataOf(const grpc::ServerContext& call, const char* key) {
  const auto found = call.client_metadata().find(key);
  if (found == call.client_metadata().end()) return "";
  return {found->second.data(), found->second.size()};
}

// The address of "ipv4:127.0.0.1:4321", "ipv6:%5B::1%5D:4321" or "unix:".
std::string AddressOf(const std::string& peer) {
  absl::string_view address = peer;
  if (absl::ConsumePrefix(&address, "ipv4:")) return std::string(address.substr(0, address.rfind(':')));
  if (!absl::ConsumePrefix(&address, "ipv6:")) return "unix";
  address = address.substr(0, address.rfind(':'));
  return absl::StrReplaceAll(address, {{"%5B", ""}, {"%5D", ""}, {"[", ""}, {"]", ""}});
}

}  // namespace

Caller CallerOf(const grpc::ServerContext& call, std::int64_t bytes) {
  return {AddressOf(call.peer()), MetadataOf(call, "authorization"), MetadataOf(call, kRequestId), bytes};
}

grpc::Status ToGrpc(const Served& served, grpc::ServerContext* call) {
  call->AddTrailingMetadata(kRequestId, served.request_id);
  if (served.status.ok()) return grpc::Status::OK;
  return {static_cast<grpc::StatusCode>(wire::KindOf(served.status).code), std::string(served.status.message()),
          wire::DetailsOf(served.status, served.request_id)};
}

}  // namespace cairn::server
