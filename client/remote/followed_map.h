// A map of a server, or a part of it, kept here as it changes there: a thread of its own reads what has changed and
// makes the next view, the same to the bit as the server's. When the connection breaks it is made again, and what was
// missed is asked for; until then what is known goes on to be good, and says how old it is. Any thread.
#pragma once

#include <cairn/v1/follow.grpc.pb.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "base/status.h"
#include "client/remote/channel.h"
#include "client/view_source.h"
#include "map/region.h"
#include "place/vocabulary.h"
#include "wire/convert_deltas.h"

namespace cairn::client {

class FollowedMap : public std::enable_shared_from_this<FollowedMap> {
 public:
  // Waits for the first view. Errors of the server come as they are; Unavailable, DeadlineExceeded if there is none
  // within RemoteOptions::deadline_s; FailedPrecondition if the map has no vocabulary.
  static absl::StatusOr<std::shared_ptr<FollowedMap>> Start(const RemoteOptions& options,
                                                            std::shared_ptr<grpc::Channel> channel,
                                                            const std::string& map,
                                                            const std::optional<map::RegionQuery>& region = {});
  ~FollowedMap();

  // Of a copy of a region: another part is asked for, and what both have in common is not sent again.
  void MoveTo(const map::RegionQuery& region);

  // Never null.
  std::shared_ptr<const tracking::MapView> view() const;
  MapConnection connection() const;
  // Why there is no connection; OK if there is one.
  absl::Status problem() const;

  // For a tracker; it keeps the map alive.
  std::unique_ptr<ViewSource> NewReader();

  // Until the revision is at least this one, or the time has come. True if it is.
  bool WaitFor(Revision revision, std::chrono::steady_clock::time_point until) const;

  // What came over the network so far.
  struct Traffic {
    std::int64_t views = 0;    // whole ones
    std::int64_t changes = 0;  // updates that were none
    std::int64_t bytes = 0;    // of both, serialized
  };
  Traffic traffic() const;

  // Lets the connection go, until the next call of Reconnect(); for tests and measurements.
  void Disconnect();
  void Reconnect();

 private:
  using Clock = std::chrono::steady_clock;
  class Reader;

  FollowedMap(const RemoteOptions& options, std::shared_ptr<grpc::Channel> channel, const std::string& map,
              const std::optional<map::RegionQuery>& region);

  void Run();
  // One call, until it ends, and why it did.
  absl::Status Follow();
  v1::FollowMapRequest Request();
  absl::Status ReadUpdates(grpc::ClientReader<v1::FollowMapResponse>* stream);
  absl::Status Apply(const wire::MapUpdate& update);
  absl::StatusOr<std::shared_ptr<const place::Vocabulary>> VocabularyOf(const wire::MapUpdate& update,
                                                                        std::uint64_t hash);
  void Heard(bool up_to_date);

  const RemoteOptions options_;
  const std::shared_ptr<grpc::Channel> channel_;
  const std::unique_ptr<v1::Follow::Stub> stub_;
  const std::string map_;

  // Of the thread.
  std::shared_ptr<const place::Vocabulary> vocabulary_;  // the last one used, or one that is likely
  bool anew_ = false;                                    // what is held cannot be led on
  bool yields_ = false;                                  // to other threads

  mutable std::mutex mutex_;  // guards what follows
  mutable std::condition_variable changed_;
  std::shared_ptr<const tracking::MapView> view_;  // null: none yet
  absl::Status problem_;
  bool connected_ = false;
  bool paused_ = false;
  std::optional<map::RegionQuery> region_;  // none: the whole map
  bool moving_ = false;                     // another region is to be asked for
  bool ending_ = false;
  Clock::time_point heard_;   // the last message
  Clock::time_point newest_;  // when the view was known to be the newest
  Traffic traffic_;
  grpc::ClientContext* call_ = nullptr;  // under way
  std::thread thread_;
};

}  // namespace cairn::client
