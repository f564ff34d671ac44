#include "server/access/authorized_maps.h"

#include "absl/strings/str_format.h"

namespace cairn::server {
namespace {

class AuthorizedTracker final : public api::Tracker {
 public:
  AuthorizedTracker(std::unique_ptr<api::Tracker> tracker, std::string map, Access* access, Client client)
      : tracker_(std::move(tracker)), map_(std::move(map)), access_(*access), client_(std::move(client)) {}

  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override {
    CAIRN_RETURN_IF_ERROR(access_.Require(client_, Right::kRead, map_));
    return tracker_->Track(frame);
  }

 private:
  const std::unique_ptr<api::Tracker> tracker_;
  const std::string map_;
  Access& access_;
  const Client client_;
};

class AuthorizedFeed final : public api::MapFeed {
 public:
  AuthorizedFeed(std::unique_ptr<api::MapFeed> feed, std::string map, Access* access, Client client)
      : feed_(std::move(feed)), map_(std::move(map)), access_(*access), client_(std::move(client)) {}

  absl::StatusOr<std::optional<api::MapStep>> Next(std::chrono::milliseconds timeout) override {
    CAIRN_RETURN_IF_ERROR(access_.Require(client_, Right::kRead, map_));
    return feed_->Next(timeout);
  }
  std::string Vocabulary() const override { return feed_->Vocabulary(); }

 private:
  const std::unique_ptr<api::MapFeed> feed_;
  const std::string map_;
  Access& access_;
  const Client client_;
};

class AuthorizedSession final : public api::MapSession {
 public:
  AuthorizedSession(std::unique_ptr<api::MapSession> session, Access* access, Client client)
      : session_(std::move(session)), access_(*access), client_(std::move(client)) {
    access_.Hold(map(), progress().session, client_);
  }
  // A client that goes without a word leaves a line, too: the session waits for it, or is cut off with the server. So
  // does a session that could not go on.
  ~AuthorizedSession() override {
    if (finished_ || broken_) access_.LetGo(map(), progress().session);
    if (finished_ || (ended_.ok() && access_.stopping())) return;  // the latter is told with all that are cut off
    access_.Record(
        client_, {ended_.ok() ? "session_left" : "session_failed", map(), SessionDetails(session_->progress().session)},
        ended_);
  }

  const std::string& token() const override { return session_->token(); }
  const std::string& map() const override { return session_->map(); }
  const std::string& map_id() const override { return session_->map_id(); }
  const Camera& camera() const override { return session_->camera(); }
  const std::optional<api::SessionAnswer>& last_answer() const override { return session_->last_answer(); }
  const api::SessionProgress& progress() const override { return session_->progress(); }

  absl::StatusOr<api::SessionAnswer> AddFrame(const api::SessionFrame& frame) override {
    const auto add = [&]() -> absl::StatusOr<api::SessionAnswer> {
      CAIRN_RETURN_IF_ERROR(access_.Require(client_, Right::kExtend, map()));
      absl::StatusOr<api::SessionAnswer> added = session_->AddFrame(frame);
      broken_ = !added.ok() && !absl::IsInvalidArgument(added.status());
      return added;
    };
    absl::StatusOr<api::SessionAnswer> answer = add();
    if (!answer.ok() && !absl::IsInvalidArgument(answer.status())) ended_ = answer.status();
    return answer;
  }
  absl::StatusOr<api::SessionSummary> Finish() override {
    const auto finish = [&]() -> absl::StatusOr<api::SessionSummary> {
      CAIRN_RETURN_IF_ERROR(access_.Require(client_, Right::kExtend, map()));
      finished_ = true;
      return session_->Finish();
    };
    absl::StatusOr<api::SessionSummary> summary = finish();
    std::string details = absl::StrFormat(R"({"session":%d)", session_->progress().session.value());
    if (summary.ok()) {
      absl::StrAppendFormat(&details, R"(,"frames":%d,"revision":%d)", summary->frames, summary->revision);
    }
    access_.Record(client_, {"session_finished", map(), details + "}"}, summary.status());
    return summary;
  }

 private:
  const std::unique_ptr<api::MapSession> session_;
  Access& access_;
  const Client client_;
  bool finished_ = false;
  bool broken_ = false;  // it has ended by itself: nobody can come back to it
  absl::Status ended_;   // why no frame is taken any more: the map, or the rights of the client
};

}  // namespace

absl::Status AuthorizedMaps::Require(Right right, const std::string& map) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  return access_.Require(client_, right, map);
}

absl::StatusOr<std::vector<api::MapSummary>> AuthorizedMaps::List() {
  CAIRN_ASSIGN_OR_RETURN(std::vector<api::MapSummary> maps, maps_.List());
  CAIRN_RETURN_IF_ERROR(KeepAllowed(Right::kRead, &maps, [](const api::MapSummary& map) { return map.name; }));
  return maps;
}

absl::StatusOr<api::MapDescription> AuthorizedMaps::Describe(const std::string& map) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Describe(map);
}

absl::StatusOr<api::LocalizeAnswer> AuthorizedMaps::Localize(const std::string& map, const api::LocalizeQuery& query) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Localize(map, query);
}

absl::StatusOr<api::AcrossAnswer> AuthorizedMaps::LocalizeAcross(const std::vector<std::string>& maps,
                                                                 const api::LocalizeQuery& query) {
  for (const std::string& map : maps) CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  if (!maps.empty() || access_.Require(client_, Right::kRead, "*").ok()) return maps_.LocalizeAcross(maps, query);
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::MapSummary> readable, List());
  std::vector<std::string> names;
  for (const api::MapSummary& map : readable) names.push_back(map.name);
  if (names.empty()) return absl::PermissionDeniedError("there is no map that this token may read");
  return maps_.LocalizeAcross(names, query);
}

absl::StatusOr<std::unique_ptr<api::Tracker>> AuthorizedMaps::NewTracker(const std::string& map, const Camera& camera) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<api::Tracker> tracker, maps_.NewTracker(map, camera));
  return std::make_unique<AuthorizedTracker>(std::move(tracker), map, &access_, client_);
}

absl::StatusOr<std::unique_ptr<api::MapFeed>> AuthorizedMaps::Follow(const std::string& map,
                                                                     const api::FollowRequest& request) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<api::MapFeed> feed, maps_.Follow(map, request));
  return std::make_unique<AuthorizedFeed>(std::move(feed), map, &access_, client_);
}

absl::StatusOr<std::unique_ptr<api::MapSession>> AuthorizedMaps::StartSession(const api::SessionRequest& request) {
  const bool creates = request.policy == map::SessionPolicy::kCreate;
  const auto start = [&]() -> absl::StatusOr<std::unique_ptr<api::MapSession>> {
    CAIRN_RETURN_IF_ERROR(Require(Right::kExtend, request.map));
    api::SessionRequest by_client = request;
    by_client.client = client_.limited_as;
    return maps_.StartSession(by_client);
  };
  absl::StatusOr<std::unique_ptr<api::MapSession>> session = start();
  access_.Record(client_,
                 {creates ? "session_started_new_map" : "session_started", request.map,
                  session.ok() ? SessionDetails((*session)->progress().session) : ""},
                 session.status());
  CAIRN_RETURN_IF_ERROR(session.status());
  return std::make_unique<AuthorizedSession>(*std::move(session), &access_, client_);
}

absl::StatusOr<std::unique_ptr<api::MapSession>> AuthorizedMaps::ResumeSession(const std::string& token) {
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<api::MapSession> session, maps_.ResumeSession(token));
  // One that may not has it for a moment, and changes nothing.
  const absl::Status allowed = access_.Require(client_, Right::kExtend, session->map());
  access_.Record(client_, {"session_resumed", session->map(), SessionDetails(session->progress().session)}, allowed);
  CAIRN_RETURN_IF_ERROR(allowed);
  return std::make_unique<AuthorizedSession>(std::move(session), &access_, client_);
}

}  // namespace cairn::server
