#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>

#include "absl/strings/str_split.h"
#include "base/files.h"
#include "exchange/colmap.h"
#include "exchange/formats.h"
#include "exchange/model_images.h"
#include "map/testing_map.h"
#include "nlohmann/json.hpp"

namespace cairn::exchange {
namespace {

using ::testing::HasSubstr;

class Exchange : public ::testing::Test {
 protected:
  Exchange() : world_(map::testing::MakeMap(7, 6, 200, 0.5)) {
    folder_ = std::filesystem::temp_directory_path() / absl::StrCat("cairn_exchange_", getpid());
    std::filesystem::create_directories(folder_);
  }
  ~Exchange() override { std::filesystem::remove_all(folder_); }
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }

  // Twice as large, turned by a quarter about z and moved.
  std::shared_ptr<const map::Snapshot> Aligned() const {
    map::Edit edit(world_.snapshot);
    map::Component component = edit.component(ComponentId(1));
    component.world_from_component = Sim3(ExpSO3(Vector3d(0, 0, M_PI / 2)), Vector3d(10, 20, 30), 2.0);
    edit.PutComponent(component);
    return *world_.snapshot->Apply(edit.Finish("align"));
  }

  const map::testing::TestMap world_;
  std::filesystem::path folder_;
};

TEST_F(Exchange, ErrorsAreThoseOfTheMapInAnyFrame) {
  const auto model = *FromMap(*world_.snapshot), aligned = *FromMap(*Aligned());
  EXPECT_FALSE(model.metric);
  EXPECT_TRUE(aligned.metric);
  const ModelErrors errors = MeasureErrors(model), in_world = MeasureErrors(aligned);
  EXPECT_GT(errors.observations, 300);
  EXPECT_NEAR(errors.rms_px, 0.5 * std::sqrt(2.0), 0.05);
  EXPECT_NEAR(in_world.rms_px, errors.rms_px, 1e-9);
  EXPECT_NEAR(in_world.mean_of_points_px, errors.mean_of_points_px, 1e-9);
  EXPECT_NEAR((aligned.points[0].position - Vector3d(10 - 2 * model.points[0].position.y(),
                                                     20 + 2 * model.points[0].position.x(),
                                                     30 + 2 * model.points[0].position.z()))
                  .norm(),
              0.0, 1e-9);
  EXPECT_TRUE(absl::IsNotFound(FromMap(*world_.snapshot, ComponentId(2)).status()));
}

void ExpectSame(const Reconstruction& a, const Reconstruction& b, double tolerance) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  EXPECT_NEAR(a.cameras.at(1).cx_px, b.cameras.at(1).cx_px, 1e-12);
  ASSERT_EQ(a.images.size(), b.images.size());
  for (std::size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].points, b.images[i].points);
    EXPECT_LT((a.images[i].camera_from_world * b.images[i].camera_from_world.Inverse()).Log().norm(), 1e-12);
    for (std::size_t k = 0; k < a.images[i].keypoints.size(); ++k) {
      EXPECT_LT((a.images[i].keypoints[k] - b.images[i].keypoints[k]).norm(), tolerance);
    }
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].position, b.points[i].position);
    ASSERT_EQ(a.points[i].track.size(), b.points[i].track.size());
    EXPECT_EQ(a.points[i].track.back().keypoint, b.points[i].track.back().keypoint);
  }
}

TEST_F(Exchange, ColmapModelsAreReadBack) {
  const auto model = *FromMap(*world_.snapshot);
  ASSERT_TRUE(WriteColmap(model, Path("binary"), ColmapFormat::kBinary, false).ok());
  ASSERT_TRUE(WriteColmap(model, Path("text"), ColmapFormat::kText, false).ok());
  EXPECT_TRUE(absl::IsAlreadyExists(WriteColmap(model, Path("text"), ColmapFormat::kText, false)));
  const auto binary = ReadColmap(Path("binary")), text = ReadColmap(Path("text"));
  ASSERT_TRUE(binary.ok() && text.ok()) << binary.status() << text.status();
  ExpectSame(model, *binary, 1e-12);
  ExpectSame(model, *text, 1e-5);
  // Pixel centres at halves.
  EXPECT_THAT(*ReadWholeFile(Path("text/cameras.txt")), HasSubstr("PINHOLE 640 480 500 500 320.5 240.5"));
}

TEST_F(Exchange, OtherCamerasOfColmapAreUnderstood) {
  const auto model = *FromMap(*world_.snapshot);
  ASSERT_TRUE(WriteColmap(model, Path("m"), ColmapFormat::kText, false).ok());
  const auto with = [&](const std::string& line) {
    EXPECT_TRUE(WriteFileAtomically(Path("m/cameras.txt"), absl::StrCat(line, "\n"), true).ok());
    return ReadColmap(Path("m"));
  };
  const auto radial = with("1 SIMPLE_RADIAL 640 480 500 320.5 240.5 -0.1");
  ASSERT_TRUE(radial.ok()) << radial.status();
  EXPECT_EQ(radial->cameras.at(1).model, CameraModel::kRadialTangential);
  EXPECT_EQ(radial->cameras.at(1).cx_px, 320.0);
  EXPECT_EQ(radial->cameras.at(1).distortion, (std::vector<double>{-0.1, 0, 0, 0}));
  const auto fisheye = with("1 OPENCV_FISHEYE 640 480 300 301 320.5 240.5 0.01 0.02 0.03 0.04");
  ASSERT_TRUE(fisheye.ok()) << fisheye.status();
  EXPECT_EQ(fisheye->cameras.at(1).model, CameraModel::kKannalaBrandt);
  EXPECT_EQ(fisheye->cameras.at(1).fy_px, 301.0);
  EXPECT_THAT(std::string(with("1 FULL_OPENCV 640 480 1 1 1 1 0 0 0 0 0 0 0 0").status().message()),
              HasSubstr("not known here"));
  EXPECT_THAT(std::string(with("2 PINHOLE 640 480 500 500 320.5 240.5").status().message()),
              HasSubstr("camera 1, which is missing"));
  EXPECT_THAT(std::string(with("1 PINHOLE 640 480 500 500 320.5").status().message()), HasSubstr("cameras.txt:1"));
  EXPECT_THAT(std::string(ReadColmap(Path("none")).status().message()), HasSubstr("sparse/0"));
}

// A binary file that ends early anywhere is an error, never a crash and never a model.
TEST_F(Exchange, TruncatedModelsAreErrors) {
  const auto model = *FromMap(*world_.snapshot);
  ASSERT_TRUE(WriteColmap(model, Path("m"), ColmapFormat::kBinary, false).ok());
  for (const std::string name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string whole = *ReadWholeFile(Path(absl::StrCat("m/", name)));
    for (std::size_t i = 0; i < 60; ++i) {
      const std::string part = whole.substr(0, whole.size() * i / 60);
      ASSERT_TRUE(WriteFileAtomically(Path(absl::StrCat("m/", name)), part, true).ok());
      const auto read = ReadColmap(Path("m"));
      EXPECT_FALSE(read.ok()) << name << " " << i;
      EXPECT_THAT(std::string(read.status().message()), HasSubstr("m"));
    }
    ASSERT_TRUE(WriteFileAtomically(Path(absl::StrCat("m/", name)), whole, true).ok());
  }
  EXPECT_TRUE(ReadColmap(Path("m")).ok());
}

TEST_F(Exchange, TrajectoriesInTheFormatsOfOthers) {
  const auto poses = Trajectory(*FromMap(*Aligned()));
  ASSERT_TRUE(WriteFileAtomically(Path("poses.txt"), KittiText(poses), true).ok());
  ASSERT_TRUE(WriteFileAtomically(Path("times.txt"), KittiTimesText(poses), true).ok());
  ASSERT_TRUE(WriteFileAtomically(Path("euroc.csv"), EurocText(poses), true).ok());
  for (const char* name : {"poses.txt", "euroc.csv"}) {
    const auto read = io::ReadTrajectory(Path(name));
    ASSERT_TRUE(read.ok()) << read.status();
    ASSERT_EQ(read->poses.size(), poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      EXPECT_NEAR(ToSeconds(read->poses[i].time_ns), ToSeconds(poses[i].time_ns), 1e-9);
      EXPECT_LT((read->poses[i].world_from_camera * poses[i].world_from_camera.Inverse()).Log().norm(), 1e-7);
    }
  }
}

TEST_F(Exchange, TransformsLookBackwards) {
  const auto model = *FromMap(*Aligned());
  const auto json = nlohmann::json::parse(TransformsJson(model));
  EXPECT_EQ(json["cx"].get<double>(), 320.5);
  ASSERT_EQ(json["frames"].size(), model.images.size());
  const auto& rows = json["frames"][2]["transform_matrix"];
  const Matrix34d expected = model.images[2].camera_from_world.Inverse().Matrix();
  for (int r = 0; r < 3; ++r) {
    EXPECT_NEAR(rows[r][0].get<double>(), expected(r, 0), 1e-12);
    EXPECT_NEAR(rows[r][1].get<double>(), -expected(r, 1), 1e-12);
    EXPECT_NEAR(rows[r][2].get<double>(), -expected(r, 2), 1e-12);
    EXPECT_NEAR(rows[r][3].get<double>(), expected(r, 3), 1e-12);
  }
}

TEST_F(Exchange, JsonSaysWhatTheMapKnowsOfItsKeyframes) {
  const map::Snapshot& map = *world_.snapshot;
  const Reconstruction model = *FromMap(map);
  const auto json = nlohmann::json::parse(ModelJson(model, map));
  EXPECT_EQ(json["revision"].get<Revision>(), map.revision());
  ASSERT_EQ(json["sessions"].size(), map.sessions().size());
  EXPECT_EQ(json["sessions"][0]["source"], map.sessions().begin()->second.source);
  ASSERT_EQ(json["components"].size(), 1u);
  const auto& world_from = json["components"][0]["world_from_component"];
  EXPECT_EQ(world_from.is_null(), !model.metric);
  if (model.metric) {
    EXPECT_DOUBLE_EQ(world_from["scale"].get<double>(), map.components().begin()->second.world_from_component->scale());
  }
  ASSERT_EQ(json["keyframes"].size(), model.images.size());
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const map::Keyframe& keyframe = map.keyframe(KeyframeId(model.images[i].id));
    EXPECT_EQ(json["keyframes"][i]["session"].get<std::uint32_t>(), keyframe.session.value());
    EXPECT_EQ(json["keyframes"][i]["component"].get<std::uint32_t>(), keyframe.component.value());
  }
}

TEST_F(Exchange, EdgesOfG2oAreWhatTheirVerticesSay) {
  const std::string text = G2oText(*FromMap(*world_.snapshot), *world_.snapshot);
  std::map<int, SE3> vertices;
  int edges = 0;
  for (const absl::string_view line : absl::StrSplit(text, '\n', absl::SkipEmpty())) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ');
    const auto pose = [&](std::size_t at) {
      std::vector<double> v;
      for (std::size_t i = at; i < at + 7; ++i) v.push_back(std::stod(words[i]));
      return SE3(Quaterniond(v[6], v[3], v[4], v[5]), Vector3d(v[0], v[1], v[2]));
    };
    if (words[0] == "VERTEX_SE3:QUAT") {
      vertices[std::stoi(words[1])] = pose(2);
      continue;
    }
    ASSERT_EQ(words[0], "EDGE_SE3:QUAT");
    ASSERT_EQ(words.size(), 3u + 7u + 21u);
    const SE3 expected = vertices.at(std::stoi(words[1])).Inverse() * vertices.at(std::stoi(words[2]));
    EXPECT_LT((expected.Inverse() * pose(3)).Log().norm(), 1e-9);
    ++edges;
  }
  EXPECT_EQ(vertices.size(), 6u);
  EXPECT_GE(edges, 5);
}

TEST_F(Exchange, ImagesOfASequenceAreThoseOfItsKeyframes) {
  auto model = *FromMap(*world_.snapshot);
  EXPECT_TRUE(
      absl::IsNotFound(ModelImages::Create(*world_.snapshot, model, "elsewhere", Path("images"), false).status()));
  auto images = ModelImages::Create(*world_.snapshot, model, "", Path("images"), false);
  ASSERT_TRUE(images.ok()) << images.status();
  const cv::Mat gray(480, 640, CV_8UC1, cv::Scalar(77));
  EXPECT_EQ(*images->Add(50'000'000, gray), false);  // between two keyframes
  EXPECT_EQ(*images->Add(100'000'000, gray), true);
  EXPECT_FALSE(images->Add(200'000'000, gray(cv::Rect(0, 0, 100, 100))).ok());
  EXPECT_EQ(images->num_written(), 1u);
  EXPECT_TRUE(std::filesystem::exists(Path("images/s1_000001.png")));
  const std::size_t colored = images->ColorPoints(&model);
  EXPECT_GT(colored, 50u);
  std::size_t with_gray = 0;
  for (const ModelPoint& point : model.points) with_gray += point.red == 77 ? 1 : 0;
  EXPECT_EQ(with_gray, colored);
}

}  // namespace
}  // namespace cairn::exchange
