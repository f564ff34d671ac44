// What the calls of cairn.v1 do, one file each, whichever way they came in: requests are checked and become values, an
// api::MapService answers. Any thread. An error leaves the response undefined.
#pragma once

#include <cairn/v1/admin.pb.h>
#include <cairn/v1/align.pb.h>
#include <cairn/v1/localize.pb.h>
#include <cairn/v1/maps.pb.h>
#include <cairn/v1/sessions.pb.h>
#include <cairn/v1/status.pb.h>

#include <atomic>
#include <functional>
#include <string>

#include "absl/strings/string_view.h"
#include "api/map_service.h"
#include "api/server_status.h"
#include "base/status.h"
#include "server/access/access.h"

namespace cairn::server {

// How large images may be, whatever they or their camera claim; checked before anything is decoded.
struct ImageLimits {
  std::int64_t max_pixels = 16'000'000;
};

// Who watches what is asked and how it comes out. From any thread.
class CallObserver {
 public:
  virtual ~CallObserver() = default;
  // `call` as "Maps.ListMaps"; `reason` of wire/errors.h, "ok" if all went well.
  virtual void OnCall(absl::string_view call, absl::string_view reason, double seconds) = 0;
  virtual void OnLocalized(const api::LocalizeAnswer& answer) = 0;
  virtual void OnTracked(const api::TrackAnswer* answer) = 0;  // null: the frame could not be used
  // `state`: of api::SessionStateName(), or "refused".
  virtual void OnSessionFrame(absl::string_view state, double seconds) = 0;
  // Of a session, by its client, who could not wait.
  virtual void OnFramesDropped(std::int64_t count) = 0;
};

// Who knows how the server is doing. From any thread.
class StatusSource {
 public:
  virtual ~StatusSource() = default;
  virtual api::ServerStatus Status() = 0;
};

// What a call works with. Serve() (serve.h) makes that of one call out of the server's: `maps` as the client may use
// them.
struct CallContext {
  api::MapService* maps = nullptr;
  ImageLimits images;
  CallObserver* observer = nullptr;               // null: nobody
  Access* access = nullptr;                       // null: everyone may do everything
  const Client* client = nullptr;                 // of one call: who asks
  StatusSource* status = nullptr;                 // null: nobody
  std::atomic<std::int64_t>* received = nullptr;  // of one call: bytes that came in it; null: nobody counts
  const std::string* maps_folder = nullptr;       // that no error names to a client; null: any may be
};

absl::Status ListMaps(const CallContext& context, const v1::ListMapsRequest& request, v1::ListMapsResponse* response);
absl::Status DescribeMap(const CallContext& context, const v1::DescribeMapRequest& request,
                         v1::DescribeMapResponse* response);
absl::Status LocalizeImage(const CallContext& context, const v1::LocalizeImageRequest& request,
                           v1::LocalizeImageResponse* response);
absl::Status LocalizeInMaps(const CallContext& context, const v1::LocalizeInMapsRequest& request,
                            v1::LocalizeInMapsResponse* response);
absl::Status ListSessions(const CallContext& context, const v1::ListSessionsRequest& request,
                          v1::ListSessionsResponse* response);
absl::Status GetStatus(const CallContext& context, const v1::GetStatusRequest& request,
                       v1::GetStatusResponse* response);

absl::Status CreateMap(const CallContext& context, const v1::CreateMapRequest& request,
                       v1::CreateMapResponse* response);
absl::Status SnapshotMap(const CallContext& context, const v1::SnapshotMapRequest& request,
                         v1::SnapshotMapResponse* response);
absl::Status DeleteMap(const CallContext& context, const v1::DeleteMapRequest& request,
                       v1::DeleteMapResponse* response);
absl::Status ListDeletedMaps(const CallContext& context, const v1::ListDeletedMapsRequest& request,
                             v1::ListDeletedMapsResponse* response);
absl::Status RestoreMap(const CallContext& context, const v1::RestoreMapRequest& request,
                        v1::RestoreMapResponse* response);
absl::Status VerifyMap(const CallContext& context, const v1::VerifyMapRequest& request,
                       v1::VerifyMapResponse* response);
absl::Status AlignMap(const CallContext& context, const v1::AlignMapRequest& request, v1::AlignMapResponse* response);
absl::Status RemoveSession(const CallContext& context, const v1::RemoveSessionRequest& request,
                           v1::RemoveSessionResponse* response);
absl::Status OverviewMap(const CallContext& context, const v1::OverviewMapRequest& request,
                         v1::OverviewMapResponse* response);
absl::Status ReadLog(const CallContext& context, const v1::ReadLogRequest& request, v1::ReadLogResponse* response);
// `write` gives false once the client is gone.
using ExportWriter = std::function<bool(const v1::ExportMapResponse&)>;
absl::Status ExportMap(const CallContext& context, const v1::ExportMapRequest& request, const ExportWriter& write);

}  // namespace cairn::server
