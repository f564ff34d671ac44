#include "server/rpc/follow_map.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "base/guarded.h"
#include "wire/convert_deltas.h"
#include "wire/convert_map_rows.h"

namespace cairn::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kMaxIntervalMs = 60'000;
constexpr std::chrono::milliseconds kLook(200);       // so long until it is seen that a client is gone
constexpr std::chrono::milliseconds kUpToDate(1000);  // from one sign of life to the next

class FollowCall {
 public:
  FollowCall(const v1::FollowMapRequest& request, FollowStream* stream) : request_(request), stream_(*stream) {
    for (const std::uint64_t hash : request.vocabularies()) known_.push_back(hash);
  }

  absl::Status Run(api::MapService* maps) {
    api::FollowRequest request;
    request.map_id = request_.held().map_id();
    request.revision = request_.held().revision();
    request.min_interval = std::chrono::milliseconds(request_.min_interval_ms());
    if (request_.has_region()) {
      CAIRN_ASSIGN_OR_RETURN(request.region, wire::FromProto(request_.region()));
      for (const std::uint32_t id : request_.held().keyframes()) request.held.emplace_back(id);
      if (!std::ranges::is_sorted(request.held)) return absl::InvalidArgumentError("held.keyframes: must ascend");
    }
    CAIRN_ASSIGN_OR_RETURN(feed_, maps->Follow(request_.map(), request));
    while (!stream_.Ended()) {
      CAIRN_ASSIGN_OR_RETURN(const std::optional<api::MapStep> step, feed_->Next(kLook));
      if (!(step ? Send(*step) : SayUpToDate())) break;
    }
    return absl::OkStatus();
  }

 private:
  bool Send(const api::MapStep& step) {
    revision_ = step.map->revision();
    told_ = Clock::now();
    const std::uint64_t hash = step.map->info().vocabulary_hash;
    std::string vocabulary;
    if (hash != 0 && std::ranges::find(known_, hash) == known_.end()) {
      vocabulary = feed_->Vocabulary();
      known_.push_back(hash);
    }
    return wire::WriteUpdate(*step.map, step.rows, vocabulary, step.only ? &*step.only : nullptr,
                             [&](const v1::FollowMapResponse& message) { return stream_.Write(message); });
  }

  bool SayUpToDate() {
    if (Clock::now() < told_ + kUpToDate) return true;
    told_ = Clock::now();
    v1::FollowMapResponse message;
    message.mutable_up_to_date()->set_revision(revision_);
    return stream_.Write(message);
  }

  const v1::FollowMapRequest& request_;
  FollowStream& stream_;
  std::vector<std::uint64_t> known_;  // vocabularies that the follower has
  std::unique_ptr<api::MapFeed> feed_;
  Revision revision_ = 0;
  Clock::time_point told_;
};

}  // namespace

absl::Status FollowMap(const CallContext& context, const v1::FollowMapRequest& request, FollowStream* stream) {
  return Guarded([&] {
    if (request.min_interval_ms() < 0 || request.min_interval_ms() > kMaxIntervalMs) {
      return absl::InvalidArgumentError(absl::StrCat("min_interval_ms: must be 0 to ", kMaxIntervalMs));
    }
    return FollowCall(request, stream).Run(context.maps);
  });
}

}  // namespace cairn::server
