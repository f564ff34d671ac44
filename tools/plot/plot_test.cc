#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "base/random.h"
#include "io/atomic_file.h"
#include "plot/axes.h"
#include "plot/canvas.h"
#include "plot/figures.h"
#include "plot/projection.h"
#include "plot/scene_figure.h"

namespace cairn::plot {
namespace {

class Figures : public testing::Test {
 protected:
  Figures() : folder_(testing::TempDir() + "/cairn_plot_" + std::to_string(::getpid())) {
    std::filesystem::create_directories(folder_);
  }
  ~Figures() override { std::filesystem::remove_all(folder_); }
  std::string Path(const std::string& name) const { return folder_ + "/" + name; }

  std::string folder_;
};

TrajectoryFigure Winding() {
  TrajectoryFigure figure;
  figure.title = "winding";
  for (int i = 0; i < 300; ++i) {
    const double u = 0.04 * i;
    const Vector3d truth(3 * std::sin(u), 0.2 * std::sin(3 * u), 2 * std::cos(0.7 * u));
    const double error = 0.05 * (1 + std::sin(2 * u));
    figure.groundtruth.emplace_back(FromSeconds(u), truth);
    figure.estimate.push_back({FromSeconds(u), truth + Vector3d(error, 0, 0), error});
  }
  return figure;
}

TEST_F(Figures, NamesInAnyScriptAreDrawn) {
  const std::string path = Path("names.svg");
  auto canvas = Canvas::Create(path, 400.0, 300.0, 1.0);
  ASSERT_TRUE(canvas.ok()) << canvas.status();
  const std::vector<std::string> names = {"office",       "B\u00fcro",          "\u043a\u0443\u0445\u043d\u044f",
                                          "\u53a8\u623f", "not \xff\xfe UTF-8", "\x1b[31m"};
  double y = 20.0;
  for (const std::string& name : names) {
    EXPECT_GT(canvas->TextWidth(name, {}), 10.0) << name;
    canvas->Text({10.0, y += 20.0}, name, {});
  }
  EXPECT_NEAR(canvas->TextWidth("\xff", {}), canvas->TextWidth("\\xff", {}), 1e-6);
  const absl::Status drawn = canvas->Finish(false);
  EXPECT_TRUE(drawn.ok()) << drawn;
}

TEST(Axes, RoundTicks) {
  const auto ticks = Ticks({.low = -0.31, .high = 0.62, .count = 2}, 5);
  ASSERT_EQ(ticks.size(), 5u);
  EXPECT_NEAR(ticks[0], -0.2, 1e-12);
  EXPECT_NEAR(ticks[4], 0.6, 1e-12);
  EXPECT_EQ(TickLabel(ticks[0], 0.2), "\u22120.2");
  EXPECT_EQ(TickLabel(1e-17, 0.2), "0.0");
  EXPECT_EQ(TickLabel(25, 5), "25");
  EXPECT_TRUE(Ticks({.low = 1, .high = 1, .count = 1}, 5).empty());
}

TEST(Axes, EqualScaleKeepsCirclesRound) {
  const Axes axes({10, 20, 300, 100}, {.low = 0, .high = 10, .count = 2}, {.low = 0, .high = 10, .count = 2}, true);
  const Point a = axes.ToPage(0, 0), b = axes.ToPage(1, 1);
  EXPECT_NEAR(b.x - a.x, a.y - b.y, 1e-9);
  EXPECT_GE(axes.ToPage(0, 10).y, 20.0);
  EXPECT_LE(axes.ToPage(0, 0).y, 120.0);
}

TEST(Projection, RightHandedAndAlongTheAxes) {
  std::vector<Vector3d> flat;
  Random random(1);
  for (int i = 0; i < 100; ++i) flat.emplace_back(random.Normal(), 0.05 * random.Normal(), 2 * random.Normal());
  const Projection p = PrincipalPlane(flat);
  EXPECT_EQ(p.names[0], "x");
  EXPECT_EQ(p.names[1], "z");
  const Quaterniond turn = ExpSO3(Vector3d(0.6, 0.5, 0.4));
  std::vector<Vector3d> turned;
  for (const Vector3d& q : flat) turned.emplace_back(turn * q);
  const Projection tilted = PrincipalPlane(turned);
  EXPECT_EQ(tilted.names[0], "principal axis 1");
  for (const Projection& each : {p, tilted, TopView(flat, {0, -1, 0}), TopView(flat, {0, 0, 1}),
                                 TopView(flat, {0, 0, -1}), TopView(flat, {0.3, 0.2, 0.8})}) {
    EXPECT_LT((each.axes * each.axes.transpose() - Matrix3d::Identity()).norm(), 1e-9);
    EXPECT_NEAR(each.axes.determinant(), 1.0, 1e-9);
  }
  // Up is towards the viewer.
  EXPECT_NEAR(TopView(flat, {0, -1, 0}).axes.row(2).dot(Vector3d(0, -1, 0)), 1.0, 1e-12);
  EXPECT_NEAR(TopView(flat, {0, 1, 0}).axes.row(2).dot(Vector3d(0, 1, 0)), 1.0, 1e-12);
  EXPECT_NEAR(TopView(flat, {0, 0, 1}).axes.row(2).dot(Vector3d(0, 0, 1)), 1.0, 1e-12);
}

TEST_F(Figures, TrajectoryAsPngAndSvg) {
  const TrajectoryFigure figure = Winding();
  ASSERT_TRUE(WriteTrajectoryFigure(figure, Path("t.png")).ok());
  const cv::Mat image = cv::imread(Path("t.png"));
  EXPECT_EQ(image.cols, 1520);
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  EXPECT_GT(deviation[0], 5.0);
  ASSERT_TRUE(WriteTrajectoryFigure(figure, Path("t.svg")).ok());
  EXPECT_NE(io::ReadWholeFile(Path("t.svg"))->find("<svg"), std::string::npos);
}

TEST_F(Figures, NothingIsOverwrittenAndErrorsAreNamed) {
  TrajectoryFigure figure = Winding();
  ASSERT_TRUE(WriteTrajectoryFigure(figure, Path("t.svg")).ok());
  EXPECT_EQ(WriteTrajectoryFigure(figure, Path("t.svg")).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(WriteTrajectoryFigure(figure, Path("t.svg"), {.overwrite = true}).ok());
  EXPECT_EQ(WriteTrajectoryFigure(figure, Path("t.gif")).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(WriteTrajectoryFigure(figure, Path("no/such/folder/t.png")).ok());
  EXPECT_FALSE(WriteTrajectoryFigure({}, Path("e.png")).ok());
  EXPECT_FALSE(WriteTrajectoryFigure(figure, Path("e.png"), {.width_pt = -1}).ok());
  figure.estimate[3].position_m.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(WriteTrajectoryFigure(figure, Path("e.png")).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(std::filesystem::exists(Path("e.png")));
}

TEST_F(Figures, OnePoseAndAStraightLine) {
  TrajectoryFigure figure;
  figure.estimate.push_back({0, Vector3d(1, 2, 3), 0.0});
  EXPECT_TRUE(WriteTrajectoryFigure(figure, Path("one.png")).ok());
  for (int i = 1; i < 50; ++i) figure.estimate.push_back({i, Vector3d(1 + i, 2, 3), 0.0});
  EXPECT_TRUE(WriteTrajectoryFigure(figure, Path("line.png")).ok());
}

TEST_F(Figures, ErrorsOverTime) {
  ErrorFigure figure{.title = "errors", .series = {{"a", {}, {}}, {"b", {}, {}}}};
  for (int i = 0; i < 100; ++i) {
    figure.series[0].time_s.push_back(0.1 * i);
    figure.series[0].value.push_back(i == 50 ? std::numeric_limits<double>::quiet_NaN() : 0.01 + 0.0001 * i);
    figure.series[1].time_s.push_back(0.1 * i);
    figure.series[1].value.push_back(0.02 + 0.01 * std::sin(0.2 * i));
  }
  EXPECT_TRUE(WriteErrorFigure(figure, Path("e.png")).ok());
  figure.log_scale = true;
  EXPECT_TRUE(WriteErrorFigure(figure, Path("l.svg")).ok());
  figure.series[0].value.pop_back();
  EXPECT_EQ(WriteErrorFigure(figure, Path("f.png")).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(WriteErrorFigure({}, Path("f.png")).ok());
}

TEST_F(Figures, Photometric) {
  PhotometricFigure figure{.title = "gamma"};
  for (std::size_t i = 0; i < 256; ++i) {
    figure.inverse_response[i] = 255.0 * std::pow(static_cast<double>(i) / 255.0, 2.2);
  }
  for (int i = 0; i <= 20; ++i) figure.vignette.push_back(1.0 - 0.001 * i * i);
  EXPECT_TRUE(WritePhotometricFigure(figure, Path("c.svg")).ok());
  figure.intensity_seen.assign(256, 3);
  EXPECT_TRUE(WritePhotometricFigure(figure, Path("c.png")).ok());
  const cv::Mat picture = cv::imread(Path("c.png"), cv::IMREAD_COLOR);
  EXPECT_EQ(picture.cols, 1520);
  int blue = 0;  // the response
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols / 2; ++x) {
      const cv::Vec3b pixel = picture.at<cv::Vec3b>(y, x);
      blue += pixel[0] > 150 && pixel[2] < 40 ? 1 : 0;
    }
  }
  EXPECT_GT(blue, 500);
  figure.vignette.clear();
  EXPECT_EQ(WritePhotometricFigure(figure, Path("d.png")).code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(Figures, Map) {
  MapFigure figure{.title = "room"};
  Random random(2);
  for (int i = 0; i < 2000; ++i) {
    const double side = random.Uniform(0, 4);
    const double u = side - std::floor(side);
    const Vector3d corner[5] = {{-3, 0, -2}, {3, 0, -2}, {3, 0, 2}, {-3, 0, 2}, {-3, 0, -2}};
    const int k = static_cast<int>(side);
    figure.points_m.emplace_back(corner[k] + u * (corner[k + 1] - corner[k]) + Vector3d(0, random.Uniform(-1, 1), 0));
  }
  figure.points_m.emplace_back(1e4, 0, 0);
  for (int i = 0; i < 30; ++i) {
    const double a = 0.2 * i;
    figure.keyframes.push_back({SE3(ExpSO3(Vector3d(0, a, 0)), Vector3d(std::sin(a), 0, std::cos(a))), i / 20});
    if (i > 0) figure.covisible.emplace_back(i - 1, i);
    if (i > 2) figure.covisible.emplace_back(i - 3, i);
  }
  figure.queries.push_back(figure.keyframes[4].world_from_camera);
  EXPECT_TRUE(WriteMapFigure(figure, Path("m.png")).ok());
  EXPECT_TRUE(WriteMapFigure(figure, Path("m.svg")).ok());
  figure.covisible.emplace_back(3, 99);
  EXPECT_EQ(WriteMapFigure(figure, Path("n.png")).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(WriteMapFigure({}, Path("n.png")).ok());
}

TEST_F(Figures, ScenesFromAllSides) {
  SceneFigure figure;
  figure.title = "scene";
  figure.unit = "m";
  Random random(3);
  for (int i = 0; i < 400; ++i) {
    figure.points.push_back({Vector3d(random.Uniform(-2, 2), random.Uniform(-3, 3), random.Uniform(0, 2)), kGray});
  }
  figure.points.push_back({Vector3d(1e6, 0, 0), kGray});  // does not stretch the picture
  for (int i = 0; i < 300; ++i) {
    const double a = 0.02 * i;
    figure.cameras.push_back(
        {SE3(ExpSO3(Vector3d(0, a, 0)), Vector3d(std::sin(a), std::cos(a), 1)), Sequential(a / 6)});
  }
  for (int i = 0; i < 30; ++i) {
    figure.legend.push_back({absl::StrCat("session ", i, ": a name that is long"), CategoryColor(i)});
  }
  figure.scale = SceneScale{"age", "0 s", "6 s"};
  for (const SceneView view : {SceneView::kPlan, SceneView::kSide, SceneView::kPerspective}) {
    figure.view = view;
    const std::string name = "scene" + std::to_string(static_cast<int>(view));
    ASSERT_TRUE(WriteSceneFigure(figure, Path(name + ".png")).ok());
    ASSERT_TRUE(WriteSceneFigure(figure, Path(name + ".svg")).ok());
    // Rows of the legend make it taller, and it is not empty where the scene is.
    const cv::Mat image = cv::imread(Path(name + ".png"), cv::IMREAD_GRAYSCALE);
    EXPECT_GT(image.rows, 600);
    cv::Scalar mean, deviation;
    cv::meanStdDev(image, mean, deviation);
    EXPECT_GT(deviation[0], 10.0);
  }
  figure.points[0].at.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(WriteSceneFigure(figure, Path("n.png")).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(WriteSceneFigure({}, Path("n.png")).ok());
}

}  // namespace
}  // namespace cairn::plot
