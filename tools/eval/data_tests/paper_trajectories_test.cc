// The published trajectories of the paper give the paper's medians, to the digit.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>

#include "absl/strings/str_format.h"
#include "eval/ate.h"
#include "eval/loop.h"
#include "eval/statistics.h"
#include "io/trajectory.h"

namespace cairn::eval {
namespace {

std::string DataFolder(const std::string& name) {
  const char* data = std::getenv("CAIRN_DATA_DIR");
  if (data == nullptr) return "";
  const std::filesystem::path folder = std::filesystem::path(data) / "paper_trajectories" / name;
  return std::filesystem::is_directory(folder) ? folder.string() : "";
}

#define CAIRN_DATA_OR_SKIP(folder, name)                           \
  const std::string folder = DataFolder(name);                     \
  if (folder.empty())                                              \
  GTEST_SKIP() << "needs the folder paper_trajectories/" << (name) \
               << " below the one that the environment variable CAIRN_DATA_DIR names"

struct Case {
  const char* system;
  const char* median;
};

TEST(PaperTrajectories, EurocAteMedians) {
  CAIRN_DATA_OR_SKIP(folder, "euroc_V1_01_left");
  const auto groundtruth = io::ReadTrajectory(folder + "/groundtruth.csv");
  ASSERT_TRUE(groundtruth.ok()) << groundtruth.status();
  for (const Case& c : {Case{"our_slam", "0.0899"}, Case{"orb_slam", "0.0967"}, Case{"dso_reduced", "0.1152"}}) {
    std::vector<absl::StatusOr<double>> runs;
    for (int run = 1; run <= 10; ++run) {
      const auto estimate = io::ReadTrajectory(absl::StrFormat("%s/%s/run_%d.txt", folder, c.system, run));
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      const auto ate = EvaluateAte(estimate->poses, groundtruth->poses);
      runs.push_back(ate.ok() ? absl::StatusOr<double>(ate->position_m.rmse) : ate.status());
    }
    EXPECT_EQ(absl::StrFormat("%.4f", SummarizeRuns(runs, 10.0).median), c.median) << c.system;
  }
}

TEST(PaperTrajectories, TumMonoAlignmentErrorMedians) {
  CAIRN_DATA_OR_SKIP(folder, "tum_mono_40");
  const auto groundtruth = io::ReadTrajectory(folder + "/groundtruth.txt");
  ASSERT_TRUE(groundtruth.ok()) << groundtruth.status();
  for (const Case& c : {Case{"our_slam", "0.1637"}, Case{"dso_default", "1.8053"}}) {
    std::vector<absl::StatusOr<double>> runs;
    for (int run = 1; run <= 10; ++run) {
      const auto estimate = io::ReadTrajectory(absl::StrFormat("%s/%s/run_%d.txt", folder, c.system, run));
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      const auto loop = EvaluateLoop(estimate->poses, *groundtruth);
      runs.push_back(loop.ok() ? absl::StatusOr<double>(loop->align_error_m) : loop.status());
    }
    EXPECT_EQ(absl::StrFormat("%.4f", SummarizeRuns(runs, std::numeric_limits<double>::infinity()).median), c.median)
        << c.system;
  }
}

}  // namespace
}  // namespace cairn::eval
