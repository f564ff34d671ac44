#include "server/http/multipart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace cairn::server {
namespace {

const std::string kType = "multipart/form-data; boundary=----x42";
const std::string kBody =
    "------x42\r\n"
    "Content-Disposition: form-data; name=\"image\"; filename=\"photo.jpg\"\r\n"
    "Content-Type: image/jpeg\r\n"
    "\r\n"
    "\xFF\xD8 with --\r\n-- in it\r\n\r\n"
    "------x42\r\n"
    "content-disposition: form-data; name=camera\r\n"
    "\r\n"
    "{}\r\n"
    "------x42--\r\n";

TEST(Form, PartsAsCurlSendsThem) {
  const auto parts = ParseForm(kType, kBody);
  ASSERT_TRUE(parts.ok()) << parts.status();
  ASSERT_EQ(parts->size(), 2u);
  EXPECT_EQ((*parts)[0].name, "image");
  EXPECT_EQ((*parts)[0].content, "\xFF\xD8 with --\r\n-- in it\r\n");
  EXPECT_EQ((*parts)[1].name, "camera");
  EXPECT_EQ((*parts)[1].content, "{}");
  EXPECT_TRUE(ParseForm("Multipart/Form-Data; charset=x; boundary=\"----x42\"", kBody).ok());
  EXPECT_TRUE(ParseForm(kType, "------x42--")->empty());
}

TEST(Form, WhatIsNoneIsRefusedWhereverItEnds) {
  EXPECT_FALSE(ParseForm("application/json", kBody).ok());
  EXPECT_FALSE(ParseForm("multipart/form-data", kBody).ok());
  EXPECT_FALSE(ParseForm("multipart/form-data; boundary=----y", kBody).ok());
  const std::size_t whole = kBody.size() - 2;
  for (std::size_t length = 0; length < whole; ++length) {
    EXPECT_EQ(ParseForm(kType, kBody.substr(0, length)).status().code(), absl::StatusCode::kInvalidArgument) << length;
  }
  std::string nameless = kBody;
  nameless.replace(nameless.find("name=\"image\""), 12, "nome=\"image\"");
  EXPECT_FALSE(ParseForm(kType, nameless).ok());
  EXPECT_THAT(
      std::string(ParseForm(kType, "------x42\r\nContent-Disposition: form-data; name=image\r\n\r\nx\r\n" + kBody)
                      .status()
                      .message()),
      testing::HasSubstr("more than one \"image\""));
  std::string many;
  for (int i = 0; i < 40; ++i)
    many += "------x42\r\nContent-Disposition: form-data; name=a" + std::to_string(i) + "\r\n\r\n\r\n";
  EXPECT_THAT(std::string(ParseForm(kType, many + "------x42--").status().message()), testing::HasSubstr("too many"));
}

}  // namespace
}  // namespace cairn::server
