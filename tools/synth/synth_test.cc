#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "io/frame_source.h"
#include "io/trajectory.h"
#include "synth/materials.h"
#include "synth/overlap.h"
#include "synth/sequence.h"
#include "synth/texture.h"
#include "synth/walk.h"
#include "synth/write.h"

namespace cairn::synth {
namespace {

SequenceOptions Small() {
  SequenceOptions o;
  o.world.texels_per_m = 120;
  o.camera = Camera::FromPinhole({320, 240, 210, 210, 159.5, 119.5});
  o.max_duration_s = 2.0;
  o.rate_hz = 10;
  return o;
}

// One world for all tests of it.
const Sequence& Office() {
  static const auto* const kSequence = new absl::StatusOr<Sequence>(Sequence::Create(Small()));
  return **kSequence;
}

bool SameBytes(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

TEST(Texture, ConstantStaysAndMeanSurvivesReduction) {
  const Texture flat(cv::Mat(37, 53, CV_8UC1, cv::Scalar(77)));
  EXPECT_NEAR(flat.Sample(10.3f, 20.1f, 1, 0, 0, 1), 77, 1e-3);
  EXPECT_NEAR(flat.Sample(10.3f, 20.1f, 9, 3, -1, 12), 77, 1e-3);
  cv::Mat checks(64, 64, CV_8UC1);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) checks.at<std::uint8_t>(y, x) = (x + y) % 2 == 0 ? 0 : 200;
  }
  const Texture texture(checks);
  EXPECT_NEAR(texture.Sample(0.5f, 0.5f, 0.1f, 0, 0, 0.1f), 0, 1e-3);  // magnified: the texel itself
  EXPECT_NEAR(texture.Sample(1.5f, 0.5f, 0.1f, 0, 0, 0.1f), 200, 1e-3);
  EXPECT_NEAR(texture.Sample(30.2f, 31.7f, 8, 0, 0, 8), 100, 2);  // reduced: the mean, no aliasing
  EXPECT_NEAR(texture.Sample(30.2f, 31.7f, 8, 0, 0, 2), 100, 2);
}

TEST(Materials, SeededDistinctAndFullOfGradients) {
  for (int m = 0; m <= static_cast<int>(Material::kStripes); ++m) {
    const auto material = static_cast<Material>(m);
    const cv::Mat a = MakeMaterial(material, 0.8, 0.6, 150, 5);
    EXPECT_TRUE(SameBytes(a, MakeMaterial(material, 0.8, 0.6, 150, 5))) << m;
    const cv::Mat b = MakeMaterial(material, 0.8, 0.6, 150, 6);
    EXPECT_FALSE(SameBytes(a, b)) << m;
    cv::Mat dx;
    cv::Sobel(a, dx, CV_32F, 1, 0);
    const double strength = cv::norm(dx, cv::NORM_L1) / static_cast<double>(a.total());
    if (material == Material::kBlank) {
      EXPECT_LT(strength, 3.0);
    } else if (material == Material::kStripes) {
      EXPECT_GT(strength, 0.8) << "gentle slopes, but everywhere";
    } else {
      EXPECT_GT(strength, 5.0) << m;
    }
  }
}

TEST(Sequence, SameOptionsSameImages) {
  const auto again = Sequence::Create(Small());
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(Office().size(), 21);
  EXPECT_TRUE(SameBytes(Office().Render(7), again->Render(7)));
  SequenceOptions other = Small();
  other.world.seed = 2;
  EXPECT_FALSE(SameBytes(Office().Render(7), Sequence::Create(other)->Render(7)));
}

TEST(Sequence, ThreadsDoNotChangeTheWorld) {
  SequenceOptions one = Small();
  one.world.threads = 1;
  EXPECT_TRUE(SameBytes(Office().Render(3), Sequence::Create(one)->Render(3)));
}

TEST(Sequence, DepthAgreesWithTheWorld) {
  const SE3 pose = Office().WorldFromCamera(4);
  const cv::Mat depth = Office().Depth(4);
  int checked = 0;
  for (int y = 3; y < 240; y += 17) {
    for (int x = 5; x < 320; x += 23) {
      const Vector3d ray = *Office().options().camera.Unproject({x, y});
      const auto hit = Office().world().Cast(pose.translation(), pose.rotation() * ray);
      ASSERT_TRUE(hit.has_value());
      const double z = (pose.Inverse() * hit->point_w).z();
      if (std::abs(z - depth.at<float>(y, x)) < 1e-3) ++checked;
    }
  }
  EXPECT_GE(checked, 14 * 14 - 3);  // a ray along an edge may fall on either side
}

// The point that a pixel shows is shown alike where another image's pose and depth say it is: poses, depths and images
// belong together, to a fraction of a pixel.
TEST(Sequence, ImagesAgreeThroughPosesAndDepths) {
  const int from = 2, to = 6;
  cv::Mat a = Office().Render(from), b = Office().Render(to);
  const cv::Mat depth_a = Office().Depth(from), depth_b = Office().Depth(to);
  const SE3 b_from_a = Office().WorldFromCamera(to).Inverse() * Office().WorldFromCamera(from);
  const Pinhole pinhole = Office().options().camera.Intrinsics();
  const auto mean_difference = [&](const Vector2d& shift) {
    double sum = 0;
    int count = 0;
    for (int y = 8; y < 232; y += 3) {
      for (int x = 8; x < 312; x += 3) {
        const Vector3d p = b_from_a * Vector3d(depth_a.at<float>(y, x) * pinhole.Unproject({x, y}));
        if (p.z() < 0.1) continue;
        const Vector2d q = pinhole.Project(p) + shift;
        if (!pinhole.Contains(q, 3)) continue;
        const int qx = static_cast<int>(q.x()), qy = static_cast<int>(q.y());
        if (std::abs(depth_b.at<float>(qy, qx) - p.z()) > 0.02 ||
            std::abs(depth_b.at<float>(qy + 1, qx + 1) - p.z()) > 0.02)
          continue;
        cv::Mat patch;
        cv::getRectSubPix(b, cv::Size(1, 1), cv::Point2f(static_cast<float>(q.x()), static_cast<float>(q.y())), patch);
        sum += std::abs(patch.at<std::uint8_t>(0, 0) - a.at<std::uint8_t>(y, x));
        ++count;
      }
    }
    EXPECT_GT(count, 2000);
    return sum / count;
  };
  const double exact = mean_difference({0, 0});
  EXPECT_LT(exact, 4.0);
  for (const Vector2d& shift : {Vector2d(0.5, 0), Vector2d(-0.5, 0), Vector2d(0, 0.5), Vector2d(0, -0.5)}) {
    EXPECT_LT(exact, mean_difference(shift));
  }
}

TEST(Sequence, MotionIsSmoothAndSessionsDiffer) {
  for (const std::string& name : PresetNames()) {
    const auto options = Preset(name);
    ASSERT_TRUE(options.ok());
    const double max_turn_rad = name == "spin" ? 0.25 : 0.09;  // that one begins with a fast turn
    for (const int session : {0, 1}) {
      TrajectoryOptions t = options->trajectory;
      t.session = session;
      const auto path = Trajectory::Create(options->world, t);
      ASSERT_TRUE(path.ok());
      for (double s = 0; s < path->duration_s(); s += 0.05) {
        const SE3 a = path->Pose(s), b = path->Pose(s + 0.05);
        EXPECT_LT((a.translation() - b.translation()).norm(), 0.1) << name << " " << s;
        EXPECT_LT(AngleRad(a.rotation().conjugate() * b.rotation()), max_turn_rad) << name << " " << s;
        // Inside, and upright.
        EXPECT_GT(a.translation().minCoeff(), 0.3) << name << " " << s;
        EXPECT_GT((options->world.size_m - a.translation()).minCoeff(), 0.3) << name << " " << s;
        EXPECT_LT((a.rotation() * Vector3d::UnitY()).z(), -0.7);
      }
    }
    TrajectoryOptions second = options->trajectory;
    second.session = 1;
    const auto a = Trajectory::Create(options->world, options->trajectory),
               b = Trajectory::Create(options->world, second);
    EXPECT_GT((a->Pose(1).translation() - b->Pose(1).translation()).norm(), 0.05);
  }
  EXPECT_EQ(Preset("castle").status().code(), absl::StatusCode::kNotFound);
}

TEST(Trajectory, TurningStaysWithinAHandsBreadth) {
  const auto options = Preset("turning");
  const auto path = Trajectory::Create(options->world, options->trajectory);
  Eigen::AlignedBox3d extent;
  double turned_rad = 0.0;
  for (double s = 0; s < path->duration_s(); s += 0.1) {
    extent.extend(path->Pose(s).translation());
    turned_rad = std::max(turned_rad, AngleRad(path->Pose(0).rotation().conjugate() * path->Pose(s).rotation()));
  }
  EXPECT_LT(extent.sizes().maxCoeff(), 0.16);
  EXPECT_GT(turned_rad, 0.9);
}

TEST(Trajectory, AtTheDeskIsStillWhereItSaysAndSmooth) {
  TrajectoryOptions options;
  options.motion = Motion::kDesk;
  options.tremor = 0.0;
  const auto trajectory = Trajectory::Create(WorldOptions(), options);
  ASSERT_TRUE(trajectory.ok());
  double fastest_m_s = 0.0, fastest_still_m_s = 0.0;
  for (double t = 0.0; t < kDeskDuration_s; t += 0.01) {
    const double m_s = (trajectory->Pose(t + 0.01).translation() - trajectory->Pose(t).translation()).norm() / 0.01;
    fastest_m_s = std::max(fastest_m_s, m_s);
    for (const auto& still : kDeskStill_s) {
      if (t > still[0] + 0.3 && t < still[1] - 0.3) fastest_still_m_s = std::max(fastest_still_m_s, m_s);
    }
  }
  EXPECT_LT(fastest_still_m_s, 1e-9);
  EXPECT_GT(fastest_m_s, 0.1);
  EXPECT_LT(fastest_m_s, 0.6) << "no jumps";
}

TEST(Trajectory, SpinTurnsFastAndHardlyMovesAtFirst) {
  TrajectoryOptions options;
  options.motion = Motion::kSpin;
  const auto trajectory = Trajectory::Create(WorldOptions(), options);
  ASSERT_TRUE(trajectory.ok());
  double fastest_rad_s = 0.0, farthest_m = 0.0, jump_m = 0.0;
  const SE3 start = trajectory->Pose(0.0);
  for (double t = 0.0; t < kSpin_s + 2.0; t += 0.02) {
    const SE3 step = trajectory->Pose(t).Inverse() * trajectory->Pose(t + 0.02);
    jump_m = std::max(jump_m, step.translation().norm());
    if (t >= kSpin_s) continue;
    fastest_rad_s = std::max(fastest_rad_s, AngleRad(step.rotation()) / 0.02);
    farthest_m = std::max(farthest_m, (trajectory->Pose(t).translation() - start.translation()).norm());
  }
  EXPECT_GT(fastest_rad_s, 2.0);
  EXPECT_LT(farthest_m, 0.2);
  EXPECT_LT(jump_m, 0.02);
  WorldOptions corridor;
  corridor.kind = WorldKind::kCorridor;
  EXPECT_FALSE(Trajectory::Create(corridor, options).ok());
}

TEST(Arm, HidesAboutItsShareAndMovesOnItsOwn) {
  SequenceOptions with = Small();
  with.arm_share = 0.2;
  const auto sequence = Sequence::Create(with);
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  double share = 0.0, moved = 0.0;
  cv::Mat before;
  for (int frame = 0; frame < 4; ++frame) {
    const cv::Mat hidden = sequence->Depth(frame) < Office().Depth(frame) - 0.01;
    share += cv::countNonZero(hidden) / (4.0 * static_cast<double>(hidden.total()));
    const cv::Mat differs = sequence->Render(frame) != Office().Render(frame);
    EXPECT_EQ(cv::countNonZero(differs & ~hidden), 0) << "what it does not hide stays";
    EXPECT_GT(cv::countNonZero(differs), 0.8 * cv::countNonZero(hidden));
    if (!before.empty()) moved += cv::countNonZero(before != hidden) / (3.0 * static_cast<double>(hidden.total()));
    before = hidden;
  }
  EXPECT_NEAR(share, 0.2, 0.1);
  EXPECT_GT(moved, 0.005);
  with.arm_share = 0.9;
  EXPECT_FALSE(Sequence::Create(with).ok());
}

TEST(Walk, IsMeasuredAlongItsLength) {
  // Points on a circle of radius 2: a B-spline of many of them is that circle, a little smaller.
  std::vector<Walk::Waypoint> points;
  for (int i = 0; i < 40; ++i) points.push_back({2.0 * std::cos(0.1 * i), 2.0 * std::sin(0.1 * i), 0.01 * i});
  const Walk walk(points);
  EXPECT_NEAR(walk.length_m(), 2.0 * 0.1 * 37, 0.02);
  for (double at = 0.1; at < walk.length_m() - 0.2; at += 0.37) {
    const Walk::Step a = walk.At(at), b = walk.At(at + 0.1);
    EXPECT_NEAR((b.position - a.position).norm(), 0.1, 1e-3);
    EXPECT_NEAR(a.position.norm(), 2.0, 0.005);
    EXPECT_NEAR(a.ahead.dot(a.position), 0.0, 0.005);
    EXPECT_NEAR(b.look_rad - a.look_rad, 0.1 * 0.1 * 0.5, 1e-4);
  }
  EXPECT_NEAR((walk.At(-1.0).position - walk.At(0.0).position).norm(), 1.0, 1e-9);
}

TEST(Overlap, GrowsWhenOneWalksIntoTheOthersRoom) {
  SequenceOptions o = *Preset("rooms");
  o.world.texels_per_m = 20;
  o.rate_hz = 2;
  const auto first = Sequence::Create(o);
  EXPECT_GT((*SharedViews(*first, o))[4], 0.95) << "of a recording with itself";
  SequenceOptions other = o;
  other.trajectory.session = 1;
  const auto second = Sequence::Create(other);
  const auto shares = SharedViews(*second, o);
  ASSERT_TRUE(shares.ok()) << shares.status();
  ASSERT_EQ(shares->size(), static_cast<std::size_t>(second->size()));
  EXPECT_LT((*shares)[0], 0.01);
  EXPECT_LT((*shares)[shares->size() / 4], 0.05);
  EXPECT_GT(shares->back(), 0.5);
}

TEST(World, ACatalogueMakesRoomsAlikeButNotTheSame) {
  // Share of what stands in the second room that looks like something in the first.
  const auto alike = [](std::uint64_t catalogue) {
    WorldOptions o;
    o.texels_per_m = 40;
    o.catalogue = catalogue;
    o.seed = 11;
    const auto first = World::Create(o);
    o.seed = 12;
    const auto second = World::Create(o);
    const auto same = [&](const Quad& a, const Quad& b) {
      if (std::abs(a.size_u_m - b.size_u_m) > 1e-4 || std::abs(a.size_v_m - b.size_v_m) > 1e-4) return false;
      const Texture& ta = first->textures()[static_cast<std::size_t>(a.texture)];
      const Texture& tb = second->textures()[static_cast<std::size_t>(b.texture)];
      for (float share = 0.05f; share < 1.0f; share += 0.1f) {
        const float u = share * static_cast<float>(ta.width()), v = share * static_cast<float>(ta.height());
        if (ta.Sample(u, v, 1, 0, 0, 1) != tb.Sample(u, v, 1, 0, 0, 1)) return false;
      }
      return true;
    };
    double count = 0.0;
    for (const Quad& b : second->quads()) {
      count += std::any_of(first->quads().begin(), first->quads().end(), [&](const Quad& a) { return same(a, b); });
    }
    return count / static_cast<double>(second->quads().size());
  };
  EXPECT_LT(alike(0), 0.01);
  EXPECT_GT(alike(1), 0.08);  // of all rectangles, most of which are books, boxes and papers
  EXPECT_LT(alike(1), 0.8);
}

TEST(World, AliasedSidesAreTurnedCopies) {
  const auto difference = [](const char* preset, double time_s) {
    WorldOptions o = Preset(preset)->world;
    o.texels_per_m = 30;
    const auto world = World::Create(o);
    const auto renderer = Renderer::Create(*world, Camera::FromPinhole({160, 120, 100, 100, 79.5, 59.5}), {});
    const SE3 half_turn(ExpSO3(Vector3d(0, 0, std::numbers::pi)), Vector3d(o.size_m.x(), o.size_m.y(), 0));
    const SE3 here = Trajectory::Create(o, {})->Pose(time_s);
    cv::Mat each;
    cv::absdiff(renderer->Render(here), renderer->Render(half_turn * here), each);
    return cv::mean(each)[0];
  };
  EXPECT_LT(difference("aliasing", 4.0), 3.0);  // but for the far end, where the corridor turns
  EXPECT_GT(difference("corridor", 4.0), 10.0);
  EXPECT_GT(difference("aliasing", 48.0), 10.0);  // on a side along y
}

// FAST corners of the feature module's lowest threshold at a coarse scale and at full size, and pixels with a gradient.
TEST(World, ASoftSideHasGradientsButNextToNoCorners) {
  SequenceOptions o = *Preset("soft");
  const auto count = [&o](double time_s, int* corners, int* gradients) {
    const auto sequence = Sequence::Create(o);
    const cv::Mat image = sequence->Render(static_cast<int>(time_s * o.rate_hz));
    *corners = 0;
    for (const double scale : {1.0, 0.48}) {
      cv::Mat scaled;
      cv::resize(image, scaled, cv::Size(), scale, scale, cv::INTER_AREA);
      std::vector<cv::KeyPoint> found;
      cv::FAST(scaled, found, 7, true);
      *corners += static_cast<int>(found.size());
    }
    cv::Mat dx, dy, magnitude;
    cv::Sobel(image, dx, CV_32F, 1, 0, 3, 0.125);
    cv::Sobel(image, dy, CV_32F, 0, 1, 3, 0.125);
    cv::magnitude(dx, dy, magnitude);
    *gradients = cv::countNonZero(magnitude > 5.0);
  };
  int corners, gradients, rich_corners, rich_gradients;
  count(14.5, &corners, &gradients);
  o.world.soft_side = false;
  count(14.5, &rich_corners, &rich_gradients);
  EXPECT_LT(corners, 150);
  EXPECT_GT(rich_corners, 1000);
  EXPECT_GT(gradients, 10000);
}

TEST(Effects, EachChangesTheImageAsItShould) {
  const auto mean = [](const SequenceOptions& o, int frame) { return cv::mean(Sequence::Create(o)->Render(frame))[0]; };
  SequenceOptions base = Small();
  base.world.texels_per_m = 40;
  base.world.furniture_density = 0.3;
  base.exposure_s = 0.05;  // long enough to blur these small images
  const cv::Mat plain = Sequence::Create(base)->Render(5);
  for (const std::string& name : EffectNames()) {
    SequenceOptions o = base;
    ASSERT_TRUE(SetEffect(name, true, o).ok());
    ASSERT_TRUE(o.Validate().ok()) << name;
    const auto sequence = Sequence::Create(o);
    const cv::Mat image = sequence->Render(5);
    EXPECT_FALSE(SameBytes(plain, image)) << name;
    EXPECT_TRUE(SameBytes(image, sequence->Render(5))) << name;
    ASSERT_TRUE(SetEffect(name, false, o).ok());
    EXPECT_TRUE(SameBytes(plain, Sequence::Create(o)->Render(5))) << name;
  }
  EXPECT_EQ(SetEffect("rain", true, base).code(), absl::StatusCode::kNotFound);
  SequenceOptions dim = base;
  dim.effects.vignette = 0.8;
  EXPECT_LT(mean(dim, 5), mean(base, 5));
  // Noise has the promised size where nothing else differs.
  SequenceOptions noisy = base;
  noisy.effects.noise_dark = noisy.effects.noise_bright = 3.0;
  cv::Mat difference, a, b, deviation, average;
  plain.convertTo(a, CV_32F);
  Sequence::Create(noisy)->Render(5).convertTo(b, CV_32F);
  cv::meanStdDev(cv::Mat(b - a), average, deviation);
  EXPECT_NEAR(deviation.at<double>(0), 3.0, 0.2);
}

TEST(Effects, ResponseUndoneByItsInverse) {
  SequenceOptions o = Small();
  o.world.texels_per_m = 40;
  o.effects.gamma = 2.0;
  o.effects.white_level = 200;
  const auto curved = Sequence::Create(o);
  o.effects.gamma = 1.0;
  const cv::Mat linear = Sequence::Create(o)->Render(2), image = curved->Render(2);
  const auto inverse = curved->renderer().InverseResponse();
  for (int y = 0; y < 240; y += 11) {
    for (int x = 0; x < 320; x += 13) {
      EXPECT_NEAR(inverse[image.at<std::uint8_t>(y, x)], linear.at<std::uint8_t>(y, x), 2.0);
    }
  }
}

TEST(Options, BadOnesAreNamed) {
  const auto fails = [](auto change) {
    SequenceOptions o = Small();
    change(o);
    return Sequence::Create(o).status().code() == absl::StatusCode::kInvalidArgument;
  };
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.world.blank_share = 2; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.world.size_m.x() = -1; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.world.texels_per_m = NAN; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.world.kind = WorldKind::kRooms; }));  // too small for two
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.trajectory.laps = 0; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.camera.fx_px = 0; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.effects.gamma = 0; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.rate_hz = 0; }));
  EXPECT_TRUE(fails([](SequenceOptions& o) { o.exposure_s = 1; }));
}

class Written : public testing::TestWithParam<std::pair<DatasetFormat, CameraModel>> {
 protected:
  Written() : folder_(testing::TempDir() + "/cairn_synth_" + std::to_string(::getpid())) {}
  ~Written() override { std::filesystem::remove_all(folder_); }
  std::string folder_;
};

TEST_P(Written, ReadsBackWithPosesAndCalibration) {
  DatasetOptions o;
  o.sequence = Small();
  o.sequence.world.texels_per_m = 30;
  o.sequence.max_duration_s = 0.3;
  o.format = GetParam().first;
  for (const char* effect : {"vignette", "response", "exposure", "noise"}) {
    ASSERT_TRUE(SetEffect(effect, true, o.sequence).ok());
  }
  Camera& camera = o.sequence.camera;
  camera.model = GetParam().second;
  if (camera.model == CameraModel::kRadialTangential) camera.distortion = {-0.28, 0.07, 2e-4, 2e-5};
  if (camera.model == CameraModel::kKannalaBrandt) camera.distortion = {0.01, -0.002, 1e-3, -1e-4};
  if (camera.model == CameraModel::kFov) camera.distortion = {0.9};
  int heard = 0;
  const absl::Status status = GenerateDataset(o, folder_, [&](int done, int total) {
    EXPECT_EQ(total, 4);
    heard = done;
    return true;
  });
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_EQ(heard, 4);

  auto source = io::FrameSource::Open(folder_);
  ASSERT_TRUE(source.ok()) << source.status();
  const io::SourceInfo& info = (*source)->info();
  EXPECT_EQ(info.format, o.format == DatasetFormat::kEuroc ? io::SequenceFormat::kEuroc : io::SequenceFormat::kTumMono);
  for (const Vector2d& pixel : {Vector2d(20, 30), Vector2d(300, 200)}) {
    const auto read = info.camera.Unproject(pixel), expected = camera.Unproject(pixel);
    ASSERT_TRUE(read.has_value() && expected.has_value());
    EXPECT_LT((*read - *expected).norm(), 1e-9);
  }
  const auto sequence = Sequence::Create(o.sequence);
  for (int i = 0; i < 4; ++i) {
    const auto frame = (*source)->Next();
    ASSERT_TRUE(frame.ok() && frame->has_value());
    ASSERT_TRUE((*frame)->status.ok()) << (*frame)->status;
    EXPECT_EQ((*frame)->time_ns, sequence->TimeNsOf(i));
    EXPECT_TRUE(SameBytes((*frame)->gray, sequence->Render(i)));
    if (o.format == DatasetFormat::kTumMono) {
      EXPECT_NEAR((*frame)->exposure_s, sequence->ExposureS(i), 1e-9);
    }
  }
  EXPECT_EQ(info.photometric.has_value(), o.format == DatasetFormat::kTumMono);
  const auto truth =
      io::ReadTrajectory(folder_ + (o.format == DatasetFormat::kEuroc ? "/groundtruth_cam0.txt" : "/groundtruth.txt"));
  ASSERT_TRUE(truth.ok()) << truth.status();
  ASSERT_EQ(truth->poses.size(), 4u);
  EXPECT_LT((truth->poses[2].world_from_camera.Inverse() * sequence->WorldFromCamera(2)).Log().norm(), 1e-6);
  if (o.format == DatasetFormat::kEuroc) {
    const auto body = io::ReadTrajectory(folder_ + "/mav0/state_groundtruth_estimate0/data.csv");
    ASSERT_TRUE(body.ok()) << body.status();
    EXPECT_EQ(body->poses.size(), 61u);
    ASSERT_TRUE(info.body_from_camera.has_value());
    EXPECT_LT(((body->poses[20].world_from_camera * *info.body_from_camera).Inverse() * sequence->WorldFromCamera(1))
                  .Log()
                  .norm(),
              1e-6);
  }

  EXPECT_EQ(GenerateDataset(o, folder_).code(), absl::StatusCode::kAlreadyExists);
  o.overwrite = true;
  EXPECT_EQ(GenerateDataset(o, folder_, [](int, int) { return false; }).code(), absl::StatusCode::kCancelled);
}

INSTANTIATE_TEST_SUITE_P(Formats, Written,
                         testing::Values(std::pair{DatasetFormat::kEuroc, CameraModel::kPinhole},
                                         std::pair{DatasetFormat::kEuroc, CameraModel::kRadialTangential},
                                         std::pair{DatasetFormat::kEuroc, CameraModel::kKannalaBrandt},
                                         std::pair{DatasetFormat::kTumMono, CameraModel::kPinhole},
                                         std::pair{DatasetFormat::kTumMono, CameraModel::kRadialTangential},
                                         std::pair{DatasetFormat::kTumMono, CameraModel::kFov}));

}  // namespace
}  // namespace cairn::synth
