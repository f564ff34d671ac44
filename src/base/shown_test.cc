#include "base/shown.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Shown, LettersStayAndCommandsDoNot) {
  EXPECT_EQ(Shown("k\xC3\xBC"
                  "che \xE6\x97\xA5"),
            "k\xC3\xBC"
            "che \xE6\x97\xA5");
  EXPECT_EQ(Shown("a\nb\x1B[2J\x7F"), "a\\x0ab\\x1b[2J\\x7f");
  EXPECT_EQ(Shown("\xC2\x9B \xE2\x80\xAE"), "\\xc2\\x9b \\xe2\\x80\\xae") << "of Latin 1, and of Unicode";
  EXPECT_EQ(Shown("\xFF\xC3"), "\\xff\\xc3") << "no UTF-8";
}

TEST(Shown, IsCutBetweenCharacters) {
  EXPECT_EQ(Shown("abc", 3), "abc");
  EXPECT_EQ(Shown("abcd", 3), "abc...");
  EXPECT_EQ(Shown("ab\xC3\xBC", 3), "ab...");
  EXPECT_EQ(Shown("a\n\n", 2), "a\\x0a...");
}

}  // namespace
}  // namespace cairn
