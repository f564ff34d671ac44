#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"
#include "direct/coarse_tracker.h"
#include "direct/image_pyramid.h"
#include "direct/keyframe.h"
#include "direct/residual_kernel.h"
#include "direct/testing_scene.h"
#include "direct/tracking_kernel.h"

namespace cairn::direct {
namespace {

// A linear image: bilinear samples and central differences are exact, so analytic and numeric derivatives must agree.
std::vector<float> LinearImage(int width, int height, float c, float dx, float dy) {
  std::vector<float> image;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.insert(image.end(),
                   {c + dx * static_cast<float>(x) + dy * static_cast<float>(y), dx, dy, dx * dx + dy * dy});
    }
  }
  return image;
}

struct TrackingCase {
  std::vector<float> x, y, inverse_depth, color, image;
  TrackingKernelInput input;

  explicit TrackingCase(bool textured) {
    Random random(3);
    const int width = 160, height = 120;
    if (textured) {
      for (int i = 0; i < width * height; ++i) {
        for (int c = 0; c < 4; ++c) image.push_back(static_cast<float>(random.Uniform(-20.0, 120.0)));
      }
    } else {
      image = LinearImage(width, height, 30.0f, 0.4f, -0.25f);
    }
    for (int i = 0; i < 203; ++i) {
      x.push_back(static_cast<float>(random.Uniform(textured ? -5.0 : 30.0, textured ? 170.0 : 130.0)));
      y.push_back(static_cast<float>(random.Uniform(textured ? -5.0 : 30.0, textured ? 125.0 : 90.0)));
      inverse_depth.push_back(static_cast<float>(random.Uniform(0.2, 2.0)));
      color.push_back(static_cast<float>(random.Uniform(10.0, 90.0)));
    }
    while (x.size() % 8 != 0)
      x.push_back(-1e6f), y.push_back(-1e6f), inverse_depth.push_back(1.0f), color.push_back(0.0f);
    input.x = x.data(), input.y = y.data(), input.inverse_depth = inverse_depth.data(), input.color = color.data();
    input.count = static_cast<int>(x.size());
    input.image = image.data(), input.width = width, input.height = height;
    input.fx = 130.0f, input.fy = 125.0f, input.cx = 79.5f, input.cy = 59.5f;
    input.huber = textured ? 9.0f : 1e5f, input.cutoff = textured ? 20.0f : 1e5f;
  }

  void Set(const SE3& pose, double a, double b) {
    Matrix3d k_inverse;
    k_inverse << 1.0 / input.fx, 0, -input.cx / input.fx, 0, 1.0 / input.fy, -input.cy / input.fy, 0, 0, 1;
    const Matrix3d rays = pose.RotationMatrix() * k_inverse;
    for (int i = 0; i < 9; ++i) input.rotation_rays[i] = static_cast<float>(rays(i / 3, i % 3));
    for (int i = 0; i < 3; ++i) input.translation[i] = static_cast<float>(pose.translation()[i]);
    input.gain = static_cast<float>(std::exp(a));
    input.offset = static_cast<float>(b);
  }
};

const SE3 kPose(ExpSO3(Vector3d(0.02, -0.03, 0.015)), Vector3d(0.05, -0.02, 0.03));

TEST(TrackingKernel, GradientMatchesDifferences) {
  TrackingCase c(false);
  c.Set(kPose, 0.1, 3.0);
  TrackingKernelSums sums;
  TrackingKernelBaseline(c.input, &sums);
  ASSERT_EQ(sums.visible, 203);
  ASSERT_EQ(sums.saturated, 0);
  for (int i = 0; i < kTrackingUnknowns; ++i) {
    const double h = i < 6 ? 2e-3 : i == 6 ? 5e-3 : 0.5;
    double energy[2];
    for (int side = 0; side < 2; ++side) {
      Vector8d step = Vector8d::Zero();
      step[i] = side == 0 ? -h : h;
      c.Set(SE3::Exp(step.head<6>()) * kPose, 0.1 + step[6], 3.0 + step[7]);
      TrackingKernelSums moved;
      TrackingKernelBaseline(c.input, &moved);
      energy[side] = moved.energy;
    }
    // E = sum r^2, so dE/dx = 2 J^T r.
    EXPECT_NEAR((energy[1] - energy[0]) / (2.0 * h), 2.0 * sums.b[i], 5e-3 * std::abs(sums.b[i]) + 20.0)
        << "unknown " << i;
  }
}

TEST(TrackingKernel, HessianIsSymmetricAndPositive) {
  TrackingCase c(false);
  c.Set(kPose, 0.0, 0.0);
  TrackingKernelSums sums;
  TrackingKernelBaseline(c.input, &sums);
  for (int r = 0; r < 8; ++r) {
    EXPECT_GT(sums.h[9 * r], 0.0f);
    for (int k = 0; k < 8; ++k) EXPECT_EQ(sums.h[8 * r + k], sums.h[8 * k + r]);
  }
  EXPECT_FLOAT_EQ(sums.h[63], 203.0f);  // d r / d offset is -1
}

TEST(TrackingKernel, EveryLevelEqualsTheBaseline) {
  // One register of the widest level is left half empty.
  TrackingCase c(true);
  c.Set(kPose, 0.1, 3.0);
  c.input.count = 200;
  TrackingKernelSums a, b;
  TrackingKernelBaseline(c.input, &a);
  for (const SimdLevel level : SupportedSimdLevels()) {
    TrackingKernelFor(level)(c.input, &b);
    EXPECT_EQ(a.visible, b.visible) << ToString(level);
    EXPECT_EQ(a.saturated, b.saturated) << ToString(level);
    EXPECT_NEAR(a.energy, b.energy, 1e-4 * a.energy) << ToString(level);
    for (int i = 0; i < 64; ++i) {
      EXPECT_NEAR(a.h[i], b.h[i], 2e-4 * std::sqrt(a.h[9 * (i / 8)] * a.h[9 * (i % 8)])) << ToString(level) << i;
    }
    for (int i = 0; i < 8; ++i) {
      EXPECT_NEAR(a.b[i], b.b[i], 2e-4 * std::sqrt(a.h[9 * i] * a.energy)) << ToString(level) << i;
    }
  }
}

TEST(ResidualKernel, EveryLevelEqualsTheBaselineAndKnowsTheBorder) {
  Random random(5);
  const TrackingCase c(true);
  float color[kPatternSize], weight[kPatternSize];
  PairProjection pair;
  pair.warp[0] = pair.warp[4] = pair.warp[8] = 1.0f;
  pair.shift[0] = 3.0f, pair.shift[1] = -1.0f;
  pair.gain = 1.1f, pair.linear_gain = 1.05f, pair.offset = 2.0f, pair.host_offset = 1.0f;
  ResidualKernelInput input;
  input.color = color, input.weight = weight, input.pair = &pair;
  input.image = c.image.data(), input.width = 160, input.height = 120;
  int inside = 0;
  for (int i = 0; i < 200; ++i) {
    for (int k = 0; k < kPatternSize; ++k) {
      color[k] = static_cast<float>(random.Uniform(0.0, 100.0));
      weight[k] = static_cast<float>(random.Uniform(0.1, 1.0));
    }
    input.x = static_cast<float>(random.Uniform(-5.0, 165.0));
    input.y = static_cast<float>(random.Uniform(-5.0, 125.0));
    input.inverse_depth = static_cast<float>(random.Uniform(0.1, 2.0));
    ResidualSums a, b;
    ResidualKernelBaseline(input, &a);
    const double u = input.x + 3.0 * input.inverse_depth, v = input.y - input.inverse_depth;
    const bool out = u < 3.0 || v < 3.0 || u > 156.0 || v > 116.0;
    EXPECT_FALSE(a.inside && out);
    inside += a.inside;
    for (const SimdLevel level : SupportedSimdLevels()) {
      ResidualKernelFor(level)(input, &b);
      ASSERT_EQ(a.inside, b.inside);
      if (!a.inside) continue;
      EXPECT_NEAR(a.energy, b.energy, 1e-3 * a.energy);
      EXPECT_NEAR(a.gxx, b.gxx, 1e-3 * a.gxx);
      EXPECT_NEAR(a.gyy, b.gyy, 1e-3 * a.gyy);
      EXPECT_NEAR(a.gxy, b.gxy, 1e-3 * std::sqrt(a.gxx * a.gyy));
      EXPECT_NEAR(a.gya, b.gya, 1e-3 * std::sqrt(a.gyy * a.aa));
      EXPECT_NEAR(a.gxb, b.gxb, 1e-3 * std::sqrt(a.gxx * a.bb));
      EXPECT_NEAR(a.gxr, b.gxr, 1e-3 * std::sqrt(a.gxx * a.energy) + 1e-2);
      EXPECT_NEAR(a.br, b.br, 1e-3 * std::sqrt(a.bb * a.energy) + 1e-2);
      EXPECT_NEAR(a.aa, b.aa, 1e-3 * a.aa);
    }
  }
  EXPECT_GT(inside, 100);
}

TEST(ImagePyramid, HalvesAndDifferentiates) {
  const Pinhole camera = testing::TestCamera();
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, false, 6, 400);
  EXPECT_EQ(geometry.camera[0].width_px, 192);
  EXPECT_DOUBLE_EQ(geometry.camera[0].cx_px, (191.5 + 0.5) / 2 - 0.5);
  EXPECT_GE(geometry.levels, 3);
  Frame frame;
  frame.image.create(288, 384, CV_8UC1);
  for (int y = 0; y < 288; ++y) {
    for (int x = 0; x < 384; ++x) frame.image.at<unsigned char>(y, x) = static_cast<unsigned char>(x / 4 + y / 4);
  }
  ImagePyramid pyramid;
  pyramid.Build(frame, geometry);
  const float mean = 0.25f * (10 / 4 + 6 / 4 + 11 / 4 + 6 / 4 + 10 / 4 + 7 / 4 + 11 / 4 + 7 / 4);
  EXPECT_FLOAT_EQ(pyramid.At(0, 5, 3)[0], mean);
  const float* p = pyramid.At(1, 20, 30);
  EXPECT_FLOAT_EQ(p[1], 0.5f * (pyramid.At(1, 21, 30)[0] - pyramid.At(1, 19, 30)[0]));
  EXPECT_FLOAT_EQ(p[2], 0.5f * (pyramid.At(1, 20, 31)[0] - pyramid.At(1, 20, 29)[0]));
  // A corrected image of the same values gives the same pyramid.
  ImagePyramid corrected;
  frame.image.convertTo(frame.corrected, CV_32F);
  corrected.Build(frame, geometry);
  for (int x = 0; x < 192; ++x) EXPECT_EQ(pyramid.At(0, x, 50)[0], corrected.At(0, x, 50)[0]);
}

TEST(CoarseTracker, FindsAKnownMotionAndGain) {
  const testing::Scene scene;
  const Pinhole camera = testing::TestCamera();
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, false, 6, 400);
  const SE3 world_from_a, world_from_b(ExpSO3(Vector3d(0.01, -0.02, 0.015)), Vector3d(0.06, 0.02, 0.05));
  ImagePyramid a;
  FrameData b;
  a.Build(scene.Render(camera, world_from_a, 0), geometry);
  b.frame = scene.Render(camera, world_from_b, 1, 1.2);
  b.pyramid.Build(b.frame, geometry);
  std::vector<ReferencePoint> points;
  for (int y = 6; y < 138; y += 5) {
    for (int x = 6; x < 186; x += 5) {
      const double depth = scene.Depth(geometry.camera[0], world_from_a, Vector2d(x, y));
      points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(1.0 / depth), 1.0f});
    }
  }
  CoarseTracker tracker(geometry, 9.0, 20.0);
  TrackingReference reference;
  tracker.BuildReference(a, points, &reference);
  const double never[kMaxLevels] = {};
  double rms[kMaxLevels];
  const TrackingOutcome outcome = tracker.Align(reference, b, {}, {}, {}, never, rms);
  ASSERT_TRUE(outcome.converged);
  const SE3 error = outcome.new_from_reference * (world_from_b.Inverse() * world_from_a).Inverse();
  EXPECT_LT(error.translation().norm(), 0.003);
  EXPECT_LT(AngleRad(error.rotation()), 0.001);
  EXPECT_NEAR(std::exp(outcome.light.a), 1.2, 0.03);
  // A strong prior holds the gain; with the exposure known there is nothing left for it.
  const LightPrior strong{1e12, 1e12};
  const TrackingOutcome held = tracker.Align(reference, b, {}, {}, strong, never, rms);
  EXPECT_NEAR(held.light.a, 0.0, 1e-3);
  EXPECT_GT(held.rms_gray, 1.5 * outcome.rms_gray);
  reference.exposure_gain = 1.0;
  b.frame.exposure_gain = 1.2;
  const TrackingOutcome known = tracker.Align(reference, b, {}, {}, strong, never, rms);
  EXPECT_LT(known.rms_gray, 1.1 * outcome.rms_gray);
  EXPECT_NEAR(known.light.a, 0.0, 1e-3);
  EXPECT_GT(outcome.good_share, 0.8);
  EXPECT_GT(outcome.flow_px, 1.0);
}

// Vertical stripes and noise: nothing in the image tells how far the camera moved along them.
TEST(CoarseTracker, FollowsThePredictionWhereTheImageIsSilent) {
  const Pinhole camera = testing::TestCamera();
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, false, 6, 400);
  Random random(5);
  const auto render = [&](double shift_px, std::int64_t index) {
    Frame frame;
    frame.index = index;
    frame.image.create(camera.height_px, camera.width_px, CV_8UC1);
    for (int y = 0; y < camera.height_px; ++y) {
      for (int x = 0; x < camera.width_px; ++x) {
        const double value =
            40.0 + 150.0 * testing::ValueNoise(0.08 * (x - shift_px), 0.0, 3) + random.Normal(0.0, 5.0);
        frame.image.at<unsigned char>(y, x) = static_cast<unsigned char>(std::clamp(value, 0.0, 255.0));
      }
    }
    return frame;
  };
  ImagePyramid a;
  FrameData b;
  a.Build(render(0.0, 0), geometry);
  b.frame = render(3.0, 1);
  b.pyramid.Build(b.frame, geometry);
  std::vector<ReferencePoint> points;
  for (int y = 6; y < 138; y += 7) {
    for (int x = 6; x < 186; x += 7) points.push_back({static_cast<float>(x), static_cast<float>(y), 1.0f, 1.0f});
  }
  CoarseTracker tracker(geometry, 9.0, 20.0);
  TrackingReference reference;
  tracker.BuildReference(a, points, &reference);
  EXPECT_NEAR(reference.mean_inverse_depth, 1.0, 1e-6);
  const double never[kMaxLevels] = {};
  double rms[kMaxLevels];
  const SE3 predicted(Quaterniond::Identity(), Vector3d(0.0, 0.02, 0.0));
  const auto off_px = [&](double sigma_px) {
    const TrackingOutcome outcome = tracker.Align(reference, b, {predicted, sigma_px}, {}, {}, never, rms);
    const Vector2d moved = camera.Project(outcome.new_from_reference * Vector3d(0.0, 0.0, 1.0));
    EXPECT_NEAR(moved.x() - camera.cx_px, 3.0, 0.3) << sigma_px;  // across the stripes the image decides
    return std::abs(moved.y() - camera.cy_px - camera.fy_px * 0.02);
  };
  const double free_px = off_px(0.0), held_px = off_px(2.0);
  EXPECT_LT(held_px, 0.5);
  EXPECT_GT(free_px, 2.0 * held_px);
}

}  // namespace
}  // namespace cairn::direct
