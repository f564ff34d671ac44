// A session of a host: an engine::Session in a map that others read and extend meanwhile, and what its client is told.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "api/map_session.h"
#include "base/frame_times.h"
#include "base/status.h"
#include "engine/live_map.h"
#include "engine/session.h"

namespace cairn::host {

// By one thread at a time.
class HostedSession {
 public:
  // What clients are told of an error, in a session whose map is at `revision` (0: it was never made). May be called as
  // long as the session lives.
  using Tell = std::function<absl::Status(const absl::Status& error, Revision revision)>;

  // Errors as of engine::Session::Create, and the fault kMoved if the request wants another map than this.
  static absl::StatusOr<std::unique_ptr<HostedSession>> Start(const api::SessionRequest& request,
                                                              std::shared_ptr<engine::LiveMap> map, Tell tell);

  // As those of api::MapSession.
  absl::StatusOr<api::SessionAnswer> AddFrame(const api::SessionFrame& frame);
  absl::StatusOr<api::SessionSummary> Finish();
  const std::string& map() const { return map_name_; }
  const std::string& map_id() const { return map_id_; }
  const Camera& camera() const { return camera_; }
  const api::SessionProgress& progress() const { return progress_; }
  const std::optional<api::SessionAnswer>& last_answer() const { return last_answer_; }

 private:
  explicit HostedSession(std::shared_ptr<engine::LiveMap> map) : map_(std::move(map)) {}
  absl::StatusOr<api::SessionAnswer> Track(const api::SessionFrame& frame);
  absl::StatusOr<api::SessionSummary> End();
  void Look();
  absl::Status Failed(const absl::Status& error);

  const std::shared_ptr<engine::LiveMap> map_;  // outlives the session
  std::shared_ptr<engine::Subscription> changes_;
  std::unique_ptr<engine::Session> session_;
  Tell tell_;
  std::string map_name_;
  std::string map_id_;
  Camera camera_;
  FrameTimes times_;
  std::int64_t next_index_ = 0;
  api::SessionProgress progress_;
  std::optional<api::SessionAnswer> last_answer_;
};

}  // namespace cairn::host
