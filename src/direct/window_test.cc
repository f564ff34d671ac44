#include "direct/window.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "base/random.h"
#include "direct/point_tracer.h"
#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

const PyramidGeometry& Geometry() {
  static const PyramidGeometry geometry = PyramidGeometry::Make(testing::TestCamera(), false, 6, 400);
  return geometry;
}

WindowOptions SquaredLoss() {
  WindowOptions options;
  options.huber_gray = 1e5;
  options.outlier_gray = 1e4;
  options.min_marginalization_hessian = 0.0;
  return options;
}

// Keyframes with linear images (derivatives by interpolation are exact there) and points with all residuals.
void FillWindow(int keyframes, int points_per_keyframe, Window* window) {
  Random random(11);
  for (int k = 0; k < keyframes; ++k) {
    auto data = std::make_shared<FrameData>();
    data->frame.corrected.create(288, 384, CV_32FC1);
    const double dx = random.Uniform(-0.3, 0.3), dy = random.Uniform(-0.3, 0.3);
    for (int y = 0; y < 288; ++y) {
      for (int x = 0; x < 384; ++x) data->frame.corrected.at<float>(y, x) = static_cast<float>(100.0 + dx * x + dy * y);
    }
    data->pyramid.Build(data->frame, Geometry());
    auto keyframe = std::make_unique<Keyframe>();
    keyframe->id = k;
    keyframe->data = data;
    keyframe->camera_from_direct = SE3(ExpSO3(Vector3d(0.01 * k, random.Uniform(-0.02, 0.02), 0.01)),
                                       Vector3d(0.05 * k, 0.02 * k * k, random.Uniform(-0.05, 0.05)));
    keyframe->light = {0.05 * k, 1.5 * k};
    keyframe->own_prior[6] = 1e3, keyframe->own_prior[7] = 10.0;
    window->AddKeyframe(std::move(keyframe));
  }
  for (int k = 0; k < keyframes; ++k) {
    for (int i = 0; i < points_per_keyframe; ++i) {
      ActivePoint point;
      point.host = k;
      point.x = static_cast<float>(40 + random.Below(110)), point.y = static_cast<float>(40 + random.Below(60));
      point.inverse_depth = static_cast<float>(random.Uniform(0.3, 1.0));
      point.good_residuals = 5;
      for (int p = 0; p < kPatternSize; ++p) {
        point.color[p] = static_cast<float>(random.Uniform(80.0, 120.0));
        point.weight[p] = static_cast<float>(random.Uniform(0.3, 1.0));
      }
      for (int t = 0; t < keyframes; ++t) {
        if (t != k) point.residuals[t].state = ResidualState::kGood;
      }
      window->AddPoint(point);
    }
  }
}

TEST(Window, GradientMatchesDifferences) {
  Window window(Geometry(), SquaredLoss());
  FillWindow(3, 12, &window);
  // All pixels of a pattern share the Jacobian of its centre: exact only for the centre itself.
  for (ActivePoint& point : window.points()) {
    for (int p = 0; p < kPatternSize; ++p) {
      if (kPatternX[p] != 0.0f || kPatternY[p] != 0.0f) point.weight[p] = 0.0f;
    }
  }
  const Window::DenseSystem system = window.Linearize();
  for (int k = 0; k < 3; ++k) {
    for (int i = 0; i < kFrameUnknowns; ++i) {
      const double h = i < 6 ? 1e-3 : i == 6 ? 1e-2 : 0.5;
      const SE3 pose = window.keyframe(k).camera_from_direct;
      const AffineLight light = window.keyframe(k).light;
      double energy[2];
      for (int side = 0; side < 2; ++side) {
        Vector8d step = Vector8d::Zero();
        step[i] = side == 0 ? -h : h;
        window.keyframe(k).camera_from_direct = SE3::Exp(step.head<6>()) * pose;
        window.keyframe(k).light = {light.a + step[6], light.b + step[7]};
        energy[side] = window.Linearize().energy;
      }
      window.keyframe(k).camera_from_direct = pose;
      window.keyframe(k).light = light;
      const double analytic = 2.0 * system.b[kFrameUnknowns * k + i];
      EXPECT_NEAR((energy[1] - energy[0]) / (2.0 * h), analytic, 0.02 * std::abs(analytic) + 1e-3 * system.energy)
          << "keyframe " << k << " unknown " << i;
    }
  }
  for (std::size_t p = 0; p < window.points().size(); ++p) {
    const float depth = window.points()[p].inverse_depth, h = 2e-2f;
    window.points()[p].inverse_depth = depth - h;
    const double low = window.Linearize().energy;
    window.points()[p].inverse_depth = depth + h;
    const double high = window.Linearize().energy;
    window.points()[p].inverse_depth = depth;
    const double analytic = 2.0 * system.b[3 * kFrameUnknowns + static_cast<Eigen::Index>(p)];
    EXPECT_NEAR((high - low) / (2.0 * h), analytic, 0.03 * std::abs(analytic) + 2e-4 * system.energy) << "point " << p;
  }
}

TEST(Window, SchurStepEqualsDenseStep) {
  Window window(Geometry(), SquaredLoss());
  FillWindow(4, 30, &window);
  const Window::DenseSystem system = window.Linearize();
  const double damping = 1e-2;
  Eigen::MatrixXd h = system.h;
  h.diagonal() *= 1.0 + damping;
  h.topLeftCorner(32, 32) += system.gauge;
  const Eigen::VectorXd dense = -h.fullPivLu().solve(system.b);
  const Eigen::VectorXd schur = window.SchurStep(damping);
  ASSERT_EQ(dense.size(), schur.size());
  EXPECT_LT((dense - schur).norm(), 1e-5 * dense.norm());
}

TEST(Window, MarginalizationEqualsEliminationFromTheWholeProblem) {
  Window window(Geometry(), SquaredLoss());
  FillWindow(4, 30, &window);
  const Window::DenseSystem whole = window.Linearize();
  const int frames = 32, points = 120, gone_points = 30;
  // Order: what stays (keyframes 1 to 3, their points), what goes (keyframe 0, its points).
  std::vector<int> order;
  for (int i = 8; i < frames; ++i) order.push_back(i);
  for (int i = gone_points; i < points; ++i) order.push_back(frames + i);
  const int stays = static_cast<int>(order.size());
  for (int i = 0; i < 8; ++i) order.push_back(i);
  for (int i = 0; i < gone_points; ++i) order.push_back(frames + i);
  const int all = static_cast<int>(order.size()), goes = all - stays;
  Eigen::MatrixXd h(all, all);
  Eigen::VectorXd b(all);
  for (int r = 0; r < all; ++r) {
    b[r] = whole.b[order[r]];
    for (int c = 0; c < all; ++c) h(r, c) = whole.h(order[r], order[c]);
  }
  // Points of the others keep no residual in keyframe 0: it goes from the problem too.
  for (ActivePoint& point : window.points()) {
    if (point.host != 0) point.residuals[0].state = ResidualState::kNone;
  }
  const Window::DenseSystem kept = window.Linearize();
  for (int r = 0; r < all; ++r) {
    b[r] = kept.b[order[r]];
    for (int c = 0; c < all; ++c) h(r, c) = kept.h(order[r], order[c]);
  }
  const Eigen::MatrixXd inverse = h.bottomRightCorner(goes, goes).inverse();
  const Eigen::MatrixXd reduced =
      h.topLeftCorner(stays, stays) - h.topRightCorner(stays, goes) * inverse * h.bottomLeftCorner(goes, stays);
  const Eigen::VectorXd reduced_b = b.head(stays) - h.topRightCorner(stays, goes) * inverse * b.tail(goes);

  window.MarginalizePoints({true, false, false, false});
  ASSERT_EQ(window.points().size(), 90u);
  EXPECT_EQ(window.keyframe(0).settled.size(), 30u);
  EXPECT_TRUE(window.keyframe(2).in_prior);
  window.MarginalizeKeyframe(0);
  ASSERT_EQ(window.size(), 3);
  const Window::DenseSystem after = window.Linearize();
  EXPECT_LT((after.h - reduced).norm(), 1e-5 * reduced.norm());
  EXPECT_LT((after.b - reduced_b).norm(), 1e-5 * reduced_b.norm());
}

// What the prior says about a state away from the linearization point: its gradient moves with H.
TEST(Window, FirstEstimatesStayWhereThePriorWasTaken) {
  Window window(Geometry(), SquaredLoss());
  FillWindow(4, 30, &window);
  window.MarginalizePoints({true, false, false, false});
  window.MarginalizeKeyframe(0);
  const SE3 linear = window.keyframe(0).linear_camera_from_direct;
  window.Optimize(3);
  EXPECT_LT((window.keyframe(0).linear_camera_from_direct.translation() - linear.translation()).norm(), 1e-15);
  const SE3 current = SE3::Exp(window.keyframe(0).delta.head<6>()) * linear;
  EXPECT_LT((current.translation() - window.keyframe(0).camera_from_direct.translation()).norm(), 1e-12);
}

TEST(Window, FindsPosesAndDepthsOfAKnownScene) {
  const testing::Scene scene;
  const Pinhole& camera = Geometry().camera[0];
  Window window(Geometry(), WindowOptions());
  Random random(2);
  std::vector<SE3> truth;
  for (int k = 0; k < 4; ++k) {
    truth.push_back(testing::SwayPose(8.0 * k));
    auto data = std::make_shared<FrameData>();
    data->frame = scene.Render(testing::TestCamera(), truth.back(), k);
    data->pyramid.Build(data->frame, Geometry());
    auto keyframe = std::make_unique<Keyframe>();
    keyframe->data = data;
    const Vector3d turn(random.Normal(), random.Normal(), random.Normal()),
        shift(random.Normal(), random.Normal(), random.Normal());
    keyframe->camera_from_direct = SE3(ExpSO3(k > 1 ? (0.002 * turn).eval() : Vector3d::Zero()),
                                       k > 1 ? (0.006 * shift).eval() : Vector3d::Zero()) *
                                   truth.back().Inverse();
    if (k == 0) keyframe->own_prior[6] = 1e10, keyframe->own_prior[7] = 1e6;
    window.AddKeyframe(std::move(keyframe));
  }
  std::vector<float> true_depth;
  ImmaturePoint candidate;
  for (int k = 0; k < 2; ++k) {
    for (int y = 8; y < 136; y += 8) {
      for (int x = 8; x < 184; x += 8) {
        if (!MakeImmaturePoint(window.keyframe(k).data->pyramid, x, y, 50.0, 12.0, &candidate)) continue;
        if (candidate.gradient_xx + candidate.gradient_yy < 200.0f) continue;
        ActivePoint point;
        point.host = k, point.x = candidate.x, point.y = candidate.y;
        std::copy(candidate.color, candidate.color + kPatternSize, point.color);
        std::copy(candidate.weight, candidate.weight + kPatternSize, point.weight);
        true_depth.push_back(static_cast<float>(1.0 / scene.Depth(camera, truth[k], Vector2d(x, y))));
        point.inverse_depth = true_depth.back() * static_cast<float>(1.0 + 0.05 * random.Normal());
        for (int t = 0; t < 4; ++t) {
          if (t != k) point.residuals[t].state = ResidualState::kGood;
        }
        window.AddPoint(point);
      }
    }
  }
  ASSERT_GT(window.points().size(), 200u);
  const OptimizationReport report = window.Optimize(20);
  EXPECT_LT(report.rms_gray, 3.0);
  // Up to scale: compare with the scale of the depths.
  double ratio = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < true_depth.size(); ++i) {
    if (window.points()[i].hessian > 2000.0f) ratio += window.points()[i].inverse_depth / true_depth[i], ++count;
  }
  ASSERT_GT(count, 100);
  ratio /= count;
  const SE3 world_from_last = truth[3];
  const SE3 estimate = window.keyframe(0).camera_from_direct * window.keyframe(3).camera_from_direct.Inverse();
  const SE3 expected = truth[0].Inverse() * world_from_last;
  EXPECT_LT((estimate.translation() * ratio - expected.translation()).norm(), 0.004);
  EXPECT_LT(AngleRad(estimate.rotation().conjugate() * expected.rotation()), 0.001);
}

TEST(PointTracer, FindsTheDepthOfAKnownScene) {
  const testing::Scene scene;
  const Pinhole& camera = Geometry().camera[0];
  const SE3 a = testing::SwayPose(0);
  FrameData host;
  host.frame = scene.Render(testing::TestCamera(), a, 0);
  host.pyramid.Build(host.frame, Geometry());
  std::vector<ImmaturePoint> points;
  ImmaturePoint point;
  for (int y = 10; y < 134; y += 9) {
    for (int x = 10; x < 182; x += 9) {
      if (MakeImmaturePoint(host.pyramid, x, y, 50.0, 12.0, &point) && point.gradient_xx > 400.0f)
        points.push_back(point);
    }
  }
  ASSERT_GT(points.size(), 60u);
  for (int t = 2; t <= 16; t += 2) {
    FrameData target;
    target.frame = scene.Render(testing::TestCamera(), testing::SwayPose(t), t);
    target.pyramid.Build(target.frame, Geometry());
    const PairProjection pair = MakePairProjection(camera, testing::SwayPose(t).Inverse() * a, 1.0, 0.0, 0.0);
    for (ImmaturePoint& p : points) TracePoint(target.pyramid, pair, TraceOptions(), &p);
  }
  int known = 0, right = 0;
  for (const ImmaturePoint& p : points) {
    if (p.max_inverse_depth < 0.0f || p.good_traces == 0) continue;
    ++known;
    const double truth = 1.0 / scene.Depth(camera, a, Vector2d(p.x, p.y));
    right += std::abs(0.5 * (p.min_inverse_depth + p.max_inverse_depth) - truth) < 0.15 * truth;
  }
  EXPECT_GT(known, static_cast<int>(points.size()) * 7 / 10);
  EXPECT_GT(right, known * 8 / 10);
}

}  // namespace
}  // namespace cairn::direct
