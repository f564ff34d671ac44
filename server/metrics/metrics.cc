#include "server/metrics/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <mutex>
#include <tuple>
#include <utility>

#include "base/version.h"

namespace cairn::server {
namespace {

const prometheus::Histogram::BucketBoundaries kSeconds = {0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1,
                                                          0.2,   0.5,   1.0,   2.0,  5.0,  10.0, 30.0};

// Of this process; 0 if the system does not say.
double ResidentBytes() {
  std::ifstream statm("/proc/self/statm");
  double pages = 0.0, resident = 0.0;
  statm >> pages >> resident;
  return statm ? resident * static_cast<double>(sysconf(_SC_PAGESIZE)) : 0.0;
}

std::string LabelOf(const prometheus::ClientMetric& metric, const std::string& name) {
  for (const prometheus::ClientMetric::Label& label : metric.label) {
    if (label.name == name) return label.value;
  }
  return "";
}

std::vector<api::ServerStatus::Count> CountsOf(const prometheus::MetricFamily& family, const std::string& label) {
  std::vector<api::ServerStatus::Count> counts;
  for (const prometheus::ClientMetric& metric : family.metric) {
    counts.push_back({LabelOf(metric, label), static_cast<std::int64_t>(metric.counter.value)});
  }
  std::ranges::sort(counts, {}, &api::ServerStatus::Count::what);
  return counts;
}

api::DurationHistogram HistogramOf(const prometheus::ClientMetric& metric) {
  api::DurationHistogram histogram;
  std::uint64_t below = 0;  // those of Prometheus are cumulative
  for (const prometheus::ClientMetric::Bucket& bucket : metric.histogram.bucket) {
    if (std::isfinite(bucket.upper_bound)) histogram.bounds_s.push_back(bucket.upper_bound);
    histogram.counts.push_back(static_cast<std::int64_t>(bucket.cumulative_count - below));
    below = bucket.cumulative_count;
  }
  histogram.sum_s = metric.histogram.sample_sum;
  return histogram;
}

// Calls that locate an image, whichever way they come in.
bool Locates(const std::string& call) {
  return call == "Localize.LocalizeImage" || call == "Localize.LocalizeInMaps" || call == "GeoPose";
}

// Both of the same buckets, or `sum` empty.
void Add(const api::DurationHistogram& more, api::DurationHistogram* sum) {
  sum->bounds_s = more.bounds_s;
  sum->counts.resize(more.counts.size());
  for (std::size_t i = 0; i < more.counts.size(); ++i) sum->counts[i] += more.counts[i];
  sum->sum_s += more.sum_s;
}

void AddFamily(const prometheus::MetricFamily& family, api::ServerStatus* status) {
  if (family.name == "cairn_calls_total") {
    for (const prometheus::ClientMetric& metric : family.metric) {
      status->calls.push_back(
          {LabelOf(metric, "call"), LabelOf(metric, "reason"), static_cast<std::int64_t>(metric.counter.value)});
    }
  } else if (family.name == "cairn_localize_total") {
    status->localized = CountsOf(family, "outcome");
  } else if (family.name == "cairn_track_frames_total") {
    status->tracked = CountsOf(family, "state");
  } else if (family.name == "cairn_session_frames_total") {
    status->session_frames = CountsOf(family, "state");
  } else if (family.name == "cairn_track_seconds") {
    status->tracking = HistogramOf(family.metric.at(0));
  } else if (family.name == "cairn_session_frame_seconds") {
    status->session_frame = HistogramOf(family.metric.at(0));
  } else if (family.name == "cairn_call_seconds") {
    for (const prometheus::ClientMetric& metric : family.metric) {
      if (Locates(LabelOf(metric, "call"))) Add(HistogramOf(metric), &status->localize);
    }
  }
}

}  // namespace

struct Metrics::Families {
  prometheus::Registry registry;
  prometheus::Family<prometheus::Counter>& calls =
      prometheus::BuildCounter().Name("cairn_calls_total").Help("Calls, by how they came out").Register(registry);
  prometheus::Family<prometheus::Histogram>& call_seconds = prometheus::BuildHistogram()
                                                                .Name("cairn_call_seconds")
                                                                .Help("Time that calls took which were answered")
                                                                .Register(registry);
  prometheus::Family<prometheus::Counter>& localized = prometheus::BuildCounter()
                                                           .Name("cairn_localize_total")
                                                           .Help("Images asked for: located, or missed at which stage")
                                                           .Register(registry);
  prometheus::Histogram& extract_seconds = prometheus::BuildHistogram()
                                               .Name("cairn_localize_extract_seconds")
                                               .Help("Undistortion and features of an image")
                                               .Register(registry)
                                               .Add({}, kSeconds);
  prometheus::Histogram& locate_seconds = prometheus::BuildHistogram()
                                              .Name("cairn_localize_locate_seconds")
                                              .Help("Finding an image in the map, once it has features")
                                              .Register(registry)
                                              .Add({}, kSeconds);
  prometheus::Family<prometheus::Counter>& frames = prometheus::BuildCounter()
                                                        .Name("cairn_session_frames_total")
                                                        .Help("Frames of sessions, by what came of them")
                                                        .Register(registry);
  prometheus::Histogram& frame_seconds = prometheus::BuildHistogram()
                                             .Name("cairn_session_frame_seconds")
                                             .Help("From a frame of a session to its pose")
                                             .Register(registry)
                                             .Add({}, kSeconds);
  prometheus::Counter& dropped = prometheus::BuildCounter()
                                     .Name("cairn_session_frames_dropped_total")
                                     .Help("Frames that clients of sessions let go, as they could not be sent in time")
                                     .Register(registry)
                                     .Add({});
  prometheus::Family<prometheus::Counter>& tracked = prometheus::BuildCounter()
                                                         .Name("cairn_track_frames_total")
                                                         .Help("Frames tracked for clients, by what came of them")
                                                         .Register(registry);
  prometheus::Histogram& track_seconds = prometheus::BuildHistogram()
                                             .Name("cairn_track_seconds")
                                             .Help("Time that tracking a frame took")
                                             .Register(registry)
                                             .Add({}, kSeconds);
  prometheus::Family<prometheus::Gauge>& sessions = prometheus::BuildGauge()
                                                        .Name("cairn_sessions")
                                                        .Help("Sessions with their client, or waiting for it")
                                                        .Register(registry);
  prometheus::Gauge& open_maps =
      prometheus::BuildGauge().Name("cairn_open_maps").Help("Maps in memory").Register(registry).Add({});
  prometheus::Gauge& open_bytes = prometheus::BuildGauge()
                                      .Name("cairn_open_maps_bytes")
                                      .Help("Memory that open maps take, roughly")
                                      .Register(registry)
                                      .Add({});
  prometheus::Gauge& waiting = prometheus::BuildGauge()
                                   .Name("cairn_localize_waiting")
                                   .Help("Images that wait to be located")
                                   .Register(registry)
                                   .Add({});
  prometheus::Gauge& followers = prometheus::BuildGauge()
                                     .Name("cairn_followers")
                                     .Help("Clients that keep a copy of a map and follow it")
                                     .Register(registry)
                                     .Add({});
  prometheus::Gauge& free_bytes = prometheus::BuildGauge()
                                      .Name("cairn_maps_free_bytes")
                                      .Help("Room on the disk of the maps")
                                      .Register(registry)
                                      .Add({});
  prometheus::Counter& lost_audit_lines = prometheus::BuildCounter()
                                              .Name("cairn_audit_lines_lost_total")
                                              .Help("Lines of the audit log that could not be written")
                                              .Register(registry)
                                              .Add({});
  prometheus::Gauge& resident = prometheus::BuildGauge()
                                    .Name("process_resident_memory_bytes")
                                    .Help("Memory of the process")
                                    .Register(registry)
                                    .Add({});
  std::mutex looking;
};

Metrics::Metrics(std::function<ServerState()> state)
    : state_(std::move(state)), families_(std::make_unique<Families>()) {
  prometheus::BuildGauge()
      .Name("cairn_build_info")
      .Help("1, with the version")
      .Register(families_->registry)
      .Add({{"version", kVersion}})
      .Set(1.0);
}

Metrics::~Metrics() = default;

void Metrics::OnCall(absl::string_view call, absl::string_view reason, double seconds) {
  const std::string name(call);
  families_->calls.Add({{"call", name}, {"reason", std::string(reason)}}).Increment();
  // What is refused takes no time, and would make what is answered look faster than it is.
  if (reason == "ok") families_->call_seconds.Add({{"call", name}}, kSeconds).Observe(seconds);
}

void Metrics::OnLocalized(const api::LocalizeAnswer& answer) {
  const std::string outcome = answer.localized ? "located" : api::LocalizeStageName(answer.stage);
  families_->localized.Add({{"outcome", outcome}}).Increment();
  families_->extract_seconds.Observe(1e-3 * answer.extract_ms);
  families_->locate_seconds.Observe(1e-3 * answer.locate_ms);
}

void Metrics::OnTracked(const api::TrackAnswer* answer) {
  const std::string state = answer != nullptr ? api::TrackStateName(answer->state) : "refused";
  families_->tracked.Add({{"state", state}}).Increment();
  if (answer != nullptr) families_->track_seconds.Observe(1e-3 * answer->track_ms);
}

void Metrics::OnSessionFrame(absl::string_view state, double seconds) {
  families_->frames.Add({{"state", std::string(state)}}).Increment();
  families_->frame_seconds.Observe(seconds);
}

void Metrics::OnFramesDropped(std::int64_t count) { families_->dropped.Increment(static_cast<double>(count)); }

api::ServerStatus Metrics::Status() {
  const ServerState state = state_();
  api::ServerStatus status;
  status.version = kVersion;
  status.uptime_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count();
  status.resident_bytes = static_cast<std::int64_t>(ResidentBytes());
  status.images_waiting = state.waiting;
  status.followers = state.followers;
  for (const ServerState::Map& map : state.open_maps) {
    status.maps.push_back({map.name, map.revision, map.bytes, map.writing});
  }
  status.sessions = state.active_sessions;
  for (const prometheus::MetricFamily& family : families_->registry.Collect()) AddFamily(family, &status);
  std::ranges::sort(status.calls, [](const auto& x, const auto& y) {
    return std::tie(x.call, x.reason) < std::tie(y.call, y.reason);
  });
  return status;
}

std::string Metrics::Text() {
  const ServerState state = state_();
  const std::lock_guard lock(families_->looking);
  double bytes = 0.0;
  prometheus::Registry maps;  // anew with each look: only maps that are open have a line
  auto& revisions =
      prometheus::BuildGauge().Name("cairn_map_revision").Help("Newest revision of an open map").Register(maps);
  auto& logs = prometheus::BuildGauge()
                   .Name("cairn_map_log_bytes")
                   .Help("Write-ahead log of an open map, on the disk")
                   .Register(maps);
  for (const ServerState::Map& map : state.open_maps) {
    logs.Add({{"map", map.name}}).Set(static_cast<double>(map.log_bytes));
    bytes += static_cast<double>(map.bytes);
    revisions.Add({{"map", map.name}}).Set(static_cast<double>(map.revision));
  }
  families_->open_maps.Set(static_cast<double>(state.open_maps.size()));
  families_->open_bytes.Set(bytes);
  families_->sessions.Add({{"client", "here"}}).Set(state.sessions);
  families_->sessions.Add({{"client", "gone"}}).Set(state.sessions_waiting);
  families_->waiting.Set(static_cast<double>(state.waiting));
  families_->followers.Set(static_cast<double>(state.followers));
  families_->free_bytes.Set(static_cast<double>(state.free_bytes));
  const double lost = static_cast<double>(state.lost_audit_lines) - families_->lost_audit_lines.Value();
  if (lost > 0.0) families_->lost_audit_lines.Increment(lost);
  families_->resident.Set(ResidentBytes());
  std::vector<prometheus::MetricFamily> collected = families_->registry.Collect();
  std::vector<prometheus::MetricFamily> of_maps = maps.Collect();
  collected.insert(collected.end(), of_maps.begin(), of_maps.end());
  return prometheus::TextSerializer().Serialize(collected);
}

}  // namespace cairn::server
