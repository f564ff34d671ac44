#include "map/entities.h"
#include "store/blobs.h"
#include "wire/convert.h"

namespace cairn::wire {
namespace {

store::Bytes ViewOf(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

absl::Status BadFeatures(absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("features: ", what));
}

}  // namespace

void ToProto(const image::OrbParameters& orb, v1::OrbParameters* out) {
  out->set_num_features(orb.num_features);
  out->set_num_levels(orb.num_levels);
  out->set_scale_factor(orb.scale_factor);
  out->set_fast_threshold(orb.fast_threshold);
  out->set_min_fast_threshold(orb.min_fast_threshold);
}

absl::StatusOr<image::OrbParameters> FromProto(const v1::OrbParameters& message) {
  image::OrbParameters orb;
  orb.num_features = message.num_features();
  orb.num_levels = message.num_levels();
  orb.scale_factor = message.scale_factor();
  orb.fast_threshold = message.fast_threshold();
  orb.min_fast_threshold = message.min_fast_threshold();
  CAIRN_RETURN_IF_ERROR(orb.Validate());
  return orb;
}

void ToProto(const api::ImageFeatures& features, v1::ImageFeatures* out) {
  store::PackedFeatures packed = store::PackFeatures({features.features, {}});
  v1::FeaturesRow* row = out->mutable_features();
  row->set_count(static_cast<std::uint32_t>(packed.count));
  row->set_keypoint_layout(static_cast<std::uint32_t>(packed.layout));
  row->set_keypoints(std::move(packed.keypoints));
  row->set_descriptors(std::move(packed.descriptors));
  ToProto(Camera::FromPinhole(features.pinhole), out->mutable_pinhole());
  ToProto(features.orb, out->mutable_orb());
}

absl::StatusOr<api::ImageFeatures> FromProto(const v1::ImageFeatures& message) {
  api::ImageFeatures features;
  CAIRN_ASSIGN_OR_RETURN(features.orb, FromProto(message.orb()));
  CAIRN_ASSIGN_OR_RETURN(const Camera pinhole, FromProto(message.pinhole()));
  CAIRN_RETURN_IF_ERROR(Annotate(pinhole.Validate(), "features: pinhole"));
  if (pinhole.model != CameraModel::kPinhole) return BadFeatures("their camera must be a pinhole");
  features.pinhole = {pinhole.width_px, pinhole.height_px, pinhole.fx_px, pinhole.fy_px, pinhole.cx_px, pinhole.cy_px};
  const v1::FeaturesRow& row = message.features();
  if (row.count() > api::kMaxImageFeatures) {
    return BadFeatures(absl::StrCat(row.count(), " are too many, at most ", api::kMaxImageFeatures));
  }
  if (row.word_bytes() != 0) return BadFeatures("words are the server's to find");
  auto unpacked = store::UnpackFeatures(row.count(), row.keypoint_layout(), 0, ViewOf(row.keypoints()),
                                        ViewOf(row.descriptors()), {});
  if (!unpacked.ok()) return BadFeatures(unpacked.status().message());
  const absl::string_view wrong =
      store::WrongKeypoints(unpacked->features.keypoints, &features.pinhole, features.orb.num_levels);
  if (!wrong.empty()) return BadFeatures(wrong);
  features.features = std::move(unpacked->features);
  return features;
}

}  // namespace cairn::wire
