// The conformance suite of api::Localizer, asked through the public headers and through cairn.h: the boundary loses
// nothing.
#include <algorithm>
#include <array>

#include "cairn.h"
#include "cairn/conversions.h"
#include "cairn/map.h"
#include "client/boundary/testing_map_file.h"
#include "client/conformance/localizer_conformance.h"
#include "client/local_localizer.h"

namespace cairn::conformance {
namespace {

SE3 ToSE3(const v0::Pose& pose) {
  const auto& q = pose.rotation_xyzw;
  return SE3::FromUnit(Quaterniond(q[3], q[0], q[1], q[2]), Vector3d(pose.translation.data()));
}

v0::Camera ToPublic(const Camera& camera) {
  v0::Camera result;
  result.model = static_cast<v0::CameraModel>(camera.model);
  result.width_px = camera.width_px;
  result.height_px = camera.height_px;
  result.fx_px = camera.fx_px;
  result.fy_px = camera.fy_px;
  result.cx_px = camera.cx_px;
  result.cy_px = camera.cy_px;
  result.distortion = camera.distortion;
  return result;
}

// As the interface has it: grey images only.
absl::Status CheckGray(const cv::Mat& image) {
  if (image.empty() || image.type() == CV_8UC1) return absl::OkStatus();
  return absl::InvalidArgumentError("not grey");
}

class OverPublic : public api::Localizer {
 public:
  explicit OverPublic(v0::Localizer localizer) : localizer_(std::move(localizer)) {}

  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    CAIRN_RETURN_IF_ERROR(CheckGray(query.image));
    v0::LocalizeQuery asked;
    asked.image = {query.image.data, query.image.cols, query.image.rows,
                   static_cast<std::ptrdiff_t>(query.image.step[0])};
    asked.camera = ToPublic(query.camera);
    asked.time_ns = query.time_ns;
    if (query.prior) asked.prior = ToPublic(*query.prior);
    CAIRN_ASSIGN_OR_RETURN(const v0::LocalizeAnswer found, localizer_.Localize(asked));
    api::LocalizeAnswer answer;
    answer.localized = found.localized;
    answer.stage = static_cast<api::LocalizeStage>(found.stage);
    answer.reason = found.reason;
    const v0::LocalizeCounts& c = found.counts;
    answer.counts = {c.features, c.candidates, c.word_matches, c.pnp_inliers, c.guided_matches, c.inliers};
    answer.map_from_camera = ToSE3(found.map_from_camera);
    answer.component = ComponentId(found.component);
    answer.components = found.components;
    answer.world_from_camera = ToSE3(found.world_from_camera);
    answer.world_per_map = found.world_per_map;
    answer.world_is_metric = found.world_is_metric;
    answer.covariance = v0::ToEigen(found.covariance);
    answer.map_id = found.map_id;
    answer.revision = found.revision;
    answer.lens = static_cast<api::LensUse>(found.lens);
    answer.reference_keyframe = KeyframeId(found.reference_keyframe);
    answer.focal_factor = found.focal_factor;
    answer.extract_ms = found.extract_ms;
    answer.locate_ms = found.locate_ms;
    for (const v0::RivalPose& rival : found.rivals) {
      answer.rivals.push_back({ToSE3(rival.map_from_camera), ComponentId(rival.component),
                               ToSE3(rival.world_from_camera), rival.world_per_map, rival.world_is_metric,
                               v0::ToEigen(rival.covariance), KeyframeId(rival.reference_keyframe), rival.inliers,
                               rival.focal_factor});
    }
    return answer;
  }

 private:
  static v0::PosePrior ToPublic(const api::PosePrior& prior) {
    v0::PosePrior result;
    const Vector3d& t = prior.map_from_camera.translation();
    const Quaterniond& q = prior.map_from_camera.rotation();
    result.map_from_camera = {{t.x(), t.y(), t.z()}, {q.x(), q.y(), q.z(), q.w()}};
    result.component = prior.component.value();
    result.position_sigma = prior.position_sigma;
    result.rotation_sigma_rad = prior.rotation_sigma_rad;
    return result;
  }
  static v0::Camera ToPublic(const Camera& camera) { return conformance::ToPublic(camera); }

  v0::Localizer localizer_;
};

absl::StatusOr<std::unique_ptr<api::Localizer>> OpenPublic(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const v0::Map map, v0::Map::Open(path));
  CAIRN_ASSIGN_OR_RETURN(v0::Localizer localizer, map.NewLocalizer());
  return std::make_unique<OverPublic>(std::move(localizer));  // outlives the map
}

INSTANTIATE_TEST_SUITE_P(Public, LocalizerConformance, testing::Values(LocalizerFactory(&OpenPublic)));

absl::Status FromC(cairn_code code, const cairn_error& error) {
  EXPECT_EQ(code, error.code);
  return absl::Status(static_cast<absl::StatusCode>(code), error.message);
}

SE3 ToSE3(const cairn_pose& pose) {
  const double* q = pose.rotation_xyzw;
  return SE3::FromUnit(Quaterniond(q[3], q[0], q[1], q[2]), Vector3d(pose.translation));
}

class OverC : public api::Localizer {
 public:
  explicit OverC(cairn_localizer* localizer) : localizer_(localizer) {}
  ~OverC() override { cairn_localizer_free(localizer_); }

  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    CAIRN_RETURN_IF_ERROR(CheckGray(query.image));
    cairn_image image{};
    image.struct_size = sizeof(image);
    image.data = query.image.data;
    image.width_px = query.image.cols;
    image.height_px = query.image.rows;
    image.stride_bytes = static_cast<std::int64_t>(query.image.step[0]);
    const Camera& from = query.camera;
    cairn_camera camera{sizeof(camera),
                        static_cast<std::int32_t>(from.model),
                        from.width_px,
                        from.height_px,
                        static_cast<std::int32_t>(from.distortion.size()),
                        from.fx_px,
                        from.fy_px,
                        from.cx_px,
                        from.cy_px,
                        {}};
    std::copy(from.distortion.begin(), from.distortion.end(), camera.distortion);
    cairn_error error{};
    error.struct_size = sizeof(error);
    cairn_localize_answer found{};
    found.struct_size = sizeof(found);
    cairn_prior prior{sizeof(prior), {}, 0.0, 0.0, 0, 0};
    if (query.prior) {
      const Vector3d& t = query.prior->map_from_camera.translation();
      const Quaterniond& q = query.prior->map_from_camera.rotation();
      prior.map_from_camera = {{t.x(), t.y(), t.z()}, {q.x(), q.y(), q.z(), q.w()}};
      prior.position_sigma = query.prior->position_sigma;
      prior.rotation_sigma_rad = query.prior->rotation_sigma_rad;
      prior.component = query.prior->component.value();
    }
    const cairn_localize_query asked{sizeof(asked), &image, &camera, query.time_ns, query.prior ? &prior : nullptr};
    const cairn_code code = cairn_localizer_localize(localizer_, &asked, nullptr, &found, &error);
    if (code != CAIRN_OK) return FromC(code, error);
    return FromC(found);
  }

 private:
  static api::LocalizeAnswer FromC(const cairn_localize_answer& found) {
    api::LocalizeAnswer answer;
    answer.localized = found.localized != 0;
    answer.stage = static_cast<api::LocalizeStage>(found.stage);
    answer.reason = found.reason;
    answer.counts = {found.features,    found.candidates,     found.word_matches,
                     found.pnp_inliers, found.guided_matches, found.inliers};
    answer.map_from_camera = ToSE3(found.map_from_camera);
    answer.world_from_camera = ToSE3(found.world_from_camera);
    answer.component = ComponentId(found.component);
    answer.components = found.components;
    answer.world_per_map = found.world_per_map;
    answer.world_is_metric = found.world_is_metric != 0;
    answer.lens = static_cast<api::LensUse>(found.lens);
    answer.extract_ms = found.extract_ms;
    answer.locate_ms = found.locate_ms;
    answer.covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(found.covariance);
    answer.map_id = found.map_id;
    answer.revision = found.revision;
    answer.reference_keyframe = KeyframeId(found.reference_keyframe);
    answer.focal_factor = found.focal_factor;
    for (int i = 0; i < found.num_rivals; ++i) {
      const cairn_rival& rival = found.rivals[i];
      api::LocatedPose pose;
      pose.map_from_camera = ToSE3(rival.map_from_camera);
      pose.world_from_camera = ToSE3(rival.world_from_camera);
      pose.component = ComponentId(rival.component);
      pose.reference_keyframe = KeyframeId(rival.reference_keyframe);
      pose.inliers = rival.inliers;
      pose.world_is_metric = rival.world_is_metric != 0;
      pose.covariance.diagonal().setConstant(rival.position_sigma * rival.rotation_sigma_rad);
      answer.rivals.push_back(pose);
    }
    return answer;
  }
  static absl::Status FromC(cairn_code code, const cairn_error& error) { return conformance::FromC(code, error); }

  cairn_localizer* localizer_;
};

absl::StatusOr<std::unique_ptr<api::Localizer>> OpenC(const std::string& path) {
  cairn_error error{};
  error.struct_size = sizeof(error);
  cairn_map* map = nullptr;
  if (const auto code = cairn_map_open(path.c_str(), nullptr, nullptr, &map, &error)) return FromC(code, error);
  cairn_localizer* localizer = nullptr;
  const cairn_code code = cairn_localizer_new(map, &localizer, &error);
  cairn_map_close(map);
  if (code != CAIRN_OK) return FromC(code, error);
  return std::make_unique<OverC>(localizer);
}

INSTANTIATE_TEST_SUITE_P(C, LocalizerConformance, testing::Values(LocalizerFactory(&OpenC)));

void ExpectSame(const SE3& a, const SE3& b) {
  EXPECT_EQ(a.translation(), b.translation());
  EXPECT_EQ(a.rotation().coeffs(), b.rotation().coeffs());
}

// But for the time that it took.
void ExpectSame(const api::LocalizeAnswer& a, const api::LocalizeAnswer& b) {
  EXPECT_EQ(a.localized, b.localized);
  EXPECT_EQ(a.stage, b.stage);
  EXPECT_EQ(a.reason, b.reason);
  EXPECT_EQ(a.counts.features, b.counts.features);
  EXPECT_EQ(a.counts.candidates, b.counts.candidates);
  EXPECT_EQ(a.counts.word_matches, b.counts.word_matches);
  EXPECT_EQ(a.counts.pnp_inliers, b.counts.pnp_inliers);
  EXPECT_EQ(a.counts.guided_matches, b.counts.guided_matches);
  EXPECT_EQ(a.counts.inliers, b.counts.inliers);
  ExpectSame(a.map_from_camera, b.map_from_camera);
  EXPECT_EQ(a.component, b.component);
  EXPECT_EQ(a.components, b.components);
  ExpectSame(a.world_from_camera, b.world_from_camera);
  EXPECT_EQ(a.world_per_map, b.world_per_map);
  EXPECT_EQ(a.world_is_metric, b.world_is_metric);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.map_id, b.map_id);
  EXPECT_EQ(a.revision, b.revision);
  EXPECT_EQ(a.lens, b.lens);
  EXPECT_EQ(a.reference_keyframe, b.reference_keyframe);
}

TEST(Boundary, AnswersAreThoseOfTheLocalizerBehindIt) {
  const TestingMapFile file("boundary");
  ASSERT_TRUE(WriteConformanceMap(file.path).ok());
  const auto local = client::LocalLocalizer::Open(file.path);
  ASSERT_TRUE(local.ok()) << local.status();
  const ConformanceMap& map = TheConformanceMap();
  const SE3 pose = LookInRoom({0.2, 0.0, -1.4}, 0.05);
  api::LocalizeQuery query{map.room.Render(map.pinhole, pose), Camera::FromPinhole(map.pinhole), 5};
  for (const bool here : {true, false}) {
    if (!here) query.image = RenderedRoom(77).Render(map.pinhole, pose);
    const auto expected = (*local)->Localize(query);
    ASSERT_TRUE(expected.ok()) << expected.status();
    EXPECT_EQ(expected->localized, here);
    for (const auto& open : {LocalizerFactory(&OpenPublic), LocalizerFactory(&OpenC)}) {
      const auto localizer = open(file.path);
      ASSERT_TRUE(localizer.ok()) << localizer.status();
      const auto answer = (*localizer)->Localize(query);
      ASSERT_TRUE(answer.ok()) << answer.status();
      ExpectSame(*answer, *expected);
      EXPECT_GT(answer->extract_ms, 0.0);
    }
  }
}

}  // namespace
}  // namespace cairn::conformance
