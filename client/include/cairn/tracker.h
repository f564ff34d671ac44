/// \file
/// A pose for every image of a stream, in a map that is not touched.
#pragma once

#include <cstdint>
#include <memory>

#include "cairn/answers.h"
#include "cairn/call_options.h"
#include "cairn/export.h"
#include "cairn/image_view.h"
#include "cairn/status.h"

CAIRN_BEGIN_NAMESPACE

/// How the images of a stream are followed.
enum class TrackMode {
  kSemiDirect,  ///< by their brightness, every image; anchored in the map beside it
  kFeatures,    ///< by features matched against the map, every image: for cameras too slow for the other
};

/// How a tracker works; the defaults are meant for use.
struct TrackerOptions {
  TrackMode mode = TrackMode::kSemiDirect;  ///< how
  /// Everything in the thread that calls, so that the same images give the same answers; slower.
  bool deterministic = false;
  /// An image without a pose is looked for in the whole map before Track() returns, which takes as long as a Localizer.
  /// False: beside the calls, none of which then takes long; what is found reaches a later image.
  bool relocalize_in_call = true;
  /// For recordings that are read faster than they were made: a call waits for the match of the image before, if there
  /// is one, so that as many are matched as of a live camera, and their answers come as soon.
  bool wait_for_matches = false;
};

/// Finds itself in the map, follows the camera, carries it on where the map does not reach, and finds itself again
/// after a loss. Made by Map::NewTracker(), one for each camera; keeps what it needs of the map alive. It is moved, not
/// copied. Thread-safe in that calls from several threads are made one after the other; images still must come in
/// order.
class CAIRN_API Tracker {
 public:
  /// Ends the tracker's threads.
  ~Tracker();
  /// The tracker moved from answers kFailedPrecondition.
  Tracker(Tracker&&) noexcept;
  /// As above.
  Tracker& operator=(Tracker&&) noexcept;

  /// `image` is of the size of the tracker's camera, `time_ns` on the caller's clock and later than that of the image
  /// before. A loss is an answer with the state kLost. Errors: kInvalidArgument (image, or a time that does not grow),
  /// kDeadlineExceeded, kCancelled, kDataLoss, kResourceExhausted, kUnavailable; the tracker is then as it was before.
  absl::StatusOr<TrackAnswer> Track(const ImageView& image, std::int64_t time_ns,
                                    const CallOptions& call = {}) noexcept;

  /// \cond What the library has behind it; of no use to others.
  class CAIRN_HIDDEN Impl;
  CAIRN_HIDDEN explicit Tracker(std::unique_ptr<Impl> impl) noexcept;
  /// \endcond

 private:
  std::unique_ptr<Impl> impl_;
};

CAIRN_END_NAMESPACE
