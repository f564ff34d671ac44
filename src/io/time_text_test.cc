#include "io/time_text.h"

#include <gtest/gtest.h>

#include <limits>

namespace cairn::io {
namespace {

TEST(TimeText, SecondsAreExact) {
  EXPECT_EQ(*ParseSeconds("1403715273.262142976"), 1403715273262142976);
  EXPECT_EQ(*ParseSeconds("1403715273.262143104"), 1403715273262143104);
  EXPECT_EQ(*ParseSeconds("0"), 0);
  EXPECT_EQ(*ParseSeconds("33.3"), 33300000000);
  EXPECT_EQ(*ParseSeconds("0.000000"), 0);
  EXPECT_EQ(*ParseSeconds(".5"), 500000000);
  EXPECT_EQ(*ParseSeconds("5."), 5000000000);
  EXPECT_EQ(*ParseSeconds("-1.25"), -1250000000);
  EXPECT_EQ(*ParseSeconds("+1.25"), 1250000000);
  EXPECT_EQ(*ParseSeconds("00012.5"), 12500000000);
}

TEST(TimeText, Exponents) {
  EXPECT_EQ(*ParseSeconds("1.036000e-01"), 103600000);
  EXPECT_EQ(*ParseSeconds("2.061640e+01"), 20616400000);
  EXPECT_EQ(*ParseSeconds("0.000000e+00"), 0);
  EXPECT_EQ(*ParseSeconds("0e500"), 0);
  EXPECT_EQ(*ParseSeconds("1e-30"), 0);
  EXPECT_EQ(*ParseSeconds("1E3"), 1000000000000);
}

TEST(TimeText, DigitsBeyondNanosecondsAreRounded) {
  EXPECT_EQ(*ParseSeconds("0.1234567894"), 123456789);
  EXPECT_EQ(*ParseSeconds("0.1234567895"), 123456790);
  EXPECT_EQ(*ParseSeconds("0.99999999999"), 1000000000);
  EXPECT_EQ(*ParseSeconds("0.0000000005"), 1);
  EXPECT_EQ(*ParseSeconds("0.00000000049999"), 0);
  EXPECT_EQ(*ParseSeconds("0.00000000005"), 0);
  EXPECT_EQ(*ParseSeconds("-0.0000000005"), -1);
  EXPECT_EQ(*ParseSeconds("1464106955.94395000000000000000000001"), 1464106955943950000);
}

TEST(TimeText, RefusesWhatIsNoTime) {
  for (const char* text : {"", "abc", "1.2.3", "nan", "inf", "1e", "1e+", "12x", "-", ".", " 1", "1 ", "0x10", "1e99",
                           "99999999999", "1e+ 3", "--1"}) {
    EXPECT_FALSE(ParseSeconds(text).ok()) << text;
  }
  for (const char* text : {"", "1.5", "x", " 1", "99999999999999999999"})
    EXPECT_FALSE(ParseNanoseconds(text).ok()) << text;
}

TEST(TimeText, ThereAndBack) {
  for (const TimeNs t : {TimeNs{0}, TimeNs{1}, TimeNs{-1}, TimeNs{1403715273262142976}, TimeNs{-2500000000}}) {
    EXPECT_EQ(*ParseSeconds(FormatSeconds(t)), t);
  }
  EXPECT_EQ(FormatSeconds(1403715273262142976), "1403715273.262142976");
  EXPECT_EQ(FormatSeconds(-5), "-0.000000005");
  EXPECT_EQ(FormatSeconds(std::numeric_limits<TimeNs>::min()), "-9223372036.854775808");
  EXPECT_EQ(*ParseNanoseconds("1403715273262142976"), 1403715273262142976);
}

}  // namespace
}  // namespace cairn::io
