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

TEST(LocalizeAcross, TheBestMapUnlessAnotherFitsAboutAsWell) {
  AcrossAnswer across = JudgeAcross({Of("c", 0), Of("b", 49), Of("a", 100)});
  EXPECT_EQ(across.map, "a");
  EXPECT_FALSE(across.ambiguous);
  EXPECT_EQ(Order(across), "abc");
  ASSERT_NE(across.located(), nullptr);
  EXPECT_EQ(across.located()->inliers, 100);
  across = JudgeAcross({Of("a", 50), Of("b", 100)});
  EXPECT_TRUE(across.ambiguous);
  EXPECT_EQ(across.map, "");
  EXPECT_EQ(across.located(), nullptr);
  EXPECT_EQ(Order(across), "ba");
}

TEST(LocalizeAcross, CopiesOfAMapAreNoRivals) {
  const AcrossAnswer across = JudgeAcross({Of("copy", 80, "id"), Of("office", 80, "id"), Of("x", 10)});
  EXPECT_FALSE(across.ambiguous);
  EXPECT_EQ(across.map, "copy");
}

TEST(LocalizeAcross, Nowhere) {
  AnswerOfMap broken{"b", absl::DataLossError("damaged"), {}};
  const AcrossAnswer across = JudgeAcross({Of("c", 0), broken, Of("a", 0)});
  EXPECT_EQ(across.map, "");
  EXPECT_FALSE(across.ambiguous);
  EXPECT_EQ(Order(across), "abc");
  EXPECT_EQ(JudgeAcross({}).located(), nullptr);
}

}  // namespace
}  // namespace cairn::api
