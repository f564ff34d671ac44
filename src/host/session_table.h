// The sessions of a host, by their tokens: with their clients, or waiting for one that was cut off.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "api/active_session.h"
#include "api/map_session.h"
#include "base/status.h"
#include "host/hosted_session.h"

namespace cairn::host {

class SessionTable {
 public:
  using Clock = std::chrono::steady_clock;

  // Of one client, unless it is nameless, too. `wait`: for the client of a session that it has let go of.
  SessionTable(int max_sessions, int max_of_client, Clock::duration wait)
      : max_sessions_(max_sessions), max_of_client_(max_of_client), wait_(wait) {}

  // `start` is called unless there are too many (ResourceExhausted), those included that wait for their clients. The
  // table must outlive what it gives out.
  absl::StatusOr<std::unique_ptr<api::MapSession>> Start(
      const api::SessionRequest& request, const std::function<absl::StatusOr<std::unique_ptr<HostedSession>>()>& start);
  // As api::MapService::ResumeSession(). A session that was finished is there for as long as one that waits, to say its
  // summary once more: the connection may have broken before its client had it.
  absl::StatusOr<std::unique_ptr<api::MapSession>> Resume(const std::string& token);

  // A session that nobody has come back to, and how it was ended.
  struct Abandoned {
    std::string client;  // as in the request
    api::ActiveSession session;
    absl::Status finished;
  };
  // Ends them, in order.
  std::vector<Abandoned> FinishAbandoned(Clock::time_point now);

  struct Counts {
    int held = 0;     // by their clients
    int waiting = 0;  // for them
  };
  Counts counts() const;
  // Those that have been started, by map, then by their start.
  std::vector<api::ActiveSession> Active(Clock::time_point now) const;

 private:
  struct Entry {
    std::string client;
    std::unique_ptr<HostedSession> session;  // null while it is being started; used by who holds it
    bool held = true;
    Clock::time_point released{};
    Clock::time_point started{};
    Clock::time_point answered{};  // its last frame
    api::ActiveSession told;       // but for its times
  };
  // What is known of a session that was finished.
  struct Finished {
    std::string map, map_id;
    Camera camera;
    api::SessionProgress progress;
    std::optional<api::SessionAnswer> last_answer;
    absl::StatusOr<api::SessionSummary> summary;
    Clock::time_point at;
  };
  class Lease;
  class Echo;

  void Release(const std::string& token);
  void Note(Entry* entry, const api::SessionAnswer* answer, const api::SessionProgress& progress);
  // It has ended: nobody can come back to it.
  void Remove(const std::string& token);

  void Keep(const std::string& token, const HostedSession& session, const absl::StatusOr<api::SessionSummary>& summary);

  absl::Status CheckRoom(const std::string& client) const;

  const int max_sessions_;
  const int max_of_client_;
  const Clock::duration wait_;

  mutable std::mutex mutex_;  // guards what follows
  std::map<std::string, std::shared_ptr<Entry>> entries_;
  std::map<std::string, std::shared_ptr<const Finished>> finished_;
};

}  // namespace cairn::host
