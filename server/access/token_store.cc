#include "server/access/token_store.h"

#include <spdlog/spdlog.h>

#include <tuple>
#include <utility>
#include <vector>

#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace cairn::server {
namespace {

bool Same(const struct stat& a, const struct stat& b) {
  const auto key = [](const struct stat& s) {
    return std::make_tuple(s.st_dev, s.st_ino, s.st_size, s.st_mtim.tv_sec, s.st_mtim.tv_nsec, s.st_ctim.tv_sec,
                           s.st_ctim.tv_nsec);
  };
  return key(a) == key(b);
}

}  // namespace

absl::StatusOr<std::unique_ptr<TokenStore>> TokenStore::Open(const std::string& path) {
  auto store = std::unique_ptr<TokenStore>(new TokenStore(path));
  struct stat now = {};
  stat(path.c_str(), &now);
  // What is said at the start may say everything.
  CAIRN_RETURN_IF_ERROR(ReadTokens(path).status());
  store->Load(now);
  return store;
}

void TokenStore::Load(const struct stat& seen) {
  seen_ = seen;
  tokens_.clear();
  const absl::StatusOr<std::vector<Token>> read = ReadTokens(path_);
  status_ = read.status();
  if (!read.ok()) {
    spdlog::error("nobody gets in until the tokens can be read: {}", std::string(read.status().message()));
    return;
  }
  for (const Token& token : *read) tokens_[token.hash] = std::make_shared<const Token>(token);
  spdlog::info("{} tokens in {}", tokens_.size(), path_);
}

absl::StatusOr<std::shared_ptr<const Token>> TokenStore::Find(const std::string& hash) {
  const std::lock_guard lock(mutex_);
  struct stat now = {};
  stat(path_.c_str(), &now);  // one that is not there has changed, too
  if (!Same(now, seen_)) Load(now);
  if (!status_.ok()) {
    return absl::UnavailableError("the server cannot read its tokens: tell who runs it to look at its log");
  }
  // Who tries hashes here cannot choose them: what the time of a look-up tells is of no use.
  const auto found = tokens_.find(hash);
  if (found == tokens_.end() || found->second->Expired(absl::ToUnixSeconds(absl::Now()))) return nullptr;
  return found->second;
}

}  // namespace cairn::server
