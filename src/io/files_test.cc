// Camera files, photometric files, point clouds and atomic writing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "absl/strings/str_replace.h"
#include "io/atomic_file.h"
#include "io/camera_file.h"
#include "io/photometric_files.h"
#include "io/ply.h"
#include "io/testing_folder.h"

namespace cairn::io {
namespace {

using ::testing::HasSubstr;

constexpr char kGood[] =
    "# a comment\nmodel: radial_tangential\nresolution_px: [752, 480]\n"
    "intrinsics_px: [458.654, 457.296, 367.215, 248.375]   # fx fy cx cy\n"
    "distortion: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]\nrate_hz: 20\n";

TEST(CameraFile, Reads) {
  const TestingFolder folder;
  for (const std::string head : {"", "%YAML:1.0\n", "%YAML 1.2\n---\n", "\xEF\xBB\xBF"}) {
    folder.Write("camera.yaml", head + kGood);
    const auto file = LoadCamera(folder / "camera.yaml");
    ASSERT_TRUE(file.ok()) << file.status();
    EXPECT_EQ(file->camera.model, CameraModel::kRadialTangential);
    EXPECT_EQ(file->camera.width_px, 752);
    EXPECT_EQ(file->camera.cy_px, 248.375);
    EXPECT_EQ(file->camera.distortion.size(), 4u);
    EXPECT_EQ(file->rate_hz, 20.0);
  }
}

TEST(CameraFile, ReadsTheSensorFilesOfEuroc) {
  const TestingFolder folder;
  const std::string sensor =
      "%YAML:1.0\nsensor_type: camera\ncomment: VI-Sensor cam0\nrate_hz: 20\nresolution: [752, 480]\n"
      "camera_model: pinhole\nintrinsics: [458.654, 457.296, 367.215, 248.375]\n"
      "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.7e-05]\n";
  folder.Write("sensor.yaml", sensor);
  const auto file = LoadCamera(folder / "sensor.yaml");
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(file->camera.model, CameraModel::kRadialTangential);
  EXPECT_EQ(file->camera.height_px, 480);
  EXPECT_EQ(file->camera.cx_px, 367.215);
  EXPECT_EQ(file->camera.distortion.size(), 4u);
  EXPECT_EQ(file->rate_hz, 20.0);
  folder.Write("sensor.yaml", absl::StrReplaceAll(sensor, {{"rate_hz: 20", "rate_hz: -1"}}));
  EXPECT_FALSE(LoadCamera(folder / "sensor.yaml").ok());
}

TEST(CameraFile, ErrorsNameFileLineAndRemedy) {
  const TestingFolder folder;
  const auto error = [&](const std::string& from, const std::string& to) {
    std::string text = kGood;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    folder.Write("camera.yaml", text.replace(at, from.size(), to));
    const auto file = LoadCamera(folder / "camera.yaml");
    EXPECT_EQ(file.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(file.status().message());
  };
  EXPECT_THAT(error("rate_hz", "rate"), HasSubstr("camera.yaml:6: unknown key `rate`; a camera file has model"));
  EXPECT_THAT(error("rate_hz: 20", "model: fov"), HasSubstr("camera.yaml:6: the key `model` is repeated"));
  EXPECT_THAT(error("radial_tangential", "radtan"), HasSubstr("camera.yaml:2: unknown camera model \"radtan\"; use"));
  EXPECT_THAT(error("[752, 480]", "[752]"), HasSubstr("camera.yaml:3: `resolution_px` must be [width, height]"));
  EXPECT_THAT(error("[752, 480]", "[752.5, 480]"), HasSubstr("camera.yaml:3"));
  EXPECT_THAT(error("[752, 480]", "752x480"), HasSubstr("camera.yaml:3: `resolution_px` must be a list"));
  EXPECT_THAT(error("458.654, ", ""), HasSubstr("camera.yaml:4: `intrinsics_px` must be [fx, fy, cx, cy], not 3"));
  EXPECT_THAT(error("458.654", "wide"), HasSubstr("camera.yaml:4: `intrinsics_px` must be numbers, not \"wide\""));
  EXPECT_THAT(error("458.654", ".nan"), HasSubstr("camera.yaml:4"));
  EXPECT_THAT(error("458.654", "-458.654"), HasSubstr("focal length"));
  EXPECT_THAT(error("0.00019359, ", ""), HasSubstr("takes 0, 4, 5 or 8"));
  EXPECT_THAT(error("rate_hz: 20", "rate_hz: -3"), HasSubstr("camera.yaml:6: `rate_hz` must be positive"));
  EXPECT_THAT(error("resolution_px", "# resolution_px"), HasSubstr("the key `resolution_px` is missing"));
  EXPECT_THAT(error("[752, 480]", "[752, 480"), HasSubstr("not valid YAML"));
  folder.Write("list.yaml", "- 1\n- 2\n");
  EXPECT_FALSE(LoadCamera(folder / "list.yaml").ok());
  folder.Write("empty.yaml", "");
  EXPECT_FALSE(LoadCamera(folder / "empty.yaml").ok());
  EXPECT_EQ(LoadCamera(folder / "none.yaml").status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(LoadCamera(folder.str()).ok());
}

TEST(CameraFile, SavesEveryDigit) {
  const TestingFolder folder;
  const CameraFile file = {{CameraModel::kKannalaBrandt,
                            512,
                            500,
                            190.97847715128717,
                            1.0 / 3 + 100,
                            254.9,
                            256.8,
                            {0.0034823894022493434, -1e-17, 2.0, 3e-5}},
                           29.97};
  ASSERT_TRUE(SaveCamera(folder / "camera.yaml", file).ok());
  const auto read = LoadCamera(folder / "camera.yaml");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->camera, file.camera);
  EXPECT_EQ(read->rate_hz, file.rate_hz);
  EXPECT_EQ(SaveCamera(folder / "camera.yaml", file).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(SaveCamera(folder / "camera.yaml", file, true).ok());
  EXPECT_FALSE(SaveCamera(folder / "b.yaml", CameraFile()).ok());
}

TEST(PhotometricFiles, ReadsAndRefuses) {
  const TestingFolder folder;
  std::string response;
  for (int i = 0; i < 256; ++i) absl::StrAppend(&response, i * 0.5 + 0.001 * i * i, i % 16 == 15 ? "\n" : " ");
  folder.Write("pcalib.txt", response);
  cv::Mat vignette(24, 32, CV_16UC1, cv::Scalar(60000));
  vignette.at<std::uint16_t>(3, 4) = 30000;
  folder.WriteImage("vignette.png", vignette);
  const auto both = LoadPhotometricCalibration(folder / "pcalib.txt", folder / "vignette.png");
  ASSERT_TRUE(both.ok()) << both.status();
  EXPECT_TRUE(both->has_response());
  EXPECT_EQ(both->vignette_size(), cv::Size(32, 24));
  const auto irradiance = both->Irradiance(cv::Mat(24, 32, CV_8UC1, cv::Scalar(255)));
  EXPECT_FLOAT_EQ(irradiance->at<float>(3, 4), 510.0f);
  EXPECT_TRUE(LoadPhotometricCalibration("", "")->IsIdentity());

  const auto message = [](const auto& result) { return std::string(result.status().message()); };
  folder.Write("pcalib.txt", "1 2 3\n");
  EXPECT_THAT(message(LoadPhotometricCalibration(folder / "pcalib.txt", "")), HasSubstr("holds 3 numbers"));
  folder.Write("pcalib.txt", "1 2\nx 4\n");
  EXPECT_THAT(message(LoadPhotometricCalibration(folder / "pcalib.txt", "")), HasSubstr("pcalib.txt:2: \"x\""));
  folder.Write("pcalib.txt", std::string(256 * 2, '1').replace(0, 0, ""));
  EXPECT_FALSE(LoadPhotometricCalibration(folder / "pcalib.txt", "").ok());
  folder.Truncate("vignette.png", 0.5);
  EXPECT_THAT(message(LoadPhotometricCalibration("", folder / "vignette.png")), HasSubstr("vignette.png"));
  folder.Write("vignette.png", "");
  EXPECT_FALSE(LoadPhotometricCalibration("", folder / "vignette.png").ok());
  EXPECT_EQ(LoadPhotometricCalibration(folder / "none.txt", "").status().code(), absl::StatusCode::kNotFound);
}

TEST(PhotometricFiles, AFolderIsWrittenAndReadBack) {
  const TestingFolder folder;
  std::array<double, 256> response;
  for (std::size_t i = 0; i < 256; ++i) response[i] = 255.0 * std::pow(static_cast<double>(i) / 255.0, 1.7);
  cv::Mat vignette(24, 32, CV_32FC1, cv::Scalar(1.0));
  vignette.at<float>(3, 4) = 0.5f;
  const std::string path = folder / ".";
  EXPECT_EQ(LoadPhotometricFolder(path).status().code(), absl::StatusCode::kNotFound);
  const Exposures exposures = {{1000000001, 0.002}, {1050000000, 0.0031}};
  ASSERT_TRUE(SavePhotometricFolder(path, response, vignette, exposures, false).ok());
  const auto read = LoadPhotometricFolder(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_NEAR(read->calibration.gamma(), 1.7, 1e-3);
  EXPECT_NEAR(read->calibration.inverse_response()[100], response[100], 1e-3);
  EXPECT_NEAR(read->calibration.Irradiance(cv::Mat(24, 32, CV_8UC1, cv::Scalar(255)))->at<float>(3, 4), 510.0, 0.1);
  ASSERT_TRUE(read->exposures.has_value());
  ASSERT_EQ(read->exposures->size(), 2u);
  EXPECT_EQ((*read->exposures)[0].first, 1000000001);
  EXPECT_NEAR((*read->exposures)[1].second, 0.0031, 1e-9);
  EXPECT_EQ(SavePhotometricFolder(path, response, vignette, {}, false).code(), absl::StatusCode::kAlreadyExists);
  // Known exposures: none are written, and those of an earlier calibration go.
  ASSERT_TRUE(SavePhotometricFolder(path, response, vignette, {}, true).ok());
  EXPECT_FALSE(LoadPhotometricFolder(path)->exposures.has_value());
  folder.Write("times.txt", "0 1.5 -3\n");
  EXPECT_THAT(std::string(LoadPhotometricFolder(path).status().message()), HasSubstr("times.txt:1"));
}

TEST(Ply, WritesBinaryPoints) {
  const TestingFolder folder;
  const std::vector<ColoredPoint> points = {{{1.5, -2.0, 3.25}, 10, 20, 30}, {{0, 0, 7}, 255, 0, 128}};
  ASSERT_TRUE(WritePly(folder / "a.ply", points).ok());
  const std::string contents = folder.Read("a.ply");
  EXPECT_THAT(contents, HasSubstr("ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n"));
  const std::size_t start = contents.find("end_header\n") + 11;
  ASSERT_EQ(contents.size(), start + 30);
  float z;
  std::memcpy(&z, contents.data() + start + 8, 4);
  EXPECT_EQ(z, 3.25f);
  EXPECT_EQ(static_cast<std::uint8_t>(contents[start + 13]), 20);
  EXPECT_EQ(static_cast<std::uint8_t>(contents[start + 29]), 128);
  EXPECT_EQ(WritePly(folder / "a.ply", points).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(WritePly(folder / "a.ply", {}, true).ok());
  EXPECT_FALSE(WritePly(folder / "b.ply", {{{NAN, 0, 0}, 0, 0, 0}}).ok());
}

TEST(AtomicFile, KeepsTheOldFileWhenItCannotWrite) {
  const TestingFolder folder;
  EXPECT_TRUE(WriteFileAtomically(folder / "a", "first", false).ok());
  EXPECT_EQ(WriteFileAtomically(folder / "a", "second", false).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(folder.Read("a"), "first");
  EXPECT_TRUE(WriteFileAtomically(folder / "a", "second", true).ok());
  EXPECT_EQ(*ReadWholeFile(folder / "a"), "second");
  EXPECT_EQ(WriteFileAtomically(folder.str(), "x", true).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(WriteFileAtomically(folder / "no/b", "x", true).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.str()), {}), 1);
}

}  // namespace
}  // namespace cairn::io
