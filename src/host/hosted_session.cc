#include "host/hosted_session.h"

#include <algorithm>
#include <utility>

#include "base/guarded.h"
#include "client/query_image.h"
#include "store/fault.h"

namespace cairn::host {
namespace {

api::SessionState ToApi(direct::TrackingState state) {
  switch (state) {
    case direct::TrackingState::kInitializing:
      return api::SessionState::kInitializing;
    case direct::TrackingState::kGood:
      return api::SessionState::kGood;
    case direct::TrackingState::kPoor:
      return api::SessionState::kPoor;
    case direct::TrackingState::kLost:
      return api::SessionState::kLost;
  }
  return api::SessionState::kLost;
}

engine::SessionSource SourceOf(const api::SessionRequest& request) {
  engine::SessionSource source;
  source.name = request.source;
  source.camera_name = request.camera_name;
  source.camera = request.camera;
  source.first_ns = request.first_ns;
  source.settings_json = R"({"served":true})";
  return source;
}

// Whether it is the map that the client goes on in, and nothing that it was told of is missing.
absl::Status CheckMeant(const api::SessionRequest& request, const map::Snapshot& map) {
  if (request.policy != map::SessionPolicy::kExtend) return absl::OkStatus();
  if (!request.map_id.empty() && request.map_id != map.info().id) {
    return store::MakeFault(store::Fault::kMoved,
                            absl::StrCat("\"", request.map, "\" is another map by now (", map.info().id,
                                         "), not the one that the session was in (", request.map_id, ")"));
  }
  if (map.revision() < request.least_revision) {
    return store::MakeFault(
        store::Fault::kMoved,
        absl::StrCat("\"", request.map, "\" is at revision ", map.revision(), ", and the session was told of ",
                     request.least_revision, ": an older copy has taken its place, which lacks what was mapped since"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<HostedSession>> HostedSession::Start(const api::SessionRequest& request,
                                                                    std::shared_ptr<engine::LiveMap> map, Tell tell) {
  auto session = std::unique_ptr<HostedSession>(new HostedSession(std::move(map)));
  session->changes_ = session->map_->Subscribe();
  session->tell_ = std::move(tell);
  session->map_name_ = request.map;
  session->map_id_ = session->map_->Published()->map().info().id;
  CAIRN_RETURN_IF_ERROR(CheckMeant(request, session->map_->Published()->map()));
  session->camera_ = request.camera;
  CAIRN_ASSIGN_OR_RETURN(session->session_,
                         engine::Session::Create(engine::SessionOptions(), SourceOf(request), session->map_.get()));
  session->progress_.session = session->session_->id();
  session->Look();
  return session;
}

// What has become durable since, and where that leaves the session.
void HostedSession::Look() {
  for (;;) {
    const auto change = changes_->Next(std::chrono::milliseconds(0));
    if (!change.ok() || !*change) break;
    for (const auto& keyframe : (*change)->delta->keyframes) {
      if (keyframe->session != progress_.session) continue;
      progress_.durable_ns = std::max(progress_.durable_ns.value_or(keyframe->time_ns), keyframe->time_ns);
    }
  }
  const std::shared_ptr<const tracking::MapView> published = map_->Published();
  progress_.revision = published->revision();
  progress_.keyframes = static_cast<std::int64_t>(published->map().keyframes().size());
  const engine::Whereabouts where = session_->Where();
  progress_.component = where.component;
  if (where.located) {
    progress_.located_ns = where.located->time_ns;
    progress_.located_component = where.located->component;
  }
  progress_.joined_ns = where.joined_ns;
}

absl::StatusOr<api::SessionAnswer> HostedSession::AddFrame(const api::SessionFrame& frame) {
  absl::StatusOr<api::SessionAnswer> answer = Track(frame);
  if (!answer.ok()) return Failed(answer.status());
  return answer;
}

absl::StatusOr<api::SessionSummary> HostedSession::Finish() {
  absl::StatusOr<api::SessionSummary> summary = End();
  if (!summary.ok()) return Failed(summary.status());
  return summary;
}

// Some of what was under way may have become durable before the rest failed.
absl::Status HostedSession::Failed(const absl::Status& error) {
  Look();
  return tell_(error, progress_.revision);
}

absl::StatusOr<api::SessionAnswer> HostedSession::Track(const api::SessionFrame& frame) {
  CAIRN_RETURN_IF_ERROR(client::CheckImage(frame.image, camera_, "session"));
  CAIRN_RETURN_IF_ERROR(Annotate(times_.Accept(frame.time_ns), "session"));
  engine::RawFrame raw;
  raw.index = next_index_++;
  raw.time_ns = frame.time_ns;
  raw.gray = frame.image.clone();  // kept for longer than the caller keeps his
  CAIRN_ASSIGN_OR_RETURN(const direct::FrameResult result, session_->AddFrame(raw));
  api::SessionAnswer answer;
  answer.time_ns = frame.time_ns;
  answer.state = ToApi(result.state);
  if (const std::optional<engine::LivePose> pose = session_->PoseInMap(result)) {
    answer.map_from_camera = pose->map_from_camera;
    answer.component = pose->component;
    answer.world_from_component = pose->world_from_component;
  } else {
    answer.reason = result.message.empty() ? "nothing links it to the map yet" : result.message;
  }
  Look();
  last_answer_ = answer;
  return answer;
}

absl::StatusOr<api::SessionSummary> HostedSession::End() {
  CAIRN_ASSIGN_OR_RETURN(const engine::SessionReport report, session_->Finish());
  Look();
  const std::shared_ptr<const map::Snapshot> map = map_->Published()->snapshot();
  api::SessionSummary summary;
  summary.session = report.session;
  summary.frames = report.frames;
  summary.frames_tracked = report.frames_tracked;
  summary.keyframes = report.keyframes;
  summary.points = report.points;
  summary.result = report.result;
  summary.joins = static_cast<int>(report.joins.size());
  summary.loops = static_cast<int>(report.loops.size());
  summary.revision = map->revision();
  // That with most of its frames, as of the files that `cairn run` writes.
  const auto most = std::ranges::max_element(report.components, {}, &engine::ComponentShare::frames);
  summary.component = most != report.components.end() ? most->id : report.component;
  if (map->components().contains(summary.component)) {
    summary.world_from_component = map->WorldFrom(summary.component);
  }
  for (const engine::FramePose& frame : report.frame_poses) {
    if (frame.map_from_camera && frame.component == summary.component) {
      summary.poses.push_back({frame.time_ns, *frame.map_from_camera});
    }
  }
  return summary;
}

}  // namespace cairn::host
