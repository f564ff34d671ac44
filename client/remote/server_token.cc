#include "client/remote/server_token.h"

#include <algorithm>

#include "absl/strings/ascii.h"

namespace cairn::client {

absl::Status CheckToken(const std::string& token) {
  if (std::ranges::all_of(token, [](unsigned char c) { return absl::ascii_isgraph(c); })) return absl::OkStatus();
  return absl::InvalidArgumentError("server: a token is one word of ASCII");
}

ServerToken::ServerToken(const RemoteOptions& options) : read_(options.read_token), text_(options.token) {}

std::string ServerToken::Text() const {
  const std::lock_guard lock(mutex_);
  return text_;
}

bool ServerToken::Renewed(const absl::Status& status, const std::string& shown) {
  if (!absl::IsUnauthenticated(status) || !read_) return false;
  const std::lock_guard lock(mutex_);
  if (text_ != shown) return true;  // by another call
  const absl::StatusOr<std::string> read = read_();
  if (!read.ok() || read->empty() || !CheckToken(*read).ok() || *read == text_) return false;
  text_ = *read;
  return true;
}

}  // namespace cairn::client
