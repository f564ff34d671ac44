#include "client/remote/followed_map.h"

#include <algorithm>
#include <utility>

#include "base/guarded.h"
#include "base/thread_priority.h"
#include "client/remote/server_token.h"
#include "place/default_vocabulary.h"
#include "store/fault.h"
#include "wire/convert_map_rows.h"
#include "wire/errors.h"

namespace cairn::client {
namespace {

// The server gives a sign of life every second; without one for so long it is not there, whatever the network says.
constexpr std::chrono::milliseconds kSilent(3000);

// Between updates: a tracker needs what is new to find its way there, not within the frame.
constexpr int kIntervalMs = 250;

// Another attempt would end the same way.
bool IsFinal(const absl::Status& status) {
  return !absl::IsUnavailable(status) && !absl::IsCancelled(status) && !absl::IsDeadlineExceeded(status) &&
         !absl::IsResourceExhausted(status);
}

}  // namespace

class FollowedMap::Reader final : public ViewSource {
 public:
  Reader(std::shared_ptr<FollowedMap> map, std::shared_ptr<const tracking::MapView> view)
      : map_(std::move(map)), view_(std::move(view)) {}

  const std::shared_ptr<const tracking::MapView>& view() const override { return view_; }
  absl::StatusOr<bool> Refresh() override {
    std::shared_ptr<const tracking::MapView> newest = map_->view();
    const bool is_new = newest != view_;
    view_ = std::move(newest);
    CAIRN_RETURN_IF_ERROR(map_->problem());
    return is_new;
  }
  std::unique_ptr<ViewSource> Another() const override { return std::make_unique<Reader>(map_, view_); }
  MapConnection connection() const override { return map_->connection(); }

 private:
  const std::shared_ptr<FollowedMap> map_;
  std::shared_ptr<const tracking::MapView> view_;
};

FollowedMap::FollowedMap(const RemoteOptions& options, std::shared_ptr<grpc::Channel> channel, const std::string& map,
                         const std::optional<map::RegionQuery>& region)
    : options_(options),
      channel_(std::move(channel)),
      stub_(v1::Follow::NewStub(channel_)),
      map_(map),
      region_(region) {}

absl::StatusOr<std::shared_ptr<FollowedMap>> FollowedMap::Start(const RemoteOptions& options,
                                                                std::shared_ptr<grpc::Channel> channel,
                                                                const std::string& map,
                                                                const std::optional<map::RegionQuery>& region) {
  auto followed = std::shared_ptr<FollowedMap>(new FollowedMap(options, std::move(channel), map, region));
  FollowedMap* const self = followed.get();
  CAIRN_ASSIGN_OR_RETURN(self->thread_, StartThread(
                                            "following a map", [self] { self->Run(); },
                                            [self](const absl::Status& status) {
                                              const std::lock_guard lock(self->mutex_);
                                              self->problem_ = status;
                                              self->ending_ = true;
                                              self->connected_ = false;
                                              self->changed_.notify_all();
                                            }));
  std::unique_lock lock(self->mutex_);
  self->changed_.wait_for(lock, std::chrono::duration<double>(options.deadline_s),
                          [&] { return self->view_ != nullptr || self->ending_; });
  if (self->view_ != nullptr) return followed;
  if (!self->problem_.ok()) return self->problem_;
  return absl::DeadlineExceededError(absl::StrCat("following ", map, ": ", options.server, " did not answer in time"));
}

FollowedMap::~FollowedMap() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    if (call_ != nullptr) call_->TryCancel();
    changed_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
}

std::shared_ptr<const tracking::MapView> FollowedMap::view() const {
  const std::lock_guard lock(mutex_);
  return view_;
}

MapConnection FollowedMap::connection() const {
  const std::lock_guard lock(mutex_);
  const Clock::time_point now = Clock::now();
  return {connected_ && now < heard_ + kSilent, std::chrono::duration<double>(now - newest_).count()};
}

absl::Status FollowedMap::problem() const {
  const std::lock_guard lock(mutex_);
  if (!connected_) return problem_;
  if (Clock::now() < heard_ + kSilent) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(options_.server, " is silent"));
}

FollowedMap::Traffic FollowedMap::traffic() const {
  const std::lock_guard lock(mutex_);
  return traffic_;
}

std::unique_ptr<ViewSource> FollowedMap::NewReader() { return std::make_unique<Reader>(shared_from_this(), view()); }

bool FollowedMap::WaitFor(Revision revision, Clock::time_point until) const {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, until, [&] { return view_->revision() >= revision; });
}

void FollowedMap::Disconnect() {
  std::unique_lock lock(mutex_);
  paused_ = true;
  connected_ = false;
  problem_ = absl::UnavailableError("the connection was let go of");
  if (call_ != nullptr) call_->TryCancel();
  changed_.notify_all();
  changed_.wait(lock, [&] { return call_ == nullptr; });
}

void FollowedMap::Reconnect() {
  const std::lock_guard lock(mutex_);
  paused_ = false;
  changed_.notify_all();
}

void FollowedMap::MoveTo(const map::RegionQuery& region) {
  const std::lock_guard lock(mutex_);
  if (!region_ || *region_ == region) return;
  region_ = region;
  moving_ = true;
  if (call_ != nullptr) call_->TryCancel();
}

void FollowedMap::Run() {
  const Clock::time_point begun = Clock::now();
  for (int attempt = 0;;) {
    const Clock::time_point before = Clock::now();
    const absl::Status status = Guarded([&] { return WithToken(options_, [&] { return Follow(); }); });
    std::unique_lock lock(mutex_);
    if (std::exchange(moving_, false) && connected_ && !ending_ && !paused_) continue;
    connected_ = false;
    problem_ = status.ok() ? absl::UnavailableError(absl::StrCat(options_.server, " ended the call")) : status;
    // What had worked for a while is tried again at once.
    attempt = view_ != nullptr && newest_ > before ? 0 : attempt + 1;
    // A call that was refused for now, with a word on when to come again, is none that failed.
    const double after_s = wire::RetryAfterOf(problem_);
    const std::chrono::duration<double> tried = Clock::now() - begun;
    if (after_s > 0.0 && tried.count() + after_s < options_.outage_s) --attempt;
    ending_ |= view_ == nullptr ? IsFinal(problem_) || attempt >= options_.attempts : absl::IsAborted(problem_);
    changed_.notify_all();
    if (ending_) return;
    changed_.wait_for(lock, std::chrono::duration<double>(after_s), [&] { return ending_; });
    lock.unlock();
    PauseAndConnect(std::max(0, attempt), channel_.get());
    lock.lock();
    changed_.wait(lock, [&] { return ending_ || !paused_; });
    if (ending_) return;
  }
}

v1::FollowMapRequest FollowedMap::Request() {
  v1::FollowMapRequest request;
  request.set_map(map_);
  request.set_min_interval_ms(kIntervalMs);
  if (vocabulary_ == nullptr) {
    // Most maps have the one that ships with Cairn; one that is not there is sent.
    absl::StatusOr<place::Vocabulary> shipped = place::LoadDefaultVocabulary();
    if (shipped.ok()) vocabulary_ = std::make_shared<const place::Vocabulary>(*std::move(shipped));
  }
  if (vocabulary_ != nullptr) request.add_vocabularies(vocabulary_->hash());
  const std::lock_guard lock(mutex_);
  if (region_) wire::ToProto(*region_, request.mutable_region());
  if (view_ == nullptr || anew_) return request;
  v1::HeldMap* held = request.mutable_held();
  held->set_map_id(view_->map().info().id);
  held->set_revision(view_->revision());
  if (region_)
    view_->map().keyframes().ForEach([&](const auto& keyframe) { held->add_keyframes(keyframe->id.value()); });
  return request;
}

absl::Status FollowedMap::Follow() {
  const v1::FollowMapRequest request = Request();
  grpc::ClientContext context;
  const auto set_call = [&](grpc::ClientContext* call) {
    const std::lock_guard lock(mutex_);
    if (call != nullptr && (ending_ || paused_)) return false;
    call_ = call;
    changed_.notify_all();
    return true;
  };
  if (!set_call(&context)) return absl::CancelledError("not followed");
  const std::unique_ptr<grpc::ClientReader<v1::FollowMapResponse>> stream = stub_->FollowMap(&context, request);
  const absl::Status read = Guarded([&] { return ReadUpdates(stream.get()); });
  if (!read.ok()) context.TryCancel();
  const absl::Status ended = FromGrpc(stream->Finish(), options_);
  set_call(nullptr);
  return read.ok() ? ended : read;
}

void FollowedMap::Heard(bool up_to_date) {
  const std::lock_guard lock(mutex_);
  heard_ = Clock::now();
  connected_ = true;
  if (up_to_date) newest_ = heard_;
}

absl::Status FollowedMap::ReadUpdates(grpc::ClientReader<v1::FollowMapResponse>* stream) {
  const auto begin = [&] { return wire::UpdateReader(view() == nullptr || anew_ ? nullptr : view()->snapshot()); };
  auto reader = std::make_unique<wire::UpdateReader>(begin());
  v1::FollowMapResponse message;
  while (stream->Read(&message)) {
    const bool between = !reader->begun() && message.has_up_to_date();
    Heard(between);
    if (between) continue;
    absl::StatusOr<bool> last = reader->Read(message);
    absl::Status status = last.status();
    if (status.ok() && *last) {
      absl::StatusOr<wire::MapUpdate> update = reader->Take();
      status = update.ok() ? Apply(*update) : update.status();
      // The first view is waited for; what comes later must not take the processor from the frames of this tracker and
      // of others, all of which get it at the same moment.
      if (status.ok() && !std::exchange(yields_, true)) YieldToOthers();
      if (status.ok()) reader = std::make_unique<wire::UpdateReader>(begin());
    }
    if (absl::IsFailedPrecondition(status) || absl::IsAborted(status)) return status;
    if (!status.ok()) {
      anew_ = true;
      return absl::UnavailableError(absl::StrCat("what ", options_.server, " sent is no update of the map (",
                                                 status.message(), "): all of it is asked for"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<const place::Vocabulary>> FollowedMap::VocabularyOf(const wire::MapUpdate& update,
                                                                                   std::uint64_t hash) {
  if (!update.vocabulary.empty()) {
    absl::StatusOr<place::Vocabulary> parsed = place::Vocabulary::Parse(update.vocabulary);
    CAIRN_RETURN_IF_ERROR(Annotate(parsed.status(), "vocabulary"));
    vocabulary_ = std::make_shared<const place::Vocabulary>(*std::move(parsed));
  }
  if (vocabulary_ == nullptr || vocabulary_->hash() != hash) {
    return absl::InvalidArgumentError("the vocabulary of the map was not sent");
  }
  return vocabulary_;
}

absl::Status FollowedMap::Apply(const wire::MapUpdate& update) {
  std::shared_ptr<const tracking::MapView> next;
  if (update.whole || wire::NeedsRebuilding(update)) {
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const map::Snapshot> snapshot, wire::Applied(update));
    const std::uint64_t hash = snapshot->info().vocabulary_hash;
    if (hash == 0) {
      return absl::FailedPreconditionError(
          absl::StrCat(map_, ": the map has no vocabulary, so that no place can be found in it"));
    }
    if (const auto held = view(); held != nullptr && held->map().info().id != snapshot->info().id) {
      return store::MakeFault(store::Fault::kMoved,
                              absl::StrCat(map_, ": another map has this name now, and is not followed"));
    }
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<const place::Vocabulary> vocabulary, VocabularyOf(update, hash));
    CAIRN_ASSIGN_OR_RETURN(next, tracking::MapView::Create(std::move(snapshot), std::move(vocabulary)));
  } else if (update.delta.num_changes == 0 && update.delta.empty()) {
    next = view();
  } else {
    CAIRN_ASSIGN_OR_RETURN(next, view()->After(update.delta));
  }
  if (update.keyframes != static_cast<std::int64_t>(next->map().keyframes().size()) ||
      (update.points >= 0 && update.points != static_cast<std::int64_t>(next->map().points().size()))) {
    return absl::DataLossError("the changes are of another history of the map");
  }
  anew_ = false;
  std::shared_ptr<const tracking::MapView> replaced;  // freed without the lock
  const std::lock_guard lock(mutex_);
  replaced = std::exchange(view_, std::move(next));
  newest_ = Clock::now();
  ++(update.whole ? traffic_.views : traffic_.changes);
  traffic_.bytes += update.bytes;
  changed_.notify_all();
  return absl::OkStatus();
}

}  // namespace cairn::client
