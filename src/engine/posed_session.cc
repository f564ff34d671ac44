#include "engine/posed_session.h"

namespace cairn::engine {

absl::StatusOr<std::unique_ptr<PosedSession>> PosedSession::Create(const mapping::PosedMapperOptions& options,
                                                                   bool deterministic, const SessionSource& source,
                                                                   LiveMap* map) {
  CAIRN_RETURN_IF_ERROR(source.camera.Validate());
  CAIRN_ASSIGN_OR_RETURN(image::Undistorter undistorter, image::Undistorter::Create(source.camera));
  std::unique_ptr<PosedSession> session(new PosedSession(std::move(undistorter), deterministic, map));
  const SessionHead::Turn turn(&session->head_);
  CAIRN_ASSIGN_OR_RETURN(session->session_,
                         BeginSession(source, session->undistorter_.pinhole(), !deterministic, session->head_));
  CAIRN_ASSIGN_OR_RETURN(session->mapper_, mapping::PosedMapper::Create(options, &session->head_, session->session_.id,
                                                                        session->session_.camera));
  return session;
}

absl::Status PosedSession::AddFrame(const RawFrame& frame, const SE3& world_from_camera) {
  mapping::PosedImage image;
  CAIRN_ASSIGN_OR_RETURN(image.image, undistorter_.Undistort(frame.gray));
  image.index = frame.index;
  image.time_ns = frame.time_ns;
  image.world_from_camera = world_from_camera;
  CAIRN_RETURN_IF_ERROR(mapper_->Add(image).status());
  last_time_ns_ = frame.time_ns;
  return absl::OkStatus();
}

absl::StatusOr<mapping::PosedMapperReport> PosedSession::Finish() {
  const SessionHead::Turn turn(&head_);
  const absl::StatusOr<mapping::PosedMapperReport> report = mapper_->Finish();
  if (!report.ok()) {
    if (session_.policy == map::SessionPolicy::kExtend) {  // nothing of it is left open in a map that is there
      CAIRN_RETURN_IF_ERROR(EndSession(session_.id, last_time_ns_, !deterministic_, std::nullopt, head_));
    }
    return report.status();
  }
  const auto& touched = head_.View()->map().sessions().at(session_.id).components;
  if (!touched.empty()) component_ = touched.back();
  CAIRN_RETURN_IF_ERROR(EndSession(session_.id, last_time_ns_, !deterministic_, std::nullopt, head_));
  return report;
}

}  // namespace cairn::engine
