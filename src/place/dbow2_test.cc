#include "place/dbow2.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

namespace cairn::place {
namespace {

using ::testing::HasSubstr;

// Node `parent is_leaf`, all 32 bytes equal to `byte`, `weight`.
std::string Line(int parent, int is_leaf, int byte, const std::string& weight) {
  std::string line = absl::StrCat(parent, " ", is_leaf);
  for (int i = 0; i < 32; ++i) absl::StrAppend(&line, " ", byte);
  return absl::StrCat(line, " ", weight, "\n");
}

std::string Sample() {
  return "2 2 0 0 \n" + Line(0, 0, 0, "0") + Line(0, 1, 255, "1.5") + Line(1, 1, 0, "2.25") + Line(1, 1, 15, "3e-1");
}

absl::StatusOr<Vocabulary> Import(const std::string& text) {
  std::istringstream in(text);
  return ImportDbow2Text(in, "sample.txt");
}

std::string ErrorOf(const std::string& text) {
  const auto vocabulary = Import(text);
  EXPECT_EQ(vocabulary.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(vocabulary.status().message());
}

TEST(Dbow2, ImportsTheTextForm) {
  for (const std::string& text : {Sample(), Sample() + "\n"}) {
    const auto vocabulary = Import(text);
    ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
    EXPECT_EQ(vocabulary->branching(), 2);
    EXPECT_EQ(vocabulary->depth(), 2);
    EXPECT_EQ(vocabulary->num_nodes(), 5u);
    ASSERT_EQ(vocabulary->num_words(), 3u);
    const auto weight_of = [&](std::uint64_t word) {
      return vocabulary->weight(vocabulary->Lookup({word, word, word, word}));
    };
    EXPECT_FLOAT_EQ(weight_of(~0ull), 1.5f);
    EXPECT_FLOAT_EQ(weight_of(0), 2.25f);
    EXPECT_FLOAT_EQ(weight_of(0x0F0F0F0F0F0F0F0Full), 0.3f);
  }
}

TEST(Dbow2, KeepsTheOrderOfBytes) {
  std::string line = "0 1";
  for (int i = 0; i < 32; ++i) absl::StrAppend(&line, " ", i);
  const auto vocabulary = Import("2 1 0 0\n" + line + " 1\n" + Line(0, 1, 255, "1"));
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  const std::string bytes = vocabulary->Serialize();
  for (int i = 0; i < 32; ++i) EXPECT_EQ(bytes[28 + 3 + i], i);
}

TEST(Dbow2, NamesTheLineThatIsWrong) {
  EXPECT_THAT(ErrorOf(""), HasSubstr("sample.txt:1: "));
  EXPECT_THAT(ErrorOf("2 2 0\n"), HasSubstr("sample.txt:1: expected four whole numbers"));
  EXPECT_THAT(ErrorOf("1 2 0 0\n"), HasSubstr("sample.txt:1: k must be"));
  EXPECT_THAT(ErrorOf("2 2 1 0\n"), HasSubstr("only 0 0"));
  EXPECT_THAT(ErrorOf("2 2 0 0\n"), HasSubstr("no nodes"));
  const std::string start = "2 2 0 0\n" + Line(0, 0, 0, "0") + Line(0, 1, 255, "1.5");
  EXPECT_THAT(ErrorOf(start), HasSubstr("sample.txt:2: the node is not a leaf but has no children"));
  EXPECT_THAT(ErrorOf(start + Line(7, 1, 0, "1")), HasSubstr("sample.txt:4: the parent 7 is not an earlier node"));
  EXPECT_THAT(ErrorOf(start + Line(-1, 1, 0, "1")), HasSubstr("sample.txt:4: expected the parent's number"));
  EXPECT_THAT(ErrorOf(start + Line(2, 1, 0, "1")), HasSubstr("sample.txt:4: the parent 2 is a leaf (line 3)"));
  EXPECT_THAT(ErrorOf(start + Line(0, 1, 0, "1")), HasSubstr("sample.txt:4: node 0 has more than k = 2 children"));
  EXPECT_THAT(ErrorOf(start + Line(1, 2, 0, "1")), HasSubstr("sample.txt:4: expected 0 or 1"));
  EXPECT_THAT(ErrorOf(start + Line(1, 1, 256, "1")), HasSubstr("sample.txt:4: expected 32 descriptor bytes"));
  EXPECT_THAT(ErrorOf(start + Line(1, 1, 0, "x")), HasSubstr("sample.txt:4: expected the weight"));
  EXPECT_THAT(ErrorOf(start + Line(1, 1, 0, "-1")), HasSubstr("sample.txt:4: the weight must be"));
  EXPECT_THAT(ErrorOf(start + Line(1, 1, 0, "nan")), HasSubstr("sample.txt:4: the weight must be"));
  EXPECT_THAT(ErrorOf(start + "1 1 3 4\n"), HasSubstr("number 3 is missing"));
  EXPECT_THAT(ErrorOf(start + Line(1, 1, 0, "1 5")), HasSubstr("sample.txt:4: there is more on the line"));
  EXPECT_THAT(ErrorOf(start + Line(1, 0, 0, "1") + Line(3, 1, 0, "1")), HasSubstr("sample.txt:5: the node is deeper"));
}

TEST(Dbow2, ReportsAMissingFile) {
  EXPECT_EQ(ImportDbow2TextFile("/nonexistent.txt").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace cairn::place
