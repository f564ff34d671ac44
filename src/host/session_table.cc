#include "host/session_table.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "base/guarded.h"
#include "engine/session_record.h"

namespace cairn::host {
namespace {

std::string Sessions(int count) { return count == 1 ? "1 session" : absl::StrCat(count, " sessions"); }

}  // namespace

// A client's hold on a session.
class SessionTable::Lease final : public api::MapSession {
 public:
  Lease(SessionTable* table, std::string token, std::shared_ptr<Entry> entry)
      : table_(table),
        token_(std::move(token)),
        entry_(std::move(entry)),
        map_(entry_->session->map()),
        map_id_(entry_->session->map_id()),
        camera_(entry_->session->camera()),
        progress_(entry_->session->progress()),
        last_answer_(entry_->session->last_answer()) {}
  ~Lease() override {
    if (entry_ != nullptr) table_->Release(token_);
  }

  const std::string& token() const override { return token_; }
  const std::string& map() const override { return map_; }
  const std::string& map_id() const override { return map_id_; }
  const Camera& camera() const override { return camera_; }
  const std::optional<api::SessionAnswer>& last_answer() const override { return last_answer_; }
  const api::SessionProgress& progress() const override { return progress_; }

  absl::StatusOr<api::SessionAnswer> AddFrame(const api::SessionFrame& frame) override {
    if (entry_ == nullptr) return Ended();
    absl::StatusOr<api::SessionAnswer> answer = Guarded([&] { return entry_->session->AddFrame(frame); });
    progress_ = entry_->session->progress();
    table_->Note(entry_.get(), answer.ok() ? &*answer : nullptr, progress_);
    if (!answer.ok() && !absl::IsInvalidArgument(answer.status())) End();
    return answer;
  }

  absl::StatusOr<api::SessionSummary> Finish() override {
    if (entry_ == nullptr) return Ended();
    absl::StatusOr<api::SessionSummary> summary = Guarded([&] { return entry_->session->Finish(); });
    progress_ = entry_->session->progress();
    table_->Keep(token_, *entry_->session, summary);
    End();
    return summary;
  }

 private:
  static absl::Status Ended() { return absl::FailedPreconditionError("the session has ended"); }
  void End() {
    table_->Remove(token_);
    entry_.reset();
  }

  SessionTable* const table_;
  const std::string token_;
  std::shared_ptr<Entry> entry_;  // null: it has ended
  const std::string map_;
  const std::string map_id_;
  const Camera camera_;
  api::SessionProgress progress_;
  const std::optional<api::SessionAnswer> last_answer_;
};

// A session that was finished.
class SessionTable::Echo final : public api::MapSession {
 public:
  Echo(std::string token, std::shared_ptr<const Finished> finished)
      : token_(std::move(token)), finished_(std::move(finished)) {}

  const std::string& token() const override { return token_; }
  const std::string& map() const override { return finished_->map; }
  const std::string& map_id() const override { return finished_->map_id; }
  const Camera& camera() const override { return finished_->camera; }
  const std::optional<api::SessionAnswer>& last_answer() const override { return finished_->last_answer; }
  const api::SessionProgress& progress() const override { return finished_->progress; }
  absl::StatusOr<api::SessionAnswer> AddFrame(const api::SessionFrame& /*frame*/) override {
    return absl::FailedPreconditionError("the session has ended");
  }
  absl::StatusOr<api::SessionSummary> Finish() override { return finished_->summary; }

 private:
  const std::string token_;
  const std::shared_ptr<const Finished> finished_;
};

void SessionTable::Keep(const std::string& token, const HostedSession& session,
                        const absl::StatusOr<api::SessionSummary>& summary) {
  const auto finished =
      std::make_shared<const Finished>(Finished{session.map(), session.map_id(), session.camera(), session.progress(),
                                                session.last_answer(), summary, Clock::now()});
  const std::lock_guard lock(mutex_);
  finished_[token] = finished;
  if (finished_.size() <= static_cast<std::size_t>(max_sessions_)) return;
  finished_.erase(std::ranges::min_element(finished_, {}, [](const auto& entry) { return entry.second->at; }));
}

// With the lock.
absl::Status SessionTable::CheckRoom(const std::string& client) const {
  if (static_cast<int>(entries_.size()) >= max_sessions_) {
    return absl::ResourceExhaustedError(absl::StrCat(max_sessions_ == 1 ? "there is" : "there are", " ",
                                                     Sessions(max_sessions_), " already, as many as ",
                                                     "this server takes (--max-sessions)"));
  }
  const auto of_client = std::ranges::count_if(entries_, [&](const auto& e) { return e.second->client == client; });
  if (!client.empty() && of_client >= max_of_client_) {
    return absl::ResourceExhaustedError(absl::StrCat("you have ", Sessions(max_of_client_),
                                                     " already, as many as one client may (--max-client-sessions)"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<api::MapSession>> SessionTable::Start(
    const api::SessionRequest& request, const std::function<absl::StatusOr<std::unique_ptr<HostedSession>>()>& start) {
  const std::string token = engine::NewMapId(std::nullopt);  // as hard to guess
  const auto entry = std::make_shared<Entry>();
  entry->started = entry->answered = Clock::now();
  entry->told.map = request.map;
  entry->told.source = request.source;
  entry->client = request.client;
  {
    const std::lock_guard lock(mutex_);
    CAIRN_RETURN_IF_ERROR(CheckRoom(request.client));
    entries_[token] = entry;
  }
  absl::StatusOr<std::unique_ptr<HostedSession>> session = Guarded(start);
  if (!session.ok()) {
    Remove(token);
    return session.status();
  }
  const std::lock_guard lock(mutex_);
  entry->session = *std::move(session);
  entry->told.progress = entry->session->progress();
  return std::make_unique<Lease>(this, token, entry);
}

absl::StatusOr<std::unique_ptr<api::MapSession>> SessionTable::Resume(const std::string& token) {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(token);
  if (const auto finished = finished_.find(token); finished != finished_.end()) {
    return std::make_unique<Echo>(token, finished->second);
  }
  if (found == entries_.end()) {
    return absl::NotFoundError("there is no session of this token: it has ended, or the server was restarted");
  }
  if (found->second->held) {
    return absl::FailedPreconditionError("the session is with its client still: try again in a moment");
  }
  found->second->held = true;
  return std::make_unique<Lease>(this, token, found->second);
}

void SessionTable::Release(const std::string& token) {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(token);
  if (found == entries_.end()) return;
  found->second->held = false;
  found->second->released = Clock::now();
}

void SessionTable::Remove(const std::string& token) {
  std::shared_ptr<Entry> removed;  // outlives the lock: it may take a while to end
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(token);
  if (found == entries_.end()) return;
  removed = std::move(found->second);
  entries_.erase(found);
}

std::vector<SessionTable::Abandoned> SessionTable::FinishAbandoned(Clock::time_point now) {
  std::vector<std::shared_ptr<Entry>> abandoned;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(finished_, [&](const auto& entry) { return now - entry.second->at >= wait_; });
    std::erase_if(entries_, [&](auto& entry) {
      if (entry.second->held || now - entry.second->released < wait_) return false;
      abandoned.push_back(std::move(entry.second));
      return true;
    });
  }
  std::vector<Abandoned> ended;
  for (const std::shared_ptr<Entry>& entry : abandoned) {
    const absl::Status finished = Guarded([&] { return entry->session->Finish(); }).status();
    spdlog::info("session {} was left by its client and is finished{}{}", entry->session->progress().session.value(),
                 finished.ok() ? "" : ": ", std::string(finished.message()));
    entry->told.progress = entry->session->progress();
    ended.push_back({entry->client, entry->told, finished});
  }
  return ended;
}

void SessionTable::Note(Entry* entry, const api::SessionAnswer* answer, const api::SessionProgress& progress) {
  const std::lock_guard lock(mutex_);
  entry->told.progress = progress;
  if (answer == nullptr) return;
  ++entry->told.frames;
  entry->told.state = answer->state;
  entry->answered = Clock::now();
}

std::vector<api::ActiveSession> SessionTable::Active(Clock::time_point now) const {
  std::vector<api::ActiveSession> active;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [token, entry] : entries_) {
      if (entry->session == nullptr) continue;
      active.push_back(entry->told);
      active.back().waiting = !entry->held;
      active.back().running_s = std::chrono::duration<double>(now - entry->started).count();
      active.back().silent_s = std::chrono::duration<double>(now - entry->answered).count();
    }
  }
  std::ranges::sort(active, [](const api::ActiveSession& x, const api::ActiveSession& y) {
    return std::pair(x.map, -x.running_s) < std::pair(y.map, -y.running_s);
  });
  return active;
}

SessionTable::Counts SessionTable::counts() const {
  Counts counts;
  const std::lock_guard lock(mutex_);
  for (const auto& [token, entry] : entries_) ++(entry->held ? counts.held : counts.waiting);
  return counts;
}

}  // namespace cairn::host
