// The token that a client shows its server with every call. Files of tokens are replaced while clients run: once the
// server does not know the one that it was shown, what it came from is read again.
#pragma once

#include <mutex>
#include <string>

#include "base/status.h"
#include "client/remote/remote_map_service.h"

namespace cairn::client {

// Any thread.
class ServerToken {
 public:
  explicit ServerToken(const RemoteOptions& options);

  std::string Text() const;  // empty: none is shown
  // After a call that showed `shown` ended in `status`: whether it is to be made again, as that was Unauthenticated and
  // there is another token by now.
  bool Renewed(const absl::Status& status, const std::string& shown);

 private:
  const decltype(RemoteOptions::read_token) read_;
  mutable std::mutex mutex_;
  std::string text_;
};

// `call` once, and once more if the token turns out to have been replaced.
template <class Function>
absl::Status WithToken(const RemoteOptions& options, Function&& call) {
  if (options.shown == nullptr) return call();
  const std::string shown = options.shown->Text();
  const absl::Status status = call();
  return options.shown->Renewed(status, shown) ? call() : status;
}

}  // namespace cairn::client
