/// \file
/// "Where is this camera?", asked with one image.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "cairn/answers.h"
#include "cairn/call_options.h"
#include "cairn/camera.h"
#include "cairn/export.h"
#include "cairn/image_view.h"
#include "cairn/pose.h"
#include "cairn/status.h"

CAIRN_BEGIN_NAMESPACE

/// Where a camera is thought to be: it narrows the search, and excludes what only looks alike. An image that fits
/// nowhere near it is not located. Standard deviations per axis.
struct PosePrior {
  /// In the frame of `component`, in its units; without one in the world frame of the components that are aligned, or
  /// in the frame of the only component.
  Pose map_from_camera;
  std::uint32_t component = 0;      ///< 0: none
  double position_sigma = 0.0;      ///< greater than 0; infinite: unknown
  double rotation_sigma_rad = 0.0;  ///< greater than 0
};

/// One image, and the camera that took it: any camera, not only one that made the map.
struct LocalizeQuery {
  ImageView image;                                ///< of the size of the camera
  Camera camera;                                  ///< of that image
  std::int64_t time_ns = 0;                       ///< when it was taken, on the caller's clock
  std::optional<PosePrior> prior = std::nullopt;  ///< never needed
};

/// Finds single images in a map, each on its own. Made by Map::NewLocalizer(); keeps what it needs of the map alive,
/// and answers from the newest revision that any of Map's copies has gone on to. A copy is the same localizer.
/// Thread-safe: any number of calls at once.
class CAIRN_API Localizer {
 public:
  /// A miss is an answer with `localized` false. Errors: kInvalidArgument (image, camera or prior),
  /// kFailedPrecondition (a lens whose images cannot be undistorted), kDeadlineExceeded,
  /// kCancelled, kDataLoss, kResourceExhausted, kUnavailable.
  absl::StatusOr<LocalizeAnswer> Localize(const LocalizeQuery& query, const CallOptions& call = {}) const noexcept;

  /// \cond What the library has behind it; of no use to others.
  class CAIRN_HIDDEN Impl;
  CAIRN_HIDDEN explicit Localizer(std::shared_ptr<Impl> impl) noexcept;
  /// \endcond

 private:
  std::shared_ptr<Impl> impl_;
};

CAIRN_END_NAMESPACE
