#include "server/access/access.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

using nlohmann::ordered_json;

ordered_json LineOf(const Client& client, const absl::Status& outcome) {
  ordered_json line{{"time", LogTime()}, {"request", client.request_id}};
  if (!client.token_name.empty()) line["token"] = client.token_name;
  line["peer"] = client.peer;
  line["outcome"] = std::string(wire::KindOf(outcome).reason);
  return line;
}

std::string Dumped(const ordered_json& line) {
  return line.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

bool Write(JsonLog* log, const std::string& line) {
  const absl::Status written = log->Append(line);
  if (!written.ok()) spdlog::error("{}", std::string(written.message()));
  return written.ok();
}

absl::Status Unknown() {
  return absl::UnauthenticatedError(
      "the token is not known here: it was revoked, has expired, or is of another server");
}

}  // namespace

bool IsLoopbackPeer(const std::string& peer) {
  return peer == "unix" || peer == "::1" || absl::StartsWith(peer, "127.") || absl::StartsWith(peer, "::ffff:127.");
}

absl::StatusOr<std::unique_ptr<Access>> Access::Open(const AccessOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  auto access = std::unique_ptr<Access>(new Access(options));
  if (!options.tokens.empty()) {
    CAIRN_ASSIGN_OR_RETURN(access->tokens_, TokenStore::Open(options.tokens));
  }
  if (!options.audit_log.empty()) {
    CAIRN_ASSIGN_OR_RETURN(access->audit_, JsonLog::Open(options.audit_log, options.audit_sync));
  }
  if (!options.request_log.empty()) {
    CAIRN_ASSIGN_OR_RETURN(access->requests_, JsonLog::Open(options.request_log, /*sync=*/false));
  }
  return access;
}

absl::StatusOr<Client> Access::Identify(const Caller& caller) {
  Client client;
  client.peer = caller.peer;
  if (tokens_ == nullptr) {
    if (!IsLoopbackPeer(caller.peer)) client.limited_as = absl::StrCat("peer ", caller.peer);
    return client;
  }
  absl::string_view secret = caller.authorization;
  if (secret.empty()) {
    return absl::UnauthenticatedError(
        "this server asks for a token: send the header Authorization: Bearer TOKEN (cairn: --token-file)");
  }
  constexpr absl::string_view kScheme = "Bearer ";
  if (!absl::StartsWithIgnoreCase(secret, kScheme)) {
    return absl::UnauthenticatedError("the header Authorization must be: Bearer TOKEN");
  }
  secret.remove_prefix(kScheme.size());
  client.token_hash = HashOfToken(absl::StripAsciiWhitespace(secret));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const Token> token, tokens_->Find(client.token_hash));
  if (token == nullptr) return Unknown();
  client.token_name = token->name;
  client.limited_as = absl::StrCat("token ", token->name);
  return client;
}

absl::Status Access::Ready() { return tokens_ == nullptr ? absl::OkStatus() : tokens_->Find("").status(); }

absl::Status Access::Require(const Client& client, Right right, const std::string& map) {
  if (tokens_ == nullptr) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const Token> token, tokens_->Find(client.token_hash));
  if (token == nullptr) return Unknown();
  if (token->right >= right && token->Covers(map)) return absl::OkStatus();
  return absl::PermissionDeniedError(absl::StrCat("your token does not give the right `", RightName(right), "` for ",
                                                  map == "*" ? "all maps" : "this map"));
}

void Access::Record(const Client& client, const Change& change, const absl::Status& outcome) {
  if (audit_ == nullptr) return;
  ordered_json line = LineOf(client, outcome);
  line["action"] = change.action;
  line["map"] = change.map;
  if (!outcome.ok()) line["message"] = std::string(outcome.message());
  if (!change.details.empty()) line["details"] = ordered_json::parse(change.details, nullptr, false);
  Audit(Dumped(line));
}

void Access::Audit(const std::string& line) {
  if (!Write(audit_.get(), line)) ++lost_audit_lines_;
}

void Access::Hold(const std::string& map, SessionId session, const Client& client) {
  const std::lock_guard lock(held_mutex_);
  held_[{map, session}] = client;
}

std::optional<Client> Access::LetGo(const std::string& map, SessionId session) {
  const std::lock_guard lock(held_mutex_);
  const auto found = held_.find({map, session});
  if (found == held_.end()) return std::nullopt;
  std::optional<Client> client = std::move(found->second);
  held_.erase(found);
  return client;
}

std::string SessionDetails(SessionId session) { return absl::StrFormat(R"({"session":%d})", session.value()); }

void Access::RecordCutOff() {
  decltype(held_) held;
  {
    const std::lock_guard lock(held_mutex_);
    held.swap(held_);
  }
  for (const auto& [session, client] : held) {
    Record(client, {"session_cut_off", session.first, SessionDetails(session.second)}, absl::OkStatus());
  }
}

void Access::RecordUnknown(const Caller& caller, const std::string& request_id, const absl::Status& refused) {
  if (audit_ == nullptr) return;
  constexpr std::chrono::seconds kPause(1);
  std::int64_t attempts = 0;
  {
    const std::lock_guard lock(unknown_mutex_);
    ++unknown_;
    const auto now = std::chrono::steady_clock::now();
    if (unknown_written_ && now - *unknown_written_ < kPause) return;
    unknown_written_ = now;
    attempts = std::exchange(unknown_, 0);
  }
  ordered_json line = LineOf({.peer = caller.peer, .request_id = request_id}, refused);
  line["action"] = "unknown_client";
  line["message"] = std::string(refused.message());
  line["details"] = {{"attempts", attempts}};
  Audit(Dumped(line));
}

void Access::RecordRequest(const Client& client, const std::string& call, const absl::Status& outcome, double seconds,
                           std::int64_t bytes) {
  if (requests_ == nullptr) return;
  ordered_json line = LineOf(client, outcome);
  line["call"] = call;
  line["ms"] = std::round(1e6 * seconds) / 1e3;
  line["bytes"] = bytes;
  Write(requests_.get(), Dumped(line));
}

}  // namespace cairn::server
