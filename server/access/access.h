// Who may do what, how much of it, and what is written down about it. Any thread.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "base/ids.h"
#include "base/status.h"
#include "server/access/client.h"
#include "server/access/client_limits.h"
#include "server/access/json_log.h"
#include "server/access/token_store.h"

namespace cairn::server {

struct AccessOptions {
  std::string tokens;       // file (cairnd token create); empty: whoever reaches the server may do everything
  std::string audit_log;    // file; empty: none
  bool audit_sync = true;   // each line is on the disk before the client is answered
  std::string request_log;  // file; empty: none
  ClientLimitOptions limits;

  absl::Status Validate() const { return limits.Validate(); }
};

// A change of what the server keeps, as the audit log has it.
struct Change {
  std::string action;   // "session_started", "map_deleted", ...
  std::string map;      // its name
  std::string details;  // a JSON object; empty: none
};

// Of what is written down about a session: {"session":3}.
std::string SessionDetails(SessionId session);

class Access {
 public:
  // Errors of the files.
  static absl::StatusOr<std::unique_ptr<Access>> Open(const AccessOptions& options);

  // Who asks. Unauthenticated without a token that is known; Unavailable if the tokens cannot be read.
  absl::StatusOr<Client> Identify(const Caller& caller);

  // Looks into the tokens as they are now: Unauthenticated for one that was revoked meanwhile, PermissionDenied,
  // whether there is such a map or not, for one that may not. `map`: "*" for all that there are.
  absl::Status Require(const Client& client, Right right, const std::string& map);

  // Unavailable if nobody gets in, as the tokens cannot be read.
  absl::Status Ready();

  ClientLimits& limits() { return limits_; }

  // One line in the audit log. `outcome`: how the change went; one that was refused is written down, too.
  void Record(const Client& client, const Change& change, const absl::Status& outcome);
  // Somebody who could not say who they are: a line in the audit log, one a second at most, with how many there were
  // since the one before, so that knocking does not fill a disk.
  void RecordUnknown(const Caller& caller, const std::string& request_id, const absl::Status& refused);
  // Whose session it is, until it has ended: for what becomes of it when nobody asks. A client that comes back to one
  // has it then.
  void Hold(const std::string& map, SessionId session, const Client& client);
  // No more, and whose it was; none: nobody has said.
  std::optional<Client> LetGo(const std::string& map, SessionId session);
  // The server stops: streams that end from now on are not left by their clients.
  void BeginStop() { stopping_ = true; }
  bool stopping() const { return stopping_; }
  // Once nothing is served any more: a line in the audit log for every session that is held still.
  void RecordCutOff();
  // Lines of the audit log that could not be written: what they were of has happened all the same.
  std::int64_t lost_audit_lines() const { return lost_audit_lines_; }
  // One line in the log of requests.
  void RecordRequest(const Client& client, const std::string& call, const absl::Status& outcome, double seconds,
                     std::int64_t bytes);

 private:
  explicit Access(const AccessOptions& options) : limits_(options.limits) {}
  void Audit(const std::string& line);

  std::unique_ptr<TokenStore> tokens_;  // null: not asked for
  std::unique_ptr<JsonLog> audit_;
  std::unique_ptr<JsonLog> requests_;
  ClientLimits limits_;
  std::atomic<std::int64_t> lost_audit_lines_ = 0;
  std::atomic<bool> stopping_ = false;
  std::mutex held_mutex_;
  std::map<std::pair<std::string, SessionId>, Client> held_;  // with held_mutex_
  std::mutex unknown_mutex_;                                  // guards what follows
  std::int64_t unknown_ = 0;                                  // since the last line
  std::optional<std::chrono::steady_clock::time_point> unknown_written_;
};

}  // namespace cairn::server
