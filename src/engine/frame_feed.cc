#include "engine/frame_feed.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/guarded.h"

namespace cairn::engine {

absl::Status FrameFeedOptions::Validate() const {
  if (ahead < 1) return absl::InvalidArgumentError("a feed must be allowed at least 1 frame ahead");
  if (!(realtime_speed >= 0.0) || !std::isfinite(realtime_speed)) {
    return absl::InvalidArgumentError(absl::StrCat("the speed of playing is ", realtime_speed,
                                                   " but must be positive, or 0 for as fast as possible"));
  }
  if (!(stall_s >= 0.0)) return absl::InvalidArgumentError("a stall must last 0 seconds or more");
  return absl::OkStatus();
}

FrameFeed::FrameFeed(const FrameFeedOptions& options, const FramePreparation& preparation, Read read)
    : options_(options), preparation_(preparation), read_(std::move(read)) {
  if (!options_.in_background && options_.realtime_speed == 0.0) return;
  absl::StatusOr<std::thread> thread = StartThread(
      "reading frames", [this] { Work(); }, [this](const absl::Status& status) { End(status); });
  if (thread.ok()) {
    thread_ = *std::move(thread);
  } else {
    End(thread.status());
  }
}

FrameFeed::~FrameFeed() {
  Stop();
  if (thread_.joinable()) thread_.join();
}

void FrameFeed::Stop() {
  std::lock_guard lock(mutex_);
  stopped_ = true;
  changed_.notify_all();
}

std::int64_t FrameFeed::dropped() const {
  std::lock_guard lock(mutex_);
  return dropped_;
}

std::int64_t FrameFeed::refused() const {
  std::lock_guard lock(mutex_);
  return refused_;
}

absl::Status FrameFeed::first_refusal() const {
  std::lock_guard lock(mutex_);
  return first_refusal_;
}

absl::StatusOr<std::optional<FedFrame>> FrameFeed::Next() {
  std::unique_lock lock(mutex_);
  if (!thread_.joinable() && !ended_) {
    if (stopped_) return std::optional<FedFrame>();
    lock.unlock();
    return Guarded([&] { return Fetch(); });
  }
  if (options_.stall_s > 0.0 && given_) {
    const Clock::duration away = Clock::now() - *given_;
    if (std::chrono::duration<double>(away).count() > options_.stall_s) catch_up_until_ = Clock::now() + 2 * away;
  }
  changed_.wait(lock, [&] { return stopped_ || ended_ || !waiting_.empty(); });
  if (stopped_) return std::optional<FedFrame>();
  if (waiting_.empty()) {
    CAIRN_RETURN_IF_ERROR(status_);
    return std::optional<FedFrame>();
  }
  const bool catching_up = catch_up_until_ && Clock::now() < *catch_up_until_;
  if (options_.realtime_speed > 0.0 && !catching_up) ForgetAllButTheLast();
  std::optional<FedFrame> fed(std::move(waiting_.front()));
  waiting_.pop_front();
  fed->dropped_before = dropped_ - std::exchange(dropped_told_, dropped_);
  if (waiting_.empty() || !catching_up) catch_up_until_.reset();
  given_ = Clock::now();
  changed_.notify_all();
  return fed;
}

absl::StatusOr<std::optional<RawFrame>> FrameFeed::ReadInOrder() {
  for (;;) {
    CAIRN_ASSIGN_OR_RETURN(std::optional<RawFrame> raw, read_());
    if (!raw) return raw;
    const absl::Status refusal = times_.Accept(raw->time_ns);
    if (refusal.ok()) return raw;
    std::lock_guard lock(mutex_);
    if (stopped_) return std::optional<RawFrame>();
    if (refused_++ == 0) first_refusal_ = Annotate(refusal, absl::StrCat("frame ", raw->index));
  }
}

absl::StatusOr<std::optional<FedFrame>> FrameFeed::Fetch() {
  CAIRN_ASSIGN_OR_RETURN(const std::optional<RawFrame> raw, ReadInOrder());
  if (!raw) return std::optional<FedFrame>();
  if (options_.realtime_speed > 0.0) WaitUntilDue(raw->time_ns);
  const Clock::time_point start = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(direct::Frame frame, preparation_.Prepare(*raw));
  const float prepare_ms = std::chrono::duration<float, std::milli>(Clock::now() - start).count();
  return std::optional<FedFrame>({std::move(frame), start, prepare_ms});
}

// A frame that could not be read in time arrives late; those after it are due by the clock again.
void FrameFeed::WaitUntilDue(TimeNs time_ns) {
  if (!begin_) {
    begin_ = Clock::now();
    first_ns_ = time_ns;
  }
  const std::chrono::duration<double> since(ToSeconds(time_ns - first_ns_) / options_.realtime_speed);
  const Clock::time_point due = *begin_ + std::chrono::duration_cast<Clock::duration>(since);
  std::unique_lock lock(mutex_);
  changed_.wait_until(lock, due, [&] { return stopped_; });
}

// What waits still comes, then the error, if it is one.
void FrameFeed::End(const absl::Status& status) {
  std::lock_guard lock(mutex_);
  status_ = status;
  ended_ = true;
  changed_.notify_all();
}

void FrameFeed::ForgetAllButTheLast() {
  dropped_ += static_cast<std::int64_t>(waiting_.size()) - 1;
  waiting_.erase(waiting_.begin(), waiting_.end() - 1);
}

// Whether they will be wanted is known when the next frame is asked for.
void FrameFeed::KeepWithinBounds() {
  if (options_.stall_s == 0.0) return ForgetAllButTheLast();
  const cv::Mat& image = waiting_.back().frame.image;  // all are of one size
  const std::size_t most = std::max<std::size_t>(1, options_.kept_bytes / (image.total() * image.elemSize()));
  for (; waiting_.size() > most; ++dropped_) waiting_.pop_front();
}

void FrameFeed::Work() {
  for (;;) {
    absl::StatusOr<std::optional<FedFrame>> fed = Fetch();
    std::unique_lock lock(mutex_);
    if (stopped_) return;
    if (!fed.ok() || !fed->has_value()) {
      lock.unlock();
      return End(fed.status());
    }
    if (options_.realtime_speed == 0.0) {
      changed_.wait(lock, [&] { return stopped_ || waiting_.size() < static_cast<std::size_t>(options_.ahead); });
      if (stopped_) return;
    }
    waiting_.push_back(**std::move(fed));
    if (options_.realtime_speed > 0.0) KeepWithinBounds();
    changed_.notify_all();
  }
}

}  // namespace cairn::engine
