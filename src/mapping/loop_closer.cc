#include "mapping/loop_closer.h"

#include <optional>
#include <utility>

#include "mapping/stopwatch.h"

namespace cairn::mapping {
namespace {

// The session of the current keyframe remembers its loop, in the same change of the map.
void NoteInSession(const map::Snapshot& map, const Loop& loop, const LoopEvidence& evidence, map::Edit* edit) {
  const map::Keyframe &current = map.keyframe(loop.current), &old = map.keyframe(loop.loop);
  map::Session session = map.sessions().at(current.session);
  map::ClosedLoop closed;
  closed.keyframe = current.id;
  closed.keyframe_time_ns = current.time_ns;
  closed.loop_keyframe = old.id;
  closed.loop_time_ns = old.time_ns;
  closed.matches = evidence.guided_matches;
  closed.scale = evidence.scale;
  closed.shift = evidence.shift;
  closed.turn_rad = evidence.turn_rad;
  closed.way = evidence.path_length;
  session.loops.push_back(closed);
  edit->PutSession(session);
}

}  // namespace

absl::StatusOr<LoopCloser> LoopCloser::Create(const LoopOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  return LoopCloser(options);
}

absl::StatusOr<LoopReport> LoopCloser::Process(KeyframeId keyframe, MapHead& head) {
  const std::shared_ptr<const tracking::MapView> view = head.View();
  const std::shared_ptr<const map::Snapshot>& map = view->snapshot();
  if (view->places() == nullptr) return absl::FailedPreconditionError("loop closing: the map has no vocabulary");
  if (!map->keyframes().Contains(keyframe)) {
    return absl::NotFoundError(absl::StrCat("loop closing: the map has no keyframe ", keyframe.value()));
  }
  LoopReport report;
  report.current = keyframe;
  Stopwatch watch;
  const std::vector<KeyframeId> candidates = detector_.Detect(*map, *view->places(), keyframe);
  report.detect_ms = watch.LapMs();
  std::optional<Loop> loop;
  for (const KeyframeId candidate : candidates) {
    ++report.candidates;
    loop = VerifyLoop(*map, keyframe, candidate, options_, &report.evidence);
    if (loop) break;
  }
  report.verify_ms = watch.LapMs();
  if (!loop) return report;

  map::Edit edit(map);
  auto correction = CorrectLoop(*loop, edges_, options_, edit);
  if (absl::IsInternal(correction.status())) {
    report.evidence.rejected = std::string(correction.status().message());
    return report;
  }
  CAIRN_RETURN_IF_ERROR(correction.status());
  NoteInSession(*map, *loop, report.evidence, &edit);
  edit.SetSession(map->keyframe(keyframe).session);
  map::Delta delta = edit.Finish(absl::StrCat("close loop ", keyframe.value(), "-", loop->loop.value()));
  report.correct_ms = watch.LapMs();
  CAIRN_RETURN_IF_ERROR(head.Commit(std::move(delta), correction->scales));
  report.commit_ms = watch.LapMs();
  report.closed = true;
  report.loop = loop->loop;
  report.correction = *std::move(correction);
  edges_.insert(edges_.end(), report.correction.new_edges.begin(), report.correction.new_edges.end());
  detector_.Reset();
  ++loops_closed_;
  return report;
}

}  // namespace cairn::mapping
