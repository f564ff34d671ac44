// Every sequence format from a generated folder, and every kind of damage.
#include "io/frame_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <opencv2/imgproc.hpp>

#include "absl/strings/str_format.h"
#include "io/camera_file.h"
#include "io/testing_folder.h"

namespace cairn::io {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr char kCamera[] =
    "model: pinhole\nresolution_px: [32, 24]\nintrinsics_px: [30, 30, 15.5, 11.5]\ndistortion: []\nrate_hz: 10\n";

// 6 images at 10 Hz from 100 s on, listed in times.txt.
void WriteTimesFolder(const TestingFolder& folder) {
  folder.Write("camera.yaml", kCamera);
  std::string times = "# seconds filename\n";
  for (int i = 0; i < 6; ++i) {
    absl::StrAppendFormat(&times, "100.%d images/%d.png\n", i, i);
    folder.WriteImage(absl::StrCat("images/", i, ".png"), i);
  }
  folder.Write("times.txt", times);
}

void WriteEurocCamera(const TestingFolder& folder, const std::string& where, const std::string& head) {
  folder.Write(where + "/sensor.yaml",
               head +
                   "sensor_type: camera\ncomment: a, b\nT_BS:\n  cols: 4\n  rows: 4\n"
                   "  data: [0, -1, 0, 0.1,\n  1, 0, 0, 0.2,\n  0, 0, 1, 0.3,\n  0, 0, 0, 1]\n"
                   "rate_hz: 20\nresolution: [32, 24]\ncamera_model: pinhole\nintrinsics: [30, 30, 15.5, 11.5] #fu\n"
                   "distortion_model: radial-tangential\ndistortion_coefficients: [-0.1, 0.01, 0, 1e-05]\n");
  folder.Write(where + "/data.csv",
               "#timestamp [ns],filename\r\n1403715273262142976,1403715273262142976.png\r\n"
               "1403715273312143104, 1403715273312143104.png \r\n1403715273362142976 ,1403715273362142976.png\r\n");
  for (const char* name : {"1403715273262142976", "1403715273312143104", "1403715273362142976"}) {
    folder.WriteImage(where + "/data/" + name + ".png", 7);
  }
}

std::vector<SourceFrame> All(FrameSource& source) {
  std::vector<SourceFrame> frames;
  while (true) {
    auto next = source.Next();
    EXPECT_TRUE(next.ok()) << next.status();
    if (!next.ok() || !next->has_value()) break;
    frames.push_back(**std::move(next));
  }
  EXPECT_FALSE(source.Next()->has_value());  // and stays at the end
  return frames;
}

std::unique_ptr<FrameSource> MustOpen(const std::string& path, const OpenOptions& options = {}) {
  auto source = FrameSource::Open(path, options);
  EXPECT_TRUE(source.ok()) << source.status();
  return source.ok() ? *std::move(source) : nullptr;
}

std::string OpenError(const std::string& path, const OpenOptions& options = {}) {
  const auto source = FrameSource::Open(path, options);
  EXPECT_FALSE(source.ok());
  return std::string(source.status().message());
}

TEST(FrameSource, TimesFolderWithAndWithoutPrefetch) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  for (const int prefetch : {0, 1, 3, 100}) {
    OpenOptions options;
    options.prefetch = prefetch;
    const auto source = MustOpen(folder.str(), options);
    ASSERT_NE(source, nullptr);
    EXPECT_EQ(source->info().format, SequenceFormat::kTimes);
    EXPECT_EQ(source->info().name, std::filesystem::path(folder.str()).filename().string());
    EXPECT_EQ(source->info().num_frames, 6);
    EXPECT_EQ(source->info().rate_hz, 10.0);
    EXPECT_EQ(source->info().first_time_ns, 100000000000);
    EXPECT_EQ(source->info().last_time_ns, 100500000000);
    EXPECT_DOUBLE_EQ(source->info().duration_s, 0.5);
    EXPECT_EQ(source->info().camera.fx_px, 30.0);
    EXPECT_FALSE(source->info().photometric.has_value());
    const auto frames = All(*source);
    ASSERT_EQ(frames.size(), 6u);
    for (int i = 0; i < 6; ++i) {
      EXPECT_EQ(frames[i].index, i);
      EXPECT_EQ(frames[i].sequence_index, i);
      EXPECT_EQ(frames[i].time_ns, 100000000000 + i * 100000000);
      ASSERT_TRUE(frames[i].status.ok()) << frames[i].status;
      EXPECT_EQ(cv::norm(frames[i].gray, TestingFolder::Ramp(i), cv::NORM_INF), 0);
      EXPECT_EQ(frames[i].exposure_s, 0.0);
    }
  }
}

TEST(FrameSource, StopsCleanlyInTheMiddle) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  OpenOptions options;
  options.prefetch = 1;
  for (int i = 0; i < 20; ++i) {
    const auto source = MustOpen(folder.str(), options);
    for (int k = 0; k < i % 4; ++k) EXPECT_TRUE(source->Next().ok());
  }
}

TEST(FrameSource, FromUntilAndStride) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  const auto indices = [&](double from_s, double until_s, int stride) {
    OpenOptions options;
    options.from_s = from_s;
    options.until_s = until_s;
    options.stride = stride;
    std::vector<std::int64_t> out;
    const auto source = MustOpen(folder.str(), options);
    for (const SourceFrame& frame : All(*source)) {
      EXPECT_EQ(frame.index, static_cast<std::int64_t>(out.size()));
      out.push_back(frame.sequence_index);
    }
    EXPECT_EQ(source->info().num_frames, static_cast<std::int64_t>(out.size()));
    return out;
  };
  EXPECT_THAT(indices(0.0, 0.2, 1), ElementsAre(0, 1));
  EXPECT_THAT(indices(0.2, 1e300, 1), ElementsAre(2, 3, 4, 5));
  EXPECT_THAT(indices(0.1, 0.5, 2), ElementsAre(1, 3));
  EXPECT_THAT(indices(0.05, 0.25, 1), ElementsAre(1, 2));
  OpenOptions options;
  options.from_s = 3;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("no image lies from 3 s"));
  options = OpenOptions();
  options.stride = 0;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("stride"));
  options = OpenOptions();
  options.from_s = -1;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("from is -1"));
  options = OpenOptions();
  options.until_s = 0;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("until is 0"));
}

TEST(FrameSource, DamagedImagesAreErrorsOfTheirFrames) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  std::filesystem::remove(folder / "images/0.png");
  folder.Truncate("images/1.png", 0.5);
  folder.Write("images/2.png", "no image at all");
  folder.Write("images/3.png", "");
  folder.WriteImage("images/4.png", cv::Mat(20, 30, CV_8UC1, cv::Scalar(3)));
  const auto source = MustOpen(folder.str());
  ASSERT_NE(source, nullptr);
  const auto frames = All(*source);
  ASSERT_EQ(frames.size(), 6u);
  EXPECT_EQ(frames[0].status.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(frames[1].status.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(frames[2].status.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(frames[3].status.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(frames[4].status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(frames[4].status.message()),
              AllOf(HasSubstr("30x20"), HasSubstr("32x24"), HasSubstr("4.png")));
  for (int i = 0; i < 5; ++i) {
    EXPECT_TRUE(frames[i].gray.empty());
    EXPECT_THAT(std::string(frames[i].status.message()), HasSubstr(absl::StrCat("images/", i, ".png")));
  }
  EXPECT_TRUE(frames[5].status.ok());
}

TEST(FrameSource, BrokenListsAndCalibrationsAreErrorsOfOpen) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  const std::string good = folder.Read("times.txt");
  folder.Write("times.txt", "100.0 images/0.png\n100.1 images/1.png\n\n100.1 images/2.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt:4: time 100.100000000 s is not after"));
  folder.Write("times.txt", "100.0 images/0.png\n99 images/1.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt:2"));
  folder.Write("times.txt", "# nothing\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("lists no images"));
  folder.Write("times.txt", "100.0\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt:1: no file name"));
  folder.Write("times.txt", "soon images/0.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt:1: \"soon\" is not a time"));
  folder.Write("times.txt", "-9e9 images/0.png\n9e9 images/1.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt: the unit of the times is not clear"));
  folder.Write("times.txt", "# seconds filename\n-9e9 images/0.png\n9e9 images/1.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt:2: time -9000000000.000000000 s is out of range"));
  folder.Write("times.txt", "1 images/x.png\n2 images/y.png\n");
  EXPECT_THAT(OpenError(folder.str()), AllOf(HasSubstr("none of the 2"), HasSubstr("images/x.png")));

  folder.Write("times.txt", good);
  folder.Write("camera.yaml", "model: pinhole\nresolution_px: [64, 48]\nintrinsics_px: [30, 30, 15.5, 11.5]\n");
  EXPECT_THAT(OpenError(folder.str()), AllOf(HasSubstr("32x24"), HasSubstr("64x48")));
  folder.Write("camera.yaml", "model: pinhole\nlens: 3\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("camera.yaml:2: unknown key `lens`"));
  std::filesystem::remove(folder / "camera.yaml");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("--camera"));
  const TestingFolder elsewhere;
  elsewhere.Write("other.yaml", kCamera);
  OpenOptions options;
  options.camera_path = elsewhere / "other.yaml";
  EXPECT_EQ(MustOpen(folder.str(), options)->info().num_frames, 6);
}

TEST(FrameSource, UnknownFoldersListWhatWasLookedFor) {
  const TestingFolder folder;
  EXPECT_THAT(OpenError(folder.str()), AllOf(HasSubstr("mav0"), HasSubstr("rgb.txt"), HasSubstr("camera.txt"),
                                             HasSubstr("calib.txt"), HasSubstr("camera.yaml")));
  EXPECT_THAT(OpenError(folder / "none"), HasSubstr("there is no folder"));
  folder.Write("video.mp4", "x");
  EXPECT_THAT(OpenError(folder / "video.mp4"), HasSubstr("is a file"));
  for (const char* name : {"euroc", "tum_rgbd", "tum_mono", "kitti", "times", "images"}) {
    OpenOptions options;
    options.format = *SequenceFormatFromName(name);
    EXPECT_EQ(SequenceFormatName(options.format), name);
    EXPECT_FALSE(OpenError(folder.str(), options).empty());
  }
  EXPECT_EQ(*SequenceFormatFromName("auto"), SequenceFormat::kAuto);
  EXPECT_THAT(std::string(SequenceFormatFromName("bag").status().message()), HasSubstr("tum_mono"));
}

TEST(FrameSource, Euroc) {
  const TestingFolder folder;
  WriteEurocCamera(folder, "mav0/cam0", "%YAML:1.0\n# c\n");
  WriteEurocCamera(folder, "mav0/cam1", "");
  for (const std::string& path : {folder.str(), folder / "mav0", folder / "mav0/cam0"}) {
    const auto source = MustOpen(path);
    ASSERT_NE(source, nullptr);
    const SourceInfo& info = source->info();
    EXPECT_EQ(info.format, SequenceFormat::kEuroc);
    EXPECT_EQ(info.camera.model, CameraModel::kRadialTangential);
    EXPECT_EQ(info.camera.distortion[0], -0.1);
    EXPECT_EQ(info.rate_hz, 20.0);
    EXPECT_EQ(info.first_time_ns, 1403715273262142976);
    ASSERT_TRUE(info.body_from_camera.has_value());
    EXPECT_LT((*info.body_from_camera * Vector3d(1, 0, 0) - Vector3d(0.1, 1.2, 0.3)).norm(), 1e-12);
    const auto frames = All(*source);
    ASSERT_EQ(frames.size(), 3u);
    for (const SourceFrame& frame : frames) EXPECT_TRUE(frame.status.ok()) << frame.status;
  }
  OpenOptions options;
  options.camera_index = 1;
  EXPECT_THAT(All(*MustOpen(folder.str(), options))[0].path, HasSubstr("cam1/data"));
  options.camera_index = 2;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("there is cam0, cam1"));
}

TEST(FrameSource, EurocDamage) {
  const TestingFolder folder;
  WriteEurocCamera(folder, "cam0", "");
  const std::string good = folder.Read("cam0/sensor.yaml");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    folder.Write("cam0/sensor.yaml", text);
    return OpenError(folder.str());
  };
  EXPECT_THAT(with("radial-tangential", "spline"), HasSubstr("distortion_model `spline`"));
  EXPECT_THAT(with("camera_model: pinhole", "camera_model: omni"), HasSubstr("sensor.yaml:12: camera_model `omni`"));
  EXPECT_THAT(with("[32, 24]", "[32"), HasSubstr("not valid YAML"));
  EXPECT_THAT(with("resolution:", "size:"), HasSubstr("`resolution` is missing"));
  EXPECT_THAT(with("  0, 0, 0, 1]", "  0, 0, 0]"), HasSubstr("16 numbers"));
  EXPECT_THAT(with("[0, -1, 0, 0.1", "[0, -2, 0, 0.1"), HasSubstr("not a rotation"));
  std::filesystem::remove(folder / "cam0/sensor.yaml");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("sensor.yaml"));
  folder.Write("cam0/sensor.yaml", good);
  folder.Write("cam0/data.csv", "#t,f\n1403715273312143104,a.png\n1403715273262142976,b.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("data.csv:3"));
  folder.Write("cam0/data.csv", "#t,f\nsoon,a.png\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("data.csv:2: \"soon\" is not a time in nanoseconds"));
  folder.Write("cam0/data.csv", "");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("lists no images"));
  folder.Write("cam0/data.csv", "1403715273262142976\n");  // the name follows from the time
  EXPECT_TRUE(All(*MustOpen(folder.str()))[0].status.ok());
}

TEST(FrameSource, TumRgbd) {
  const TestingFolder folder;
  folder.Write("rgb.txt",
               "# color images\n# file: 'x.bag'\n# timestamp filename\n1305031102.175304 rgb/a b.png\n"
               "1305031102.211214 rgb/c.png\n1305031102.243211 rgb/d.png\n");
  cv::Mat color;
  cv::cvtColor(TestingFolder::Ramp(1), color, cv::COLOR_GRAY2BGR);
  for (const char* name : {"rgb/a b.png", "rgb/c.png", "rgb/d.png"}) folder.WriteImage(name, color);
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("--camera"));
  folder.Write("k.yaml", "model: pinhole\nresolution_px: [32, 24]\nintrinsics_px: [30, 30, 15.5, 11.5]\n");
  OpenOptions options;
  options.camera_path = folder / "k.yaml";
  const auto source = MustOpen(folder.str(), options);
  ASSERT_NE(source, nullptr);
  EXPECT_EQ(source->info().format, SequenceFormat::kTumRgbd);
  EXPECT_NEAR(source->info().rate_hz, 27.85, 4.0);  // from the times
  const auto frames = All(*source);
  EXPECT_EQ(frames[0].time_ns, 1305031102175304000);
  ASSERT_TRUE(frames[0].status.ok()) << frames[0].status;
  EXPECT_EQ(frames[0].gray.type(), CV_8UC1);
  EXPECT_LE(cv::norm(frames[0].gray, TestingFolder::Ramp(1), cv::NORM_INF), 1);
  options.camera_index = 1;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("one camera"));
}

TEST(FrameSource, Kitti) {
  const TestingFolder folder;
  folder.Write("calib.txt",
               "P0: 7.18e+01 0 16 0 0 7.2e+01 12 0 0 0 1 0\nP1: 70 0 15 -386 0 71 11 0 0 0 1 0\nTr: 1 0\n");
  folder.Write("times.txt", "0.000000e+00\n1.036000e-01\n2.072000e-01\n");
  for (int i = 0; i < 3; ++i) {
    folder.WriteImage(absl::StrFormat("image_0/%06d.png", i), i);
    folder.WriteImage(absl::StrFormat("image_1/%06d.png", i), i);
  }
  const auto source = MustOpen(folder.str());
  ASSERT_NE(source, nullptr);
  EXPECT_EQ(source->info().format, SequenceFormat::kKitti);
  EXPECT_EQ(source->info().camera, Camera::FromPinhole({32, 24, 71.8, 72, 16, 12}));
  EXPECT_NEAR(source->info().rate_hz, 9.65, 0.01);
  EXPECT_EQ(All(*source)[1].time_ns, 103600000);
  OpenOptions options;
  options.camera_index = 1;
  EXPECT_EQ(MustOpen(folder.str(), options)->info().camera.fy_px, 71);
  options.camera_index = 2;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("image_2"));

  folder.Write("times.txt", "0\n0.1\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("3 images but"));
  folder.Write("times.txt", "0\n0.1\n0.2\n0.3\n");
  EXPECT_EQ(All(*MustOpen(folder.str()))[3].status.code(), absl::StatusCode::kNotFound);
  folder.Write("times.txt", "0\n0.1\n0.1\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("times.txt:3"));
  folder.Write("times.txt", "0\n0.1\n0.2\n");
  folder.Write("calib.txt", "P0: 1 2 3\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("calib.txt:1: P0: must have 12 numbers"));
  folder.Write("calib.txt", "P2: 1 2 3\n");
  EXPECT_THAT(OpenError(folder.str()), HasSubstr("has no line P0:"));
}

TEST(FrameSource, EurocTimesInSecondsAndQuotedFieldsAreTold) {
  const TestingFolder folder;
  WriteEurocCamera(folder, "cam0", "");
  const std::string good = folder.Read("cam0/data.csv");
  folder.Write("cam0/data.csv",
               "\"timestamp\",\"filename\"\n\"1403715273.262142976\",\"1403715273262142976.png\"\n"
               "\"1403715273.312143104\",\"1403715273312143104.png\"\n");
  const auto source = MustOpen(folder.str());
  ASSERT_NE(source, nullptr);
  EXPECT_EQ(source->info().first_time_ns, 1403715273262142976);
  EXPECT_THAT(source->info().notes, ElementsAre(HasSubstr("data.csv: the times are seconds, since 1970")));
  for (const SourceFrame& frame : All(*source)) EXPECT_TRUE(frame.status.ok()) << frame.status;
  folder.Write("cam0/data.csv", good);
  EXPECT_THAT(MustOpen(folder.str())->info().notes, ElementsAre());
}

TEST(FrameSource, ListsOfOtherMachines) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  const auto notes_of = [&](const std::string& list) {
    folder.Write("times.txt", list);
    const auto source = MustOpen(folder.str());
    if (source == nullptr) return std::vector<std::string>();
    for (const SourceFrame& frame : All(*source)) EXPECT_TRUE(frame.status.ok()) << frame.status;
    return source->info().notes;
  };
  EXPECT_THAT(notes_of("1.0 images\\0.png\n1.1 images\\1.png\n"),
              ElementsAre(HasSubstr("is taken to be images/0.png")));
  EXPECT_THAT(notes_of("1.0 \"images/0.png\"\n1.1 \"images/1.png\"\n"), ElementsAre(HasSubstr("images/0.png")));
  EXPECT_THAT(notes_of("\"1.0\",\"images/0.png\"\n\"1.1\",\"images/1.png\"\n"), ElementsAre(HasSubstr("images/0.png")));
  EXPECT_THAT(notes_of("1.0;images/0.png\n1.1;images/1.png\n"), ElementsAre());
  EXPECT_THAT(notes_of("1.0 C:\\me\\images\\0.png\n1.1 C:\\me\\images\\1.png\n"),
              ElementsAre(HasSubstr("images/0.png")));
  EXPECT_THAT(notes_of("1.0 /home/me/images/0.png 1.0 depth/0.png\n1.1 /home/me/images/1.png 1.1 depth/1.png\n"),
              ElementsAre(HasSubstr("images/0.png")));
  EXPECT_THAT(notes_of("timestamp,filename\n1.0,images/0.png\n1.1,images/1.png\n"), ElementsAre());
}

TEST(FrameSource, UnitsOfTimesAreCheckedAgainstTheRate) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  const auto list = [](std::initializer_list<const char*> times) {
    std::string text;
    int i = 0;
    for (const char* time : times) absl::StrAppend(&text, time, " images/", i++, ".png\n");
    return text;
  };
  const auto opened = [&](const std::string& text) {
    folder.Write("times.txt", text);
    return MustOpen(folder.str());
  };
  auto source = opened(list({"0", "100", "200"}));  // the camera file says 10 Hz
  EXPECT_EQ(source->info().last_time_ns, 200'000'000);
  EXPECT_THAT(source->info().notes, ElementsAre(HasSubstr("milliseconds, by the 10 Hz")));
  source = opened(list({"0", "1", "2", "3"}));
  EXPECT_EQ(source->info().last_time_ns, 300'000'000);
  EXPECT_THAT(source->info().notes, ElementsAre(HasSubstr("frame numbers")));
  source = opened("# time_us filename\n" + list({"0", "100000", "200000"}));
  EXPECT_EQ(source->info().last_time_ns, 200'000'000);
  source = opened(list({"0.0", "0.5", "1.0"}));
  EXPECT_EQ(source->info().last_time_ns, 1'000'000'000);
  EXPECT_THAT(source->info().notes, ElementsAre(HasSubstr("the camera file says 10 Hz; the times are used")));
  folder.Write("times.txt", list({"0", "33", "66"}));
  EXPECT_THAT(OpenError(folder.str()), AllOf(HasSubstr("33 s apart (0.0303 Hz)"), HasSubstr("in milliseconds 0.033 s"),
                                             HasSubstr("`# time [ms] filename`")));
  folder.Write("camera.yaml", "model: pinhole\nresolution_px: [32, 24]\nintrinsics_px: [30, 30, 15.5, 11.5]\n");
  for (const auto& times : {list({"0", "33", "67", "100"}), list({"0", "33.4", "66.7"}), list({"0", "1", "2", "3"})}) {
    folder.Write("times.txt", times);
    EXPECT_THAT(OpenError(folder.str()), AllOf(HasSubstr("not clear"), HasSubstr("rate_hz")));
  }
}

TEST(FrameSource, TheOnlyColourCameraOfKitti) {
  const TestingFolder folder;
  folder.Write("calib.txt", "P0: 71 0 16 0 0 71 12 0 0 0 1 0\nP2: 70 0 15 44 0 69 11 0 0 0 1 0\n");
  folder.Write("times.txt", "0\n0.1\n0.2\n");
  for (int i = 0; i < 3; ++i) folder.WriteImage(absl::StrFormat("image_2/%06d.png", i), i);
  const auto source = MustOpen(folder.str());
  ASSERT_NE(source, nullptr);
  EXPECT_EQ(source->info().format, SequenceFormat::kKitti);
  EXPECT_EQ(source->info().camera.fx_px, 70.0);
  EXPECT_THAT(source->info().notes, ElementsAre(HasSubstr("image_2/ is used, with P2")));
  OpenOptions options;
  options.camera_index = 0;
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("image_0"));
}

TEST(FrameSource, KittiImagesWithoutZerosInFront) {
  const TestingFolder folder;
  folder.Write("calib.txt", "P0: 71 0 16 0 0 71 12 0 0 0 1 0\n");
  std::string times;
  for (int i = 0; i < 12; ++i) {
    folder.WriteImage(absl::StrCat("image_0/", i, ".png"), i);
    absl::StrAppend(&times, 0.1 * i, "\n");
  }
  folder.Write("times.txt", times);
  EXPECT_THAT(All(*MustOpen(folder.str()))[10].path, HasSubstr("/10.png"));
}

class TumMono : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_.Write("camera.txt", "0.9 1.2 0.5 0.5 0.92\n32 24\ncrop\n640 480\n");
    folder_.Write("times.txt",
                  "00000 1464106955.943950 0.123456\n00001 1464106955.993950 2.5\n00002 1464106956.04395 0\n");
    for (int i = 0; i < 3; ++i) folder_.WriteImage(absl::StrFormat("images/%05d.jpg", i), i);
  }
  Camera CameraOf(const std::string& text) {
    folder_.Write("camera.txt", text);
    const auto source = MustOpen(folder_.str());
    return source == nullptr ? Camera() : source->info().camera;
  }

  TestingFolder folder_;
};

TEST_F(TumMono, ReadsTimesExposuresAndCalibration) {
  std::string response;
  for (int i = 0; i < 256; ++i) absl::StrAppend(&response, i * i + i, " ");
  folder_.Write("pcalib.txt", response);
  folder_.WriteImage("vignette.png", cv::Mat(24, 32, CV_16UC1, cv::Scalar(50000)));
  const auto source = MustOpen(folder_.str());
  ASSERT_NE(source, nullptr);
  const SourceInfo& info = source->info();
  EXPECT_EQ(info.format, SequenceFormat::kTumMono);
  EXPECT_EQ(info.camera, (Camera{CameraModel::kFov, 32, 24, 0.9 * 32, 1.2 * 24, 15.5, 11.5, {0.92}}));
  ASSERT_TRUE(info.photometric.has_value());
  EXPECT_TRUE(info.photometric->has_response());
  EXPECT_TRUE(info.photometric->has_vignette());
  EXPECT_NEAR(info.rate_hz, 20, 1e-9);
  const auto frames = All(*source);
  ASSERT_EQ(frames.size(), 3u);
  EXPECT_EQ(frames[0].time_ns, 1464106955943950000);
  EXPECT_DOUBLE_EQ(frames[0].exposure_s, 0.000123456);
  EXPECT_DOUBLE_EQ(frames[1].exposure_s, 0.0025);
  EXPECT_EQ(frames[2].exposure_s, 0.0);
  for (const SourceFrame& frame : frames) EXPECT_TRUE(frame.status.ok()) << frame.status;

  folder_.WriteImage("vignette.png", cv::Mat(10, 32, CV_16UC1, cv::Scalar(50000)));
  EXPECT_THAT(OpenError(folder_.str()), AllOf(HasSubstr("vignette.png"), HasSubstr("32x10"), HasSubstr("32x24")));
  std::filesystem::remove(folder_ / "vignette.png");
  folder_.Write("pcalib.txt", "1 2 3");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("pcalib.txt holds 3"));
}

TEST_F(TumMono, EveryFormOfCamera) {
  EXPECT_EQ(CameraOf("28 29 15 11 0.9\n32 24\n"), (Camera{CameraModel::kFov, 32, 24, 28, 29, 15, 11, {0.9}}));
  EXPECT_EQ(CameraOf("FOV 28 29 15 11 0.9\n32 24\nnone\n32 24\n"),
            (Camera{CameraModel::kFov, 32, 24, 28, 29, 15, 11, {0.9}}));
  EXPECT_EQ(CameraOf("28 29 15 11 0\n32 24\n"), Camera::FromPinhole({32, 24, 28, 29, 15, 11}));
  EXPECT_EQ(CameraOf("Pinhole 28 29 15 11 0\n32 24\n"), Camera::FromPinhole({32, 24, 28, 29, 15, 11}));
  EXPECT_EQ(CameraOf("Pinhole 1 1 0.5 0.5 0\n32 24\n0.5 0.5 0.5 0.5 0\n"),
            Camera::FromPinhole({32, 24, 32, 24, 15.5, 11.5}));
  EXPECT_EQ(CameraOf("RadTan 28 29 15 11 -0.1 0.01 1e-4 0\n32 24\n"),
            (Camera{CameraModel::kRadialTangential, 32, 24, 28, 29, 15, 11, {-0.1, 0.01, 1e-4, 0}}));
  EXPECT_EQ(CameraOf("28 29 15 11 -0.1 0.01 1e-4 0\n32 24\n").model, CameraModel::kRadialTangential);
  EXPECT_EQ(CameraOf("EquiDistant 28 29 15 11 -0.1 0.01 1e-4 0\n32 24\n").model, CameraModel::kKannalaBrandt);
  EXPECT_EQ(CameraOf("KannalaBrandt 28 29 15 11 -0.1 0.01 1e-4 0\r\n32 24\r\n").model, CameraModel::kKannalaBrandt);
  const auto error = [&](const std::string& text) {
    folder_.Write("camera.txt", text);
    return OpenError(folder_.str());
  };
  EXPECT_THAT(error("Omni 1 2 3 4\n32 24\n"), HasSubstr("camera.txt:1: unknown camera `omni`"));
  EXPECT_THAT(error("1 2 3\n32 24\n"), HasSubstr("camera.txt:1: 3 numbers"));
  EXPECT_THAT(error("28 29 15 x 0\n32 24\n"), HasSubstr("\"x\" is not a number"));
  EXPECT_THAT(error("28 29 15 11 0\n32\n"), HasSubstr("camera.txt:2: expected `width height`"));
  EXPECT_THAT(error("28 29 15 11 0\n"), HasSubstr("must have a line"));
  EXPECT_THAT(error(",\n,\n"), HasSubstr("camera.txt:1"));
}

TEST_F(TumMono, MissingImagesAndArchives) {
  std::filesystem::remove(folder_ / "images/00001.jpg");
  EXPECT_EQ(All(*MustOpen(folder_.str()))[1].status.code(), absl::StatusCode::kNotFound);
  // Named otherwise: taken in order if the numbers agree.
  for (int i = 0; i < 3; ++i) {
    std::filesystem::remove(folder_ / absl::StrFormat("images/%05d.jpg", i));
    folder_.WriteImage(absl::StrFormat("images/frame%d.png", i), i);
  }
  EXPECT_THAT(All(*MustOpen(folder_.str()))[2].path, HasSubstr("frame2.png"));
  std::filesystem::remove(folder_ / "images/frame1.png");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("3 lines but images/ has 2"));
  std::filesystem::remove_all(folder_ / "images");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("no images in"));
  folder_.Write("images.zip", "PK");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("unzip "));
}

TEST_F(TumMono, DamagedTimes) {
  folder_.Write("times.txt", "00000\n");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("times.txt:1: expected `id seconds exposure_ms`"));
  folder_.Write("times.txt", "00000 1.0 -3\n");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("not an exposure time"));
  folder_.Write("times.txt", "00000 1.0 3\n00001 0.5 3\n");
  EXPECT_THAT(OpenError(folder_.str()), HasSubstr("times.txt:2"));
}

TEST(FrameSource, PlainImages) {
  for (const std::string where : {"", "images/"}) {
    const TestingFolder folder;
    folder.Write("camera.yaml", kCamera);
    for (const char* name : {"b.png", "a.png", "c.JPG"}) folder.WriteImage(where + name, 5);
    folder.Write(where + "notes.txt", "x");
    const auto source = MustOpen(folder.str());
    ASSERT_NE(source, nullptr);
    EXPECT_EQ(source->info().format, SequenceFormat::kImages);
    const auto frames = All(*source);
    ASSERT_EQ(frames.size(), 3u);
    EXPECT_THAT(frames[0].path, HasSubstr("a.png"));
    EXPECT_THAT(frames[2].path, HasSubstr("c.JPG"));
    EXPECT_EQ(frames[2].time_ns, 200000000);
    folder.Write("camera.yaml", "model: pinhole\nresolution_px: [32, 24]\nintrinsics_px: [30, 30, 15.5, 11.5]\n");
    EXPECT_THAT(OpenError(folder.str()), HasSubstr("rate_hz"));
  }
}

TEST(FrameSource, SixteenBitsBecomeEightByOneRangeForAllImages) {
  const TestingFolder folder;
  folder.Write("camera.yaml", kCamera);
  cv::Mat dark, bright;
  TestingFolder::Ramp(0).convertTo(dark, CV_16U, 4.0);      // up to 556
  TestingFolder::Ramp(90).convertTo(bright, CV_16U, 16.0);  // up to 3664: 12 bits
  folder.WriteImage("0.png", dark);
  folder.WriteImage("1.png", bright);
  const auto source = MustOpen(folder.str());
  ASSERT_NE(source, nullptr);
  EXPECT_THAT(source->info().notes, ElementsAre(HasSubstr("values from 0 to 4095 become 0 to 255")));
  const auto frames = All(*source);
  cv::Mat expected;
  dark.convertTo(expected, CV_8U, 255.0 / 4095.0);
  EXPECT_EQ(cv::norm(frames[0].gray, expected, cv::NORM_INF), 0);
  bright.convertTo(expected, CV_8U, 255.0 / 4095.0);
  EXPECT_EQ(cv::norm(frames[1].gray, expected, cv::NORM_INF), 0);
}

TEST(FrameSource, AMaskHidesWhatIsBlackInIt) {
  const TestingFolder folder;
  WriteTimesFolder(folder);
  cv::Mat mask(24, 32, CV_8U, cv::Scalar(255));
  mask.rowRange(12, 24).setTo(0);
  folder.WriteImage("mask.png", mask);
  OpenOptions options;
  options.mask_path = folder / "mask.png";
  const cv::Mat gray = All(*MustOpen(folder.str(), options))[0].gray;
  EXPECT_EQ(cv::norm(gray.rowRange(0, 12), TestingFolder::Ramp(0).rowRange(0, 12), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(gray.rowRange(20, 24), TestingFolder::Ramp(0).rowRange(20, 24), cv::NORM_INF), 5);
  folder.WriteImage("mask.png", cv::Mat(24, 32, CV_8U, cv::Scalar(0)));
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("shows 0.0 % of the view"));
  folder.WriteImage("mask.png", cv::Mat(48, 64, CV_8U, cv::Scalar(255)));
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("64x48"));
  options.mask_path = folder / "none.png";
  EXPECT_THAT(OpenError(folder.str(), options), HasSubstr("none.png"));
}

TEST(ReadGrayImage, KindsOfPixels) {
  const TestingFolder folder;
  cv::Mat deep;
  TestingFolder::Ramp(9).convertTo(deep, CV_16U, 257);
  folder.WriteImage("deep.png", deep);
  EXPECT_EQ(cv::norm(*ReadGrayImage(folder / "deep.png"), TestingFolder::Ramp(9), cv::NORM_INF), 0);
  cv::Mat color, alpha;
  cv::cvtColor(TestingFolder::Ramp(9), color, cv::COLOR_GRAY2BGR);
  cv::cvtColor(TestingFolder::Ramp(9), alpha, cv::COLOR_GRAY2BGRA);
  folder.WriteImage("color.jpg", color);
  folder.WriteImage("alpha.png", alpha);
  EXPECT_EQ(ReadGrayImage(folder / "color.jpg")->type(), CV_8UC1);
  EXPECT_LE(cv::norm(*ReadGrayImage(folder / "alpha.png"), TestingFolder::Ramp(9), cv::NORM_INF), 1);
  folder.WriteImage("float.tiff", cv::Mat(5, 5, CV_32FC1, cv::Scalar(1)));
  EXPECT_EQ(ReadGrayImage(folder / "float.tiff").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(ReadGrayImage, AnyTruncationIsFound) {
  const TestingFolder folder;
  for (const std::string name : {"a.jpg", "a.png", "a.bmp", "a.pgm", "a.tiff"}) {
    // The end of a TIFF file may hold nothing that belongs to the pixels.
    for (int percent = 1; percent < (name == "a.tiff" ? 90 : 100); percent += 7) {
      folder.WriteImage(name, 3);
      ASSERT_TRUE(ReadGrayImage(folder / name).ok());
      folder.Truncate(name, percent / 100.0);
      EXPECT_EQ(ReadGrayImage(folder / name).status().code(), absl::StatusCode::kDataLoss) << name << " " << percent;
    }
  }
}

TEST(FrameSource, WhatIsNoFileIsSkippedAndNeverWaitedFor) {
  const TestingFolder folder;
  folder.Write("camera.yaml",
               "model: pinhole\nresolution_px: [32, 24]\nintrinsics_px: [30, 30, 16, 12]\nrate_hz: 10\n");
  folder.WriteImage("a.png", 1);
  ASSERT_EQ(mkfifo((folder / "b.png").c_str(), 0600), 0);
  std::filesystem::create_directory(folder / "c.png");
  std::filesystem::create_symlink("/dev/zero", folder / "d.png");
  folder.WriteImage("e.png", 2);
  auto source = FrameSource::Open(folder.str());
  ASSERT_TRUE(source.ok()) << source.status();
  for (const bool usable : {true, false, false, false, true}) {
    const auto frame = (*source)->Next();
    ASSERT_TRUE(frame.ok() && frame->has_value());
    EXPECT_EQ((*frame)->status.ok(), usable) << (*frame)->path << (*frame)->status;
  }
  EXPECT_FALSE((*source)->Next()->has_value());
  EXPECT_TRUE(absl::IsInvalidArgument(LoadCamera("/dev/zero").status()));
  folder.Write("large.yaml", std::string(2 << 20, '#'));
  EXPECT_TRUE(absl::IsInvalidArgument(LoadCamera(folder / "large.yaml").status()));
}

}  // namespace
}  // namespace cairn::io
