#include "cli/status_report.h"

#include <algorithm>
#include <map>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace cairn::cli {
namespace {

constexpr std::size_t kColumns = 80;

using Counts = std::vector<api::ServerStatus::Count>;

Counts Since(const Counts& now, const Counts* before) {
  Counts since = now;
  if (before == nullptr) return since;
  for (api::ServerStatus::Count& count : since) {
    const auto earlier = std::ranges::find(*before, count.what, &api::ServerStatus::Count::what);
    if (earlier != before->end() && earlier->count <= count.count) count.count -= earlier->count;
  }
  return since;
}

std::int64_t Total(const Counts& counts) {
  std::int64_t total = 0;
  for (const api::ServerStatus::Count& count : counts) total += count.count;
  return total;
}

// One kind of work: how much of it there was, how it came out, how long it took.
struct Work {
  std::string name;
  Counts outcomes;
  double per_second = 0.0;
  double median_ms = 0.0;
  double p99_ms = 0.0;
};

std::vector<Work> WorkOf(const api::ServerStatus& now, const api::ServerStatus* before, double seconds) {
  const auto make = [&](const char* name, Counts api::ServerStatus::*counts,
                        api::DurationHistogram api::ServerStatus::*times) {
    Work work{name, Since(now.*counts, before != nullptr ? &(before->*counts) : nullptr)};
    const api::DurationHistogram histogram = before != nullptr ? (now.*times).Since(before->*times) : now.*times;
    work.per_second = seconds > 0.0 ? static_cast<double>(Total(work.outcomes)) / seconds : 0.0;
    work.median_ms = 1e3 * histogram.Quantile(0.5);
    work.p99_ms = 1e3 * histogram.Quantile(0.99);
    return work;
  };
  return {make("localize", &api::ServerStatus::localized, &api::ServerStatus::localize),
          make("track", &api::ServerStatus::tracked, &api::ServerStatus::tracking),
          make("sessions", &api::ServerStatus::session_frames, &api::ServerStatus::session_frame)};
}

// Calls that were refused or failed, by reason.
std::map<std::string, std::int64_t> Errors(const api::ServerStatus& now, const api::ServerStatus* before) {
  std::map<std::string, std::int64_t> errors;
  const auto add = [&](const api::ServerStatus& status, std::int64_t sign) {
    for (const api::ServerStatus::Calls& calls : status.calls) {
      if (calls.reason != "ok") errors[calls.reason] += sign * calls.count;
    }
  };
  add(now, 1);
  if (before != nullptr) add(*before, -1);
  std::erase_if(errors, [](const auto& error) { return error.second <= 0; });
  return errors;
}

std::string Duration(double seconds) {
  const auto s = static_cast<std::int64_t>(seconds);
  if (s < 60) return absl::StrCat(s, " s");
  if (s < 3600) return absl::StrFormat("%d:%02d min", s / 60, s % 60);
  if (s < 86400) return absl::StrFormat("%d:%02d h", s / 3600, s / 60 % 60);
  return absl::StrFormat("%d d %d h", s / 86400, s / 3600 % 24);
}

std::string Cut(const std::string& text, std::size_t columns) {
  return text.size() <= columns ? text : text.substr(0, columns - 1) + "~";
}

std::string OutcomesText(const Counts& outcomes) {
  std::vector<std::string> texts;
  for (const api::ServerStatus::Count& outcome : outcomes) {
    if (outcome.count > 0) texts.push_back(absl::StrCat(outcome.what, " ", outcome.count));
  }
  return absl::StrJoin(texts, ", ");
}

void AddMaps(const api::ServerStatus& now, bool cut, std::vector<std::string>* lines) {
  lines->push_back(absl::StrFormat("%-30s %10s %10s", "map in memory", "revision", "MB"));
  for (const api::ServerStatus::Map& map : now.maps) {
    lines->push_back(absl::StrFormat("%-30s %10d %10.1f%s", cut ? Cut(map.name, 30) : map.name, map.revision,
                                     static_cast<double>(map.memory_bytes) / 1e6,
                                     map.writing ? "  being extended" : ""));
  }
}

void AddSessions(const api::ServerStatus& now, bool cut, std::vector<std::string>* lines) {
  lines->push_back(absl::StrFormat("%-22s %-18s %8s %6s  %s", "session in map", "of", "frames", "rev.", "state"));
  for (const api::ActiveSession& session : now.sessions) {
    const std::string state = session.waiting ? absl::StrCat("its client is gone, ", Duration(session.silent_s))
                                              : std::string(api::SessionStateName(session.state));
    lines->push_back(absl::StrFormat("%-22s %-18s %8d %6d  %s", cut ? Cut(session.map, 22) : session.map,
                                     cut ? Cut(session.source, 18) : session.source, session.frames,
                                     session.progress.revision, state));
  }
}

nlohmann::ordered_json SessionAsJson(const api::ActiveSession& session) {
  return {{"map", session.map},
          {"source", session.source},
          {"session", session.progress.session.value()},
          {"waiting", session.waiting},
          {"running_s", session.running_s},
          {"silent_s", session.silent_s},
          {"frames", session.frames},
          {"state", api::SessionStateName(session.state)},
          {"revision", session.progress.revision}};
}

}  // namespace

std::vector<std::string> StatusLines(const std::string& server, const api::ServerStatus& now,
                                     const api::ServerStatus* before, double seconds, bool terminal) {
  std::vector<std::string> lines;
  lines.push_back(absl::StrFormat("%s: cairnd %s, up %s, %.0f MB, %d waiting, %d following", server, now.version,
                                  Duration(now.uptime_s), static_cast<double>(now.resident_bytes) / 1e6,
                                  now.images_waiting, now.followers));
  lines.push_back("");
  lines.push_back(absl::StrFormat(
      "%-9s %8s %9s %9s  %s", "work", "per s", "median", "p99",
      before != nullptr ? absl::StrFormat("in the last %.1f s", seconds) : std::string("since the start")));
  for (const Work& work : WorkOf(now, before, seconds)) {
    lines.push_back(absl::StrFormat("%-9s %8.1f %6.1f ms %6.1f ms  %s", work.name, work.per_second, work.median_ms,
                                    work.p99_ms, OutcomesText(work.outcomes)));
  }
  std::vector<std::string> errors;
  for (const auto& [reason, count] : Errors(now, before)) errors.push_back(absl::StrCat(reason, " ", count));
  if (!errors.empty()) lines.push_back("refused   " + absl::StrJoin(errors, ", "));
  if (!now.maps.empty()) {
    lines.push_back("");
    AddMaps(now, terminal, &lines);
  }
  if (!now.sessions.empty()) {
    lines.push_back("");
    AddSessions(now, terminal, &lines);
  }
  for (std::string& line : lines) {
    if (terminal) line = Cut(line, kColumns);
  }
  return lines;
}

nlohmann::ordered_json StatusAsJson(const std::string& server, const api::ServerStatus& now,
                                    const api::ServerStatus* before, double seconds) {
  nlohmann::ordered_json maps = nlohmann::ordered_json::array(), sessions = maps;
  for (const api::ServerStatus::Map& map : now.maps) {
    maps.push_back(
        {{"name", map.name}, {"revision", map.revision}, {"memory_bytes", map.memory_bytes}, {"writing", map.writing}});
  }
  for (const api::ActiveSession& session : now.sessions) sessions.push_back(SessionAsJson(session));
  nlohmann::ordered_json work = nlohmann::ordered_json::object(), errors = work;
  for (const Work& done : WorkOf(now, before, seconds)) {
    nlohmann::ordered_json outcomes = nlohmann::ordered_json::object();
    for (const api::ServerStatus::Count& outcome : done.outcomes) outcomes[outcome.what] = outcome.count;
    work[done.name] = {
        {"per_s", done.per_second}, {"median_ms", done.median_ms}, {"p99_ms", done.p99_ms}, {"outcomes", outcomes}};
  }
  for (const auto& [reason, count] : Errors(now, before)) errors[reason] = count;
  return {{"server", server},
          {"version", now.version},
          {"uptime_s", now.uptime_s},
          {"resident_bytes", now.resident_bytes},
          {"images_waiting", now.images_waiting},
          {"followers", now.followers},
          {"seconds", seconds},
          {"work", work},
          {"refused", errors},
          {"maps", maps},
          {"sessions", sessions}};
}

}  // namespace cairn::cli
