// The real sequences in the folder that CAIRN_DATA_DIR names; skipped without it.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "image/undistort.h"
#include "io/frame_source.h"
#include "io/time_text.h"
#include "io/trajectory.h"

namespace cairn::io {
namespace {

struct Expected {
  const char* folder;
  SequenceFormat format;
  std::int64_t num_frames;
  const char* first_s;
  const char* last_s;
  int width_px;
  int height_px;
  double rate_hz;
  bool distorted;
};

std::string DataPath(const std::string& name) {
  const char* const root = std::getenv("CAIRN_DATA_DIR");
  if (root == nullptr) return "";
  const std::filesystem::path path = std::filesystem::path(root) / name;
  std::error_code ignored;
  return std::filesystem::exists(path, ignored) ? path.string() : "";
}

class RealSequence : public ::testing::TestWithParam<Expected> {};

TEST_P(RealSequence, OpensWhole) {
  const Expected& expected = GetParam();
  const std::string path = DataPath(expected.folder);
  if (path.empty()) GTEST_SKIP() << "set CAIRN_DATA_DIR to a folder that holds " << expected.folder;
  const auto source = FrameSource::Open(path);
  ASSERT_TRUE(source.ok()) << source.status();
  const SourceInfo& info = (*source)->info();
  EXPECT_EQ(info.name, expected.folder);
  EXPECT_EQ(info.format, expected.format);
  EXPECT_EQ(info.num_frames, expected.num_frames);
  EXPECT_EQ(info.first_time_ns, *ParseSeconds(expected.first_s));
  EXPECT_EQ(info.last_time_ns, *ParseSeconds(expected.last_s));
  EXPECT_EQ(info.camera.width_px, expected.width_px);
  EXPECT_EQ(info.camera.height_px, expected.height_px);
  EXPECT_NEAR(info.rate_hz, expected.rate_hz, 0.1);
  const auto undistorter = image::Undistorter::Create(info.camera);
  ASSERT_TRUE(undistorter.ok()) << undistorter.status();
  EXPECT_EQ(undistorter->identity(), !expected.distorted);
  std::int64_t count = 0;
  TimeNs last_ns = info.first_time_ns - 1;
  while (true) {
    const auto frame = (*source)->Next();
    ASSERT_TRUE(frame.ok()) << frame.status();
    if (!frame->has_value()) break;
    ASSERT_TRUE((*frame)->status.ok()) << (*frame)->status;
    EXPECT_EQ((*frame)->index, count++);
    EXPECT_GT((*frame)->time_ns, last_ns);
    last_ns = (*frame)->time_ns;
    ASSERT_EQ((*frame)->gray.size(), cv::Size(expected.width_px, expected.height_px));
    ASSERT_EQ((*frame)->gray.type(), CV_8UC1);
  }
  EXPECT_EQ(count, expected.num_frames);
  EXPECT_EQ(last_ns, info.last_time_ns);
}

INSTANTIATE_TEST_SUITE_P(
    Data, RealSequence,
    ::testing::Values(Expected{"redkitchen", SequenceFormat::kTumRgbd, 910, "0", "33.3", 640, 480, 30, false},
                      Expected{"kitti00", SequenceFormat::kKitti, 200, "0", "20.6164", 1241, 376, 9.65, false},
                      Expected{"apriltag", SequenceFormat::kTimes, 210, "0", "6.966667", 752, 480, 30, false},
                      Expected{"bikes", SequenceFormat::kTimes, 109, "1464888818.024182", "1464888822.322926", 640, 480,
                               25, false},
                      Expected{"euroc_v101_keyframes", SequenceFormat::kEuroc, 100, "1403715273.262142976",
                               "1403715408.762142976", 752, 480, 20, true},
                      Expected{"euroc_v101_moving", SequenceFormat::kEuroc, 90, "1403715285.262142976",
                               "1403715289.712143104", 752, 480, 20, true},
                      Expected{"euroc_v101_static", SequenceFormat::kEuroc, 20, "1403715273.262142976",
                               "1403715274.212143104", 752, 480, 20, true}),
    [](const auto& test) { return std::string(test.param.folder); });

TEST(RealTrajectories, AllFormats) {
  if (DataPath("redkitchen").empty()) GTEST_SKIP() << "set CAIRN_DATA_DIR to the folder of the real sequences";
  const auto rows = [](const std::string& name) {
    const auto read = ReadTrajectory(DataPath(name));
    EXPECT_TRUE(read.ok()) << read.status();
    return read.ok() ? read->num_rows : -1;
  };
  EXPECT_EQ(rows("redkitchen/reference_sfm.txt"), 455);
  EXPECT_EQ(rows("redkitchen/groundtruth.txt"), 1000);
  EXPECT_EQ(rows("kitti00/poses.txt"), 200);
  EXPECT_EQ(rows("apriltag/groundtruth.txt"), 210);
  EXPECT_EQ(rows("euroc_v101_moving/groundtruth_cam0.txt"), 90);
  EXPECT_EQ(rows("euroc_v101_moving/mav0/state_groundtruth_estimate0/data.csv"), 1291);
  for (const char* folder : {"paper_trajectories/euroc_V1_01_left", "paper_trajectories/tum_mono_40"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(DataPath(folder))) {
      if (!entry.is_regular_file()) continue;
      const auto read = ReadTrajectory(entry.path().string());
      EXPECT_TRUE(read.ok()) << read.status();
    }
  }
}

}  // namespace
}  // namespace cairn::io
