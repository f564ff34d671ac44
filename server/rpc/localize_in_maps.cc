#include <algorithm>

#include "server/rpc/calls.h"
#include "server/rpc/images.h"
#include "wire/convert.h"

namespace cairn::server {

absl::Status LocalizeInMaps(const CallContext& context, const v1::LocalizeInMapsRequest& request,
                            v1::LocalizeInMapsResponse* response) {
  const std::vector<std::string> maps(request.maps().begin(), request.maps().end());
  for (const std::string& map : maps) CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  api::LocalizeQuery query;
  CAIRN_ASSIGN_OR_RETURN(query.camera, wire::FromProto(request.camera()));
  CAIRN_RETURN_IF_ERROR(ReadContent(request, context.images, &query));
  query.time_ns = request.time_ns();
  CAIRN_ASSIGN_OR_RETURN(const api::AcrossAnswer across, context.maps->LocalizeAcross(maps, query));
  const auto told = std::ranges::find_if(across.answers, [](const auto& answer) { return answer.status.ok(); });
  if (context.observer != nullptr && told != across.answers.end()) context.observer->OnLocalized(told->answer);
  wire::ToProto(across, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
