#include "cli/served_photo.h"

#include <cairn/v1/localize.grpc.pb.h>

#include "base/guarded.h"
#include "client/remote/channel.h"
#include "wire/convert.h"

namespace cairn::cli {
namespace {

v1::LocalizeImageRequest RequestOf(const std::string& file, const Camera& camera) {
  v1::LocalizeImageRequest request;
  request.mutable_image()->set_encoded(file);
  wire::ToProto(camera, request.mutable_camera());
  return request;
}

class ServedPhotoAsker final : public PhotoAsker {
 public:
  explicit ServedPhotoAsker(const client::RemoteOptions& options)
      : options_(options), stub_(v1::Localize::NewStub(client::NewChannel(options))) {}

  absl::StatusOr<api::LocalizeAnswer> Ask(const std::string& map, const std::string& file,
                                          const Camera& camera) override {
    return Guarded([&]() -> absl::StatusOr<api::LocalizeAnswer> {
      v1::LocalizeImageRequest request = RequestOf(file, camera);
      request.set_map(map);
      v1::LocalizeImageResponse response;
      grpc::ClientContext context;
      client::SetDeadline(options_.deadline_s, &context);
      CAIRN_RETURN_IF_ERROR(client::FromGrpc(stub_->LocalizeImage(&context, request, &response), options_));
      return wire::FromProto(response);
    });
  }

 private:
  const client::RemoteOptions options_;
  const std::unique_ptr<v1::Localize::Stub> stub_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<PhotoAsker>> NewPhotoAsker(const client::RemoteOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  return Guarded(
      [&]() -> absl::StatusOr<std::unique_ptr<PhotoAsker>> { return std::make_unique<ServedPhotoAsker>(options); });
}

std::int64_t RequestBytes(const api::LocalizeQuery& query) {
  v1::LocalizeImageRequest request;
  if (query.features) {
    wire::ToProto(*query.features, request.mutable_features());
  } else {
    wire::ToProto(query.image, request.mutable_image());
  }
  wire::ToProto(query.camera, request.mutable_camera());
  return static_cast<std::int64_t>(request.ByteSizeLong());
}

std::int64_t RequestBytes(const std::string& file, const Camera& camera) {
  return static_cast<std::int64_t>(RequestOf(file, camera).ByteSizeLong());
}

}  // namespace cairn::cli
