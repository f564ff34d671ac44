#include "cli/localize_target.h"

#include <utility>

#include "cli/map_camera.h"
#include "cli/server_option.h"
#include "client/local_localizer.h"

namespace cairn::cli {
namespace {

class MapFile final : public LocalizeTarget {
 public:
  explicit MapFile(std::unique_ptr<client::LocalLocalizer> localizer) : localizer_(std::move(localizer)) {
    Look();
    cameras_ = CamerasOf(localizer_->snapshot());
  }

  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer_->Localize(query);
  }
  absl::StatusOr<bool> Refresh() override {
    CAIRN_ASSIGN_OR_RETURN(const bool newer, localizer_->Refresh());
    if (newer) Look();
    return newer;
  }
  Revision revision() const override { return localizer_->snapshot().revision(); }
  const CommonFrame& frame() const override { return frame_; }
  const std::vector<Camera>& cameras() const override { return cameras_; }

 private:
  void Look() { frame_ = CommonFrameOf(localizer_->snapshot()); }

  const std::unique_ptr<client::LocalLocalizer> localizer_;
  CommonFrame frame_;
  std::vector<Camera> cameras_;
};

// The server answers from the newest revision by itself.
class ServedMap final : public LocalizeTarget {
 public:
  ServedMap(std::unique_ptr<client::RemoteMapService> service, const std::string& map,
            const api::MapDescription& description)
      : service_(std::move(service)),
        localizer_(service_.get(), map),
        revision_(description.summary.revision),
        frame_(CommonFrameOf(description)) {
    for (const api::CameraInfo& camera : description.cameras) cameras_.push_back(camera.camera);
  }

  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer_.Localize(query);
  }
  absl::StatusOr<bool> Refresh() override { return false; }
  Revision revision() const override { return revision_; }
  const CommonFrame& frame() const override { return frame_; }
  const std::vector<Camera>& cameras() const override { return cameras_; }

 private:
  const std::unique_ptr<client::RemoteMapService> service_;
  api::ServedLocalizer localizer_;
  const Revision revision_;
  const CommonFrame frame_;
  std::vector<Camera> cameras_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<LocalizeTarget>> OpenLocalizeTarget(const ServerChoice& server, const std::string& map) {
  if (server.empty()) {
    CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::LocalLocalizer> localizer, client::LocalLocalizer::Open(map));
    return std::make_unique<MapFile>(std::move(localizer));
  }
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::RemoteMapService> service, ConnectTo(server));
  CAIRN_ASSIGN_OR_RETURN(const api::MapDescription description, service->Describe(map));
  return std::make_unique<ServedMap>(std::move(service), map, description);
}

}  // namespace cairn::cli
