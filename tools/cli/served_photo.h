// "Where is this camera?", asked of a server with a file as it is, PNG or JPEG, as phones and web pages do. The verbs
// and the library send gray pixels or features; this is for measuring what others get.
#pragma once

#include <memory>
#include <string>

#include "api/localizer.h"
#include "base/status.h"
#include "client/remote/remote_map_service.h"

namespace cairn::cli {

// By one thread at a time.
class PhotoAsker {
 public:
  virtual ~PhotoAsker() = default;
  virtual absl::StatusOr<api::LocalizeAnswer> Ask(const std::string& map, const std::string& file,
                                                  const Camera& camera) = 0;
};
absl::StatusOr<std::unique_ptr<PhotoAsker>> NewPhotoAsker(const client::RemoteOptions& options);

// Bytes of the request of one image: of its pixels, or of its features.
std::int64_t RequestBytes(const api::LocalizeQuery& query);
std::int64_t RequestBytes(const std::string& file, const Camera& camera);

}  // namespace cairn::cli
