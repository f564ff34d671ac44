#include "wire/image_header.h"

#include <gtest/gtest.h>

#include <string>

namespace cairn::wire {
namespace {

std::string Bytes(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes.push_back(static_cast<char>(value));
  return bytes;
}

const std::string kPng = Bytes(
    {0x89, 'P', 'N', 'G', 13, 10, 26, 10, 0, 0, 0, 13, 'I', 'H', 'D', 'R', 0, 0, 2, 128, 0, 0, 1, 224, 8, 0, 0, 0, 0});
// An application segment, a fill byte, a quantization table without content, then a progressive frame of 640x480.
const std::string kJpeg = Bytes({0xFF, 0xD8, 0xFF, 0xE0, 0, 4, 'J', 'F', 0xFF, 0xFF, 0xDB, 0,    3, 0,
                                 0xFF, 0xC2, 0,    11,   8, 1, 224, 2,   128,  1,    1,    0x11, 0});

TEST(ImageHeader, SizesOfPngAndJpeg) {
  for (const std::string& file : {kPng, kJpeg}) {
    const auto size = EncodedImageSize(file);
    ASSERT_TRUE(size.ok()) << size.status();
    EXPECT_EQ(*size, (ImageSize{640, 480}));
  }
}

TEST(ImageHeader, WhatIsCutOrBrokenIsAnErrorWhereverItEnds) {
  for (std::size_t length = 0; length < 24; ++length) {
    EXPECT_FALSE(EncodedImageSize(kPng.substr(0, length)).ok()) << length;
  }
  for (std::size_t length = 0; length < 23; ++length) {
    EXPECT_FALSE(EncodedImageSize(kJpeg.substr(0, length)).ok()) << length;
  }
  std::string file = kPng;
  file[19] = file[18] = 0;
  EXPECT_FALSE(EncodedImageSize(file).ok()) << "no width";
  file = kPng;
  file[16] = static_cast<char>(0x80);
  EXPECT_FALSE(EncodedImageSize(file).ok()) << "wider than an int";
  file = kJpeg;
  file[5] = 1;
  EXPECT_FALSE(EncodedImageSize(file).ok()) << "a segment shorter than its own length";
  EXPECT_FALSE(EncodedImageSize(Bytes({0xFF, 0xD8, 0xFF, 0xD9, 0, 2, 0, 0})).ok()) << "ends at once";
  EXPECT_FALSE(EncodedImageSize("GIF89a").ok());
}

}  // namespace
}  // namespace cairn::wire
