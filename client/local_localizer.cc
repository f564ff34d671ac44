#include "client/local_localizer.h"

namespace cairn::client {

absl::StatusOr<std::unique_ptr<LocalLocalizer>> LocalLocalizer::Open(const std::string& path,
                                                                     const LocalLocalizerOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  auto localizer = std::unique_ptr<LocalLocalizer>(new LocalLocalizer(options));
  CAIRN_ASSIGN_OR_RETURN(localizer->map_, MapReader::Open(path));
  return localizer;
}

}  // namespace cairn::client
