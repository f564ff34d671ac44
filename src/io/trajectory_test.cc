#include "io/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"
#include "io/testing_folder.h"
#include "io/text_lines.h"

namespace cairn::io {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<StampedPose> SomePoses() {
  Random random(1);
  std::vector<StampedPose> poses;
  for (int i = 0; i < 20; ++i) {
    Vector6d x;
    for (int k = 0; k < 6; ++k) x[k] = random.Normal();
    poses.push_back({1403715273262142976 + i * 50000128, SE3::Exp(x)});
  }
  return poses;
}

TEST(Trajectory, TumThereAndBack) {
  const TestingFolder folder;
  const std::vector<StampedPose> poses = SomePoses();
  ASSERT_TRUE(WriteTumTrajectory(folder / "a.txt", poses, {.overwrite = false, .comment = "made by a test"}).ok());
  const auto read = ReadTrajectory(folder / "a.txt");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->poses.size(), poses.size());
  EXPECT_EQ(read->num_nan_rows(), 0);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(read->poses[i].time_ns, poses[i].time_ns);
    EXPECT_LT((read->poses[i].world_from_camera.Matrix() - poses[i].world_from_camera.Matrix()).norm(), 1e-8);
  }
  EXPECT_THAT(folder.Read("a.txt"), HasSubstr("# made by a test\n"));
  EXPECT_THAT(folder.Read("a.txt"), HasSubstr("\n1403715273.262142976 "));
  EXPECT_EQ(folder.Read("a.txt"), FormatTumTrajectory(poses, "made by a test"));
}

TEST(Trajectory, TumToleratesCommentsCommasExtraColumnsAndNan) {
  const TestingFolder folder;
  folder.Write("a.txt",
               "\xEF\xBB\xBF# comment\r\n\r\n1.5 1 2 3 0 0 0 1 9000 0\r\n2 nan NaN nan nan nan nan nan\n"
               "0.5,4,5,6,0,0,1,0\n  3\t7 8 9 0 0 0.7 0.7\n");
  const auto read = ReadTrajectory(folder / "a.txt");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->poses.size(), 3u);
  EXPECT_EQ(read->num_rows, 4);
  EXPECT_EQ(read->num_nan_rows(), 1);
  EXPECT_THAT(read->rows, ElementsAre(0, 2, 3));
  EXPECT_EQ(read->poses[0].time_ns, 1500000000);
  EXPECT_EQ(read->poses[1].time_ns, 500000000);
  EXPECT_EQ(read->poses[1].world_from_camera.translation(), Vector3d(4, 5, 6));
  EXPECT_NEAR(AngleRad(read->poses[2].world_from_camera.rotation()), 1.5707963267948966, 1e-9);
}

TEST(Trajectory, TumErrorsNameTheLine) {
  const TestingFolder folder;
  const auto error = [&](absl::string_view text) {
    folder.Write("a.txt", text);
    const auto read = ReadTrajectory(folder / "a.txt");
    EXPECT_FALSE(read.ok());
    return std::string(read.status().message());
  };
  EXPECT_THAT(error("# x\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0\n"), HasSubstr("a.txt:3: 7 columns"));
  EXPECT_THAT(error("1 0 0 zero 0 0 0 1\n"), HasSubstr("a.txt:1: column 4, \"zero\""));
  EXPECT_THAT(error("1 0 0 inf 0 0 0 1\n"), HasSubstr("column 4"));
  EXPECT_THAT(error("x 0 0 0 0 0 0 1\n"), HasSubstr("a.txt:1: \"x\" is not a time"));
  EXPECT_THAT(error("1 0 0 0 0 0 0 0\n"), HasSubstr("quaternion has length 0"));
  EXPECT_THAT(error("# nothing\n"), HasSubstr("no poses"));
  const auto empty = ReadTrajectory(folder / "a.txt", /*may_be_empty=*/true);
  ASSERT_TRUE(empty.ok()) << empty.status();
  EXPECT_TRUE(empty->poses.empty());
  EXPECT_THAT(error(",\n"), HasSubstr("a.txt:1"));
  EXPECT_EQ(ReadTrajectory(folder / "none.txt").status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(ReadTrajectory(folder.str()).ok());
}

TEST(Trajectory, EurocGroundTruth) {
  const TestingFolder folder;
  folder.Write("data.csv",
               "#timestamp, p_RS_R_x [m], ...\n"
               "1403715274302142976,0.878612,2.142470,0.947262,0.060514,-0.828459,-0.058956,-0.553641,0.009474,-0.01\n"
               "1403715274307142912, 1, 2, 3, 1, 0, 0, 0\r\n");
  const auto read = ReadTrajectory(folder / "data.csv");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->poses.size(), 2u);
  EXPECT_EQ(read->poses[0].time_ns, 1403715274302142976);
  EXPECT_NEAR(read->poses[0].world_from_camera.rotation().w(), 0.060514, 1e-5);
  EXPECT_NEAR(read->poses[0].world_from_camera.rotation().z(), -0.553641, 1e-5);
  EXPECT_EQ(read->poses[1].world_from_camera.translation(), Vector3d(1, 2, 3));
  folder.Write("bad.csv", "1403715274302142976,1,2,3,1,0,0,0\n1.5,1,2,3,1,0,0,0\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "bad.csv").status().message()), HasSubstr("bad.csv:2"));
}

TEST(Trajectory, KittiPoses) {
  const TestingFolder folder;
  folder.Write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n0 -1 0 5 1 0 0 6 0 0 1 7\n");
  folder.Write("times.txt", "0.000000e+00\n1.036000e-01\n2e-1\n");
  const auto read = ReadTrajectory(folder / "poses.txt");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->poses.size(), 2u);
  EXPECT_EQ(read->poses[1].time_ns, 103600000);
  EXPECT_EQ(read->poses[1].world_from_camera.translation(), Vector3d(5, 6, 7));
  EXPECT_LT((read->poses[1].world_from_camera * Vector3d(1, 0, 0) - Vector3d(5, 7, 7)).norm(), 1e-12);
  folder.Write("times.txt", "0\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "poses.txt").status().message()), HasSubstr("poses.txt:2: no time"));
  folder.Write("times.txt", "0\n1\n");
  folder.Write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n2 0 0 0 0 2 0 0 0 0 2 0\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "poses.txt").status().message()),
              HasSubstr("poses.txt:2: the first three columns"));
}

TEST(Trajectory, KittiPosesWithoutTimesAreNoTumTrajectory) {
  const TestingFolder folder;
  // The columns 5 to 8 of these are quaternions, too.
  folder.Write("poses.txt", "1 0 0 0.1 0 1 0 0.02 0 0 1 0.3\n0.9999 0.01 0 0.2 -0.01 0.9999 0 0.03 0 0 1 0.4\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "poses.txt").status().message()),
              AllOf(HasSubstr("matrices (KITTI) without times"), HasSubstr("times.txt")));
  // Where the data set has them.
  std::filesystem::create_directories(folder / "poses");
  std::filesystem::rename(folder / "poses.txt", folder / "poses/03.txt");
  folder.Write("sequences/03/times.txt", "0\n0.1\n");
  EXPECT_EQ(ReadTrajectory(folder / "poses/03.txt")->poses[1].time_ns, 100'000'000);
}

TEST(Trajectory, MatricesInWhateverForm) {
  const TestingFolder folder;
  folder.Write("whole.txt", "1 0 0 4 0 1 0 5 0 0 1 6 0 0 0 1\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "whole.txt").status().message()), HasSubstr("without times"));
  folder.Write("timed.txt", "7.5 0 -1 0 4 1 0 0 5 0 0 1 6\n");
  folder.Write("timed_whole.txt", "7.5 0 -1 0 4 1 0 0 5 0 0 1 6 0 0 0 1\n");
  for (const char* name : {"timed.txt", "timed_whole.txt"}) {
    const auto read = ReadTrajectory(folder / name);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(read->poses[0].time_ns, 7'500'000'000);
    EXPECT_EQ(read->poses[0].world_from_camera.translation(), Vector3d(4, 5, 6));
  }
  // Twelve columns that are no matrix, beside a times.txt: TUM format with four more columns.
  folder.Write("times.txt", "0\n");
  folder.Write("tum.txt", "7.5 1 2 3 0 0 0 1 9 9 9 9\n");
  EXPECT_EQ(ReadTrajectory(folder / "tum.txt")->poses[0].time_ns, 7'500'000'000);
}

// Which would be taken for the separator of columns: of other numbers, with a good quaternion even.
TEST(Trajectory, DecimalCommasAreRefused) {
  const TestingFolder folder;
  for (const char* line : {"7,5 1,25 2,0 3,0 0 1 0 1", "# t tx ty tz qx qy qz qw\n7,5 1 2 3 0 0 0 1 0 0 1"}) {
    folder.Write("commas.txt", line);
    const absl::Status refused = ReadTrajectory(folder / "commas.txt").status();
    EXPECT_THAT(std::string(refused.message()), HasSubstr("12 columns, and `t tx ty tz qx qy qz qw` are 8"));
    EXPECT_THAT(std::string(refused.message()), HasSubstr("the decimal sign is a point"));
  }
  folder.Write("csv.txt", "7.5,1,2,3,0,0,0,1,9\n");
  EXPECT_TRUE(ReadTrajectory(folder / "csv.txt").ok()) << "a column more, and no decimal comma";
}

TEST(TextTable, FurtherColumnsNeedAHeaderThatNamesThem) {
  const TextLine line{3, "1 60.1 24.9 500,323"};
  const auto check = [&](absl::string_view header) {
    return CheckNoMoreFields("a.txt", line, 5, 4, "a b c d", header);
  };
  EXPECT_THAT(std::string(check("").message()),
              HasSubstr("a.txt:3: 5 columns, and `a b c d` are 4: a comma separates"));
  EXPECT_FALSE(check("time latitude longitude height").ok());
  EXPECT_TRUE(check("time latitude longitude height sigma").ok());
  EXPECT_TRUE(CheckNoMoreFields("a.txt", line, 4, 4, "a b c d").ok());
}

TEST(Trajectory, AHeaderNamesTheColumns) {
  const TestingFolder folder;
  const auto pose_of = [&](const std::string& text) {
    folder.Write("a.csv", text);
    const auto read = ReadTrajectory(folder / "a.csv");
    EXPECT_TRUE(read.ok()) << read.status();
    Trajectory none;
    none.poses.resize(1);
    return read.ok() ? *read : none;
  };
  for (const std::string header :
       {"#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
        "timestamp,tx,ty,tz,qw,qx,qy,qz", "time,x,y,z,qw,qx,qy,qz",
        "\"t\",\"pose.position.x\",\"pose.position.y\",\"pose.position.z\",\"pose.orientation.w\","
        "\"pose.orientation.x\",\"pose.orientation.y\",\"pose.orientation.z\""}) {
    for (const std::string time : {"1600000000.25", "1600000000250000000"}) {
      const Trajectory read = pose_of(header + "\n" + time + ",1,2,3,0.9,0.1,0.3,0.3\n");
      EXPECT_EQ(read.poses[0].time_ns, 1600000000250000000) << header;
      EXPECT_NEAR(read.poses[0].world_from_camera.rotation().w(), 0.9, 1e-9) << header;
      EXPECT_NEAR(read.poses[0].world_from_camera.rotation().x(), 0.1, 1e-9) << header;
      EXPECT_EQ(read.poses[0].world_from_camera.translation(), Vector3d(1, 2, 3));
    }
  }
  EXPECT_EQ(pose_of("# qw qx qy qz tx ty tz t_ms\n0.9 0.1 0.3 0.3 1 2 3 250\n").poses[0].time_ns, 250'000'000);
  EXPECT_THAT(pose_of("# qw qx qy qz tx ty tz t_ms\n0.9 0.1 0.3 0.3 1 2 3 250\n").notes[0],
              HasSubstr("qw qx qy qz tx ty tz t"));
  folder.Write("images.txt", "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n1 1 0 0 0 1 2 3 1 a.png\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "images.txt").status().message()),
              HasSubstr("no column of the header"));
  folder.Write("few.txt", "# t tx ty tz qx qy qz qw\n1 0 0 0 1\n");
  EXPECT_THAT(std::string(ReadTrajectory(folder / "few.txt").status().message()), HasSubstr("names 8 columns"));
}

// A remark that has nothing before its colon names no column; found by fuzzing.
TEST(Trajectory, AHeaderWithoutNamesNamesNothing) {
  const TestingFolder folder;
  folder.Write("a.txt", "#: t t tx ty ;;;qw\n1.5 1 2 3 0 0 0 1\n2.5 1 2 3 0 0 0 1\n");
  const auto read = ReadTrajectory(folder / "a.txt");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->poses.size(), 2u);
  EXPECT_EQ(read->poses[0].world_from_camera.translation(), Vector3d(1, 2, 3));
}

TEST(Trajectory, TimesInOtherUnits) {
  const TestingFolder folder;
  const auto read = [&](const std::string& text) {
    folder.Write("a.txt", text);
    return ReadTrajectory(folder / "a.txt");
  };
  const std::string pose = " 0 0 0 0 0 0 1\n";
  auto trajectory = read("1600000000000000000.000000" + pose + "1600000000050000000.000000" + pose);
  ASSERT_TRUE(trajectory.ok()) << trajectory.status();
  EXPECT_EQ(trajectory->poses[1].time_ns, 1600000000050000000);
  EXPECT_EQ(trajectory->time_unit, TimeUnit::kNanoseconds);
  EXPECT_THAT(trajectory->notes, ElementsAre(HasSubstr("a.txt: the times are nanoseconds, since 1970")));
  trajectory = read("1600000000000.5" + pose + "1600000000050" + pose);
  EXPECT_EQ(trajectory->poses[0].time_ns, 1600000000000500000);
  EXPECT_THAT(std::string(read("0" + pose + "33" + pose + "66" + pose).status().message()),
              AllOf(HasSubstr("not clear"), HasSubstr("33 s apart"), HasSubstr("# t_ms")));
  EXPECT_EQ(read("# t_ms tx ty tz qx qy qz qw\n0" + pose + "33" + pose)->poses[1].time_ns, 33'000'000);
  EXPECT_THAT(
      std::string(read("# t_s tx ty tz qx qy qz qw\n1600000000000" + pose + "1600000000033" + pose).status().message()),
      HasSubstr("correct the header"));
  EXPECT_THAT(read("0" + pose + "1" + pose + "2" + pose)->notes, ElementsAre(HasSubstr("whole numbers one apart")));
  EXPECT_THAT(read("0.5" + pose + "30.5" + pose)->notes, ElementsAre(HasSubstr("30 s apart")));
  EXPECT_THAT(read("0.5" + pose + "0.6" + pose)->notes, ElementsAre());
}

TEST(Trajectory, DoesNotOverwriteUnasked) {
  const TestingFolder folder;
  folder.Write("a.txt", "mine");
  EXPECT_EQ(WriteTumTrajectory(folder / "a.txt", SomePoses()).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(folder.Read("a.txt"), "mine");
  EXPECT_TRUE(WriteTumTrajectory(folder / "a.txt", SomePoses(), {.overwrite = true, .comment = ""}).ok());
  EXPECT_EQ(ReadTrajectory(folder / "a.txt")->poses.size(), 20u);
  EXPECT_EQ(WriteTumTrajectory(folder / "no/such/a.txt", SomePoses()).code(), absl::StatusCode::kNotFound);
  // Nothing but the file is left.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.str()), {}), 1);
}

TEST(Trajectory, ZeroHasNoSign) {
  const StampedPose pose{0, SE3(Quaterniond(1, -1e-12, 0, -0.0), Vector3d(-0.4e-9, -0.6e-9, 2))};
  EXPECT_EQ(FormatTumLine(pose),
            "0.000000000 0.000000000 -0.000000001 2.000000000 0.000000000 0.000000000 0.000000000 1.000000000\n");
}

}  // namespace
}  // namespace cairn::io
