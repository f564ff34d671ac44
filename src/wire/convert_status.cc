#include "wire/convert_status.h"

#include "wire/convert_sessions.h"
#include "wire/session_names.h"
#include "wire/text.h"

namespace cairn::wire {
namespace {

using Counts = google::protobuf::RepeatedPtrField<v1::Count>;

void WriteCounts(const std::vector<api::ServerStatus::Count>& counts, Counts* out) {
  for (const api::ServerStatus::Count& count : counts) {
    v1::Count* told = out->Add();
    told->set_what(count.what);
    told->set_count(count.count);
  }
}

std::vector<api::ServerStatus::Count> ReadCounts(const Counts& message) {
  std::vector<api::ServerStatus::Count> counts;
  for (const v1::Count& count : message) counts.push_back({count.what(), count.count()});
  return counts;
}

void WriteHistogram(const api::DurationHistogram& histogram, v1::Histogram* out) {
  for (const double bound_s : histogram.bounds_s) out->add_bounds_s(bound_s);
  for (const std::int64_t count : histogram.counts) out->add_counts(count);
  out->set_sum_s(histogram.sum_s);
}

api::DurationHistogram ReadHistogram(const v1::Histogram& message) {
  return {{message.bounds_s().begin(), message.bounds_s().end()},
          {message.counts().begin(), message.counts().end()},
          message.sum_s()};
}

}  // namespace

void ToProto(const api::ActiveSession& session, v1::ActiveSession* out) {
  out->set_map(session.map);
  out->set_source(Utf8(session.source));
  out->set_waiting(session.waiting);
  out->set_running_s(session.running_s);
  out->set_silent_s(session.silent_s);
  out->set_frames(session.frames);
  out->set_state(Write(session.state));
  ToProto(session.progress, out->mutable_progress());
}

api::ActiveSession FromProto(const v1::ActiveSession& message) {
  api::ActiveSession session;
  session.map = message.map();
  session.source = message.source();
  session.waiting = message.waiting();
  session.running_s = message.running_s();
  session.silent_s = message.silent_s();
  session.frames = message.frames();
  session.state = ReadState(message.state());
  session.progress = FromProto(message.progress());
  return session;
}

void ToProto(const api::ServerStatus& status, v1::GetStatusResponse* out) {
  out->set_version(status.version);
  out->set_uptime_s(status.uptime_s);
  out->set_resident_bytes(status.resident_bytes);
  out->set_images_waiting(status.images_waiting);
  out->set_followers(status.followers);
  for (const api::ServerStatus::Map& map : status.maps) {
    v1::OpenMap* told = out->add_maps();
    told->set_map(map.name);
    told->set_revision(map.revision);
    told->set_memory_bytes(map.memory_bytes);
    told->set_writing(map.writing);
  }
  for (const api::ActiveSession& session : status.sessions) ToProto(session, out->add_sessions());
  for (const api::ServerStatus::Calls& calls : status.calls) {
    v1::CallCount* told = out->add_calls();
    told->set_call(calls.call);
    told->set_reason(calls.reason);
    told->set_count(calls.count);
  }
  WriteCounts(status.localized, out->mutable_localized());
  WriteCounts(status.tracked, out->mutable_tracked());
  WriteCounts(status.session_frames, out->mutable_session_frames());
  WriteHistogram(status.localize, out->mutable_localize_time());
  WriteHistogram(status.tracking, out->mutable_tracking_time());
  WriteHistogram(status.session_frame, out->mutable_session_frame_time());
}

api::ServerStatus FromProto(const v1::GetStatusResponse& message) {
  api::ServerStatus status;
  status.version = message.version();
  status.uptime_s = message.uptime_s();
  status.resident_bytes = message.resident_bytes();
  status.images_waiting = message.images_waiting();
  status.followers = message.followers();
  for (const v1::OpenMap& map : message.maps()) {
    status.maps.push_back({map.map(), map.revision(), map.memory_bytes(), map.writing()});
  }
  for (const v1::ActiveSession& session : message.sessions()) status.sessions.push_back(FromProto(session));
  for (const v1::CallCount& calls : message.calls()) {
    status.calls.push_back({calls.call(), calls.reason(), calls.count()});
  }
  status.localized = ReadCounts(message.localized());
  status.tracked = ReadCounts(message.tracked());
  status.session_frames = ReadCounts(message.session_frames());
  status.localize = ReadHistogram(message.localize_time());
  status.tracking = ReadHistogram(message.tracking_time());
  status.session_frame = ReadHistogram(message.session_frame_time());
  return status;
}

}  // namespace cairn::wire
