#include "text/text.h"

#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "text/bars.h"

namespace cairn::text {
namespace {

TEST(Shown, WhatCommandsATerminalIsWrittenOut) {
  EXPECT_EQ(Shown("office"), "office");
  EXPECT_EQ(Shown("red\x1b[31m\n"), "red\\x1b[31m\\x0a");
  EXPECT_EQ(Shown("K\xc3\xbc"
                  "che \xe5\x8f\xb0\xe6\x89\x80"),
            "K\xc3\xbc"
            "che \xe5\x8f\xb0\xe6\x89\x80");
  // A lone continuation byte, an overlong slash, a surrogate, a character cut off.
  EXPECT_EQ(Shown("\x80|\xc0\xaf|\xed\xa0\x80|\xe5\x8f"), "\\x80|\\xc0\\xaf|\\xed\\xa0\\x80|\\xe5\\x8f");
  EXPECT_EQ(Shown("\xe2\x80\xae"
                  "abc"),
            "\\xe2\\x80\\xae"
            "abc");  // writes from right to left
}

TEST(Counted, OneIsNoPlural) {
  EXPECT_EQ(Keyframes(0), "0 keyframes");
  EXPECT_EQ(Keyframes(1), "1 keyframe");
  EXPECT_EQ(Points(1234), "1234 points");
}

TEST(DisplayWidth, OfWideAndCombiningCharacters) {
  EXPECT_EQ(DisplayWidth("abc"), 3);
  EXPECT_EQ(DisplayWidth("\xe5\x8f\xb0\xe6\x89\x80"), 4);
  EXPECT_EQ(DisplayWidth("e\xcc\x81"), 1);
}

TEST(Cut, ToColumnsAndNotInsideACharacter) {
  EXPECT_EQ(Cut("office", 6), "office");
  EXPECT_EQ(Cut("office_1", 7), "offi...");
  EXPECT_EQ(Cut("\xe5\x8f\xb0\xe6\x89\x80\xe5\x8f\xb0\xe6\x89\x80", 6), "\xe5\x8f\xb0...");
}

TEST(Wrapped, FitsTheTerminal) {
  std::string words;
  for (int i = 0; i < 100; ++i) absl::StrAppend(&words, "word", i, " ");
  const std::string wrapped = Wrapped(words, "  ", "    ");
  const std::vector<std::string> lines = absl::StrSplit(wrapped, '\n', absl::SkipEmpty());
  ASSERT_GT(lines.size(), 5u);
  for (const std::string& line : lines) EXPECT_LE(DisplayWidth(line), kTextColumns) << line;
  EXPECT_EQ(lines[0].substr(0, 7), "  word0");
  EXPECT_EQ(lines[1].substr(0, 8), "    word");
}

TEST(WrappedOn, WhatIsNoTerminalGetsOneLine) {
  std::FILE* const file = std::tmpfile();
  ASSERT_NE(file, nullptr);
  const std::string text(200, 'x');
  EXPECT_EQ(WrappedOn(file, absl::StrCat(text, " ", text), "  "), absl::StrCat("  ", text, " ", text, "\n"));
  std::fclose(file);
}

TEST(TextTable, LinesUpAndFits) {
  const std::vector<TextColumn> columns = {{"id"}, {"source", true}, {"keyframes"}};
  const std::string table = TextTable(columns, {{"1", "\xe5\x8f\xb0\xe6\x89\x80", "12"}, {"12", "a", "3"}});
  EXPECT_EQ(table,
            "id  source  keyframes\n"
            " 1  \xe5\x8f\xb0\xe6\x89\x80           12\n"
            "12  a               3\n");
  const std::string wide = TextTable(columns, {{"1", std::string(200, 'x'), "12"}});
  for (const absl::string_view line : absl::StrSplit(wide, '\n')) EXPECT_LE(DisplayWidth(line), kTextColumns);
  EXPECT_NE(wide.find("..."), std::string::npos);
}

TEST(Sparkline, TheHigherTheMore) {
  EXPECT_EQ(Sparkline({0, 1, 400, 800}, false), " .=@");
  EXPECT_EQ(Sparkline({0, 1, 400, 800}, true), " ▁▄█");
  EXPECT_EQ(Sparkline({0, 0}, false), "  ");
  EXPECT_EQ(Sparkline({}, false), "");
}

TEST(Bar, IsInProportionAndNeverNothing) {
  EXPECT_EQ(Bar(10, 20, 8, false), "####");
  EXPECT_EQ(Bar(1, 1000, 8, false), "#");
  EXPECT_EQ(Bar(0, 1000, 8, false), "");
  EXPECT_EQ(Bar(0, 0, 8, false), "");
}

}  // namespace
}  // namespace cairn::text
