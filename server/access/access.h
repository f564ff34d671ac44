// Who may do what, how much of it, and what is written down about it. Any thread.
#pragma once

#include <memory>
#include <string>

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
  // One line in the log of requests.
  void RecordRequest(const Client& client, const std::string& call, const absl::Status& outcome, double seconds,
                     std::int64_t bytes);

 private:
  explicit Access(const AccessOptions& options) : limits_(options.limits) {}

  std::unique_ptr<TokenStore> tokens_;  // null: not asked for
  std::unique_ptr<JsonLog> audit_;
  std::unique_ptr<JsonLog> requests_;
  ClientLimits limits_;
};

}  // namespace cairn::server
