// The tokens of a file, as it is now: a change is seen by the next request.
#pragma once

#include <sys/stat.h>

#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "base/status.h"
#include "server/access/tokens.h"

namespace cairn::server {

class TokenStore {
 public:
  // Errors of the file as of ReadTokens().
  static absl::StatusOr<std::unique_ptr<TokenStore>> Open(const std::string& path);

  // By its hash. Each call asks the file system whether the file has changed, which takes about a microsecond, and
  // reads it only then. Null: there is no such token, or it has expired. Unavailable if the file is gone or cannot be
  // understood: nobody gets in then, rather than those whom it may just have shut out.
  absl::StatusOr<std::shared_ptr<const Token>> Find(const std::string& hash);

 private:
  using Tokens = std::map<std::string, std::shared_ptr<const Token>>;  // by hash

  explicit TokenStore(std::string path) : path_(std::move(path)) {}
  void Load(const struct stat& seen);

  const std::string path_;
  std::mutex mutex_;  // guards what follows
  struct stat seen_ = {};
  absl::Status status_;
  Tokens tokens_;
};

}  // namespace cairn::server
