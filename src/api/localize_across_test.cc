#include "api/localize_across.h"

#include <gtest/gtest.h>

namespace cairn::api {
namespace {

AnswerOfMap Of(const std::string& map, int inliers, const std::string& id = "") {
  AnswerOfMap answer{map, absl::OkStatus(), {}};
  answer.answer.localized = inliers > 0;
  answer.answer.inliers = inliers;
  answer.answer.map_id = id.empty() ? map : id;
  return answer;
}

std::string Order(const AcrossAnswer& across) {
  std::string order;
  for (const AnswerOfMap& answer : across.answers) order += answer.map;
  return order;
}

constexpr double kShare = 0.33;

AnswerOfMap WithTwoPlaces(const std::string& map, int inliers) {
  AnswerOfMap answer = Of(map, 0);
  answer.answer.stage = LocalizeStage::kRivals;
  answer.answer.rivals.resize(2);
  for (LocatedPose& rival : answer.answer.rivals) rival.inliers = inliers;
  return answer;
}

TEST(LocalizeAcross, TheBestMapUnlessAnotherFitsAboutAsWell) {
  AcrossAnswer across = JudgeAcross({Of("c", 0), Of("b", 53), Of("a", 741)}, kShare);
  EXPECT_EQ(across.map, "a");
  EXPECT_FALSE(across.ambiguous);
  EXPECT_TRUE(across.rivals.empty());
  EXPECT_EQ(Order(across), "abc");
  ASSERT_NE(across.located(), nullptr);
  EXPECT_EQ(across.located()->inliers, 741);
  EXPECT_FALSE(JudgeAcross({Of("b", 32), Of("a", 100)}, kShare).ambiguous);
  across = JudgeAcross({Of("a", 34), Of("c", 10), Of("b", 100)}, kShare);
  EXPECT_TRUE(across.ambiguous);
  EXPECT_EQ(across.map, "");
  EXPECT_EQ(across.located(), nullptr);
  EXPECT_EQ(Order(across), "bac");
  EXPECT_EQ(across.rivals, (std::vector<std::string>{"b", "a"})) << "and not what fits much worse";
}

// A map that has the place twice does not leave it to one that hardly fits.
TEST(LocalizeAcross, PlacesOfOneMapAreRivalsToo) {
  AcrossAnswer across = JudgeAcross({WithTwoPlaces("a", 741), Of("b", 53)}, kShare);
  EXPECT_TRUE(across.ambiguous);
  EXPECT_EQ(across.map, "");
  EXPECT_EQ(across.rivals, std::vector<std::string>{"a"});
  across = JudgeAcross({WithTwoPlaces("a", 53), Of("b", 741)}, kShare);
  EXPECT_FALSE(across.ambiguous);
  EXPECT_EQ(across.map, "b");
  EXPECT_TRUE(JudgeAcross({WithTwoPlaces("a", 400), Of("b", 741)}, kShare).ambiguous);
}

TEST(LocalizeAcross, CopiesOfAMapAreNoRivals) {
  const AcrossAnswer across = JudgeAcross({Of("copy", 80, "id"), Of("office", 80, "id"), Of("x", 10)}, kShare);
  EXPECT_FALSE(across.ambiguous);
  EXPECT_EQ(across.map, "copy");
}

TEST(LocalizeAcross, Nowhere) {
  AnswerOfMap broken{"b", absl::DataLossError("damaged"), {}};
  const AcrossAnswer across = JudgeAcross({Of("c", 0), broken, Of("a", 0)}, kShare);
  EXPECT_EQ(across.map, "");
  EXPECT_FALSE(across.ambiguous);
  EXPECT_EQ(Order(across), "abc");
  EXPECT_EQ(JudgeAcross({}, kShare).located(), nullptr);
}

}  // namespace
}  // namespace cairn::api
