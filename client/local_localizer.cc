#include "client/local_localizer.h"

#include <utility>

#include "client/map_reader.h"

namespace cairn::client {

absl::StatusOr<std::unique_ptr<LocalLocalizer>> LocalLocalizer::Open(const std::string& path,
                                                                     const LocalLocalizerOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<MapReader> map, MapReader::Open(path));
  return Open(std::unique_ptr<ViewSource>(std::move(map)), options);
}

absl::StatusOr<std::unique_ptr<LocalLocalizer>> LocalLocalizer::Open(std::unique_ptr<ViewSource> map,
                                                                     const LocalLocalizerOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  auto localizer = std::unique_ptr<LocalLocalizer>(new LocalLocalizer(options));
  localizer->map_ = std::move(map);
  return localizer;
}

}  // namespace cairn::client
