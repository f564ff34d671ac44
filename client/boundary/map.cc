#include "cairn/map.h"

#include <utility>

#include "base/guarded.h"
#include "base/status.h"
#include "client/boundary/convert.h"
#include "client/boundary/impl.h"
#include "client/boundary/local_tracker_factory.h"

namespace cairn::v0 {
namespace {

absl::Status MovedFrom(const char* what) {
  return absl::FailedPreconditionError(absl::StrCat(what, ": the object was moved from"));
}

}  // namespace

Map::Map(std::shared_ptr<Impl> impl) noexcept : impl_(std::move(impl)) {}

absl::StatusOr<Map> Map::Open(const std::string& path, const MapOptions& options, const CallOptions& call) noexcept {
  return Guarded([&]() -> absl::StatusOr<Map> {
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, path));
    client::LocalLocalizerOptions localizer;
    localizer.num_features = options.num_features;
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<client::MapState> map,
                           client::MapState::Open(path, localizer, client::ToInternal(options.server)));
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, path));
    return Map(std::make_shared<Impl>(std::move(map)));
  });
}

absl::StatusOr<MapInfo> Map::Info() const noexcept {
  return Guarded([&]() -> absl::StatusOr<MapInfo> {
    if (!impl_) return MovedFrom("map");
    MapInfo info;
    impl_->map().Read([&](const map::Snapshot& map) { info = client::InfoOf(map); });
    return info;
  });
}

absl::StatusOr<bool> Map::Refresh(const CallOptions& call) const noexcept {
  return Guarded([&]() -> absl::StatusOr<bool> {
    if (!impl_) return MovedFrom("map");
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "refresh"));
    return impl_->map().Refresh();
  });
}

absl::StatusOr<Localizer> Map::NewLocalizer() const noexcept {
  return Guarded([&]() -> absl::StatusOr<Localizer> {
    if (!impl_) return MovedFrom("map");
    return Localizer(std::make_shared<Localizer::Impl>(impl_->shared_map()));
  });
}

absl::StatusOr<Tracker> Map::NewTracker(const Camera& camera, const TrackerOptions& options,
                                        const CallOptions& call) const noexcept {
  return Guarded([&]() -> absl::StatusOr<Tracker> {
    if (!impl_) return MovedFrom("map");
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "tracker"));
    CAIRN_ASSIGN_OR_RETURN(const cairn::Camera internal, client::ToInternal(camera));
    CAIRN_RETURN_IF_ERROR(Annotate(internal.Validate(), "tracker"));
    if (options.mode != TrackMode::kSemiDirect && options.mode != TrackMode::kFeatures) {
      return absl::InvalidArgumentError(absl::StrCat("tracker: there is no mode ", static_cast<int>(options.mode)));
    }
    CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<api::Tracker> tracker,
                           client::MakeLocalTracker(impl_->map(), internal, options));
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "tracker"));
    return Tracker(std::make_unique<Tracker::Impl>(internal, std::move(tracker)));
  });
}

Localizer::Localizer(std::shared_ptr<Impl> impl) noexcept : impl_(std::move(impl)) {}

absl::StatusOr<LocalizeAnswer> Localizer::Localize(const LocalizeQuery& query, const CallOptions& call) const noexcept {
  return Guarded([&]() -> absl::StatusOr<LocalizeAnswer> {
    if (!impl_) return MovedFrom("localizer");
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "localize"));
    api::LocalizeQuery internal;
    CAIRN_ASSIGN_OR_RETURN(internal.camera, client::ToInternal(query.camera));
    CAIRN_ASSIGN_OR_RETURN(internal.image, client::GrayImage(query.image));
    internal.time_ns = query.time_ns;
    if (query.prior) {
      CAIRN_ASSIGN_OR_RETURN(internal.prior, client::ToInternal(*query.prior));
    }
    CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "localize"));
    CAIRN_ASSIGN_OR_RETURN(const api::LocalizeAnswer answer, impl_->map().Localize(internal));
    return client::ToPublic(answer);
  });
}

Tracker::Tracker(std::unique_ptr<Impl> impl) noexcept : impl_(std::move(impl)) {}
Tracker::~Tracker() = default;
Tracker::Tracker(Tracker&&) noexcept = default;
Tracker& Tracker::operator=(Tracker&&) noexcept = default;

absl::StatusOr<TrackAnswer> Tracker::Track(const ImageView& image, std::int64_t time_ns,
                                           const CallOptions& call) noexcept {
  return Guarded([&]() -> absl::StatusOr<TrackAnswer> {
    if (!impl_) return MovedFrom("tracker");
    return impl_->Track(image, time_ns, call);
  });
}

absl::StatusOr<TrackAnswer> Tracker::Impl::Track(const ImageView& image, std::int64_t time_ns,
                                                 const CallOptions& call) {
  CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "track"));
  if (image.width_px != camera_.width_px || image.height_px != camera_.height_px) {
    return absl::InvalidArgumentError(absl::StrCat("track: the image has ", image.width_px, "x", image.height_px,
                                                   " pixels, the tracker's camera ", camera_.width_px, "x",
                                                   camera_.height_px));
  }
  api::TrackFrame frame;
  frame.time_ns = time_ns;
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat gray, client::GrayImage(image));
  // A tracker may go on to work on the image beside the caller, whose pixels these are.
  frame.image = image.format == PixelFormat::kGray8 ? gray.clone() : gray;
  const std::lock_guard lock(mutex_);
  CAIRN_RETURN_IF_ERROR(client::CheckCall(call, "track"));
  frame.out_of_time = [&call] { return !client::CheckCall(call, "track").ok(); };
  CAIRN_ASSIGN_OR_RETURN(const api::TrackAnswer answer, tracker_->Track(frame));
  return client::ToPublic(answer);
}

}  // namespace cairn::v0
