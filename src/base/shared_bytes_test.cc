#include "base/shared_bytes.h"

#include <gtest/gtest.h>

#include <string>

namespace cairn {
namespace {

TEST(SharedBytes, StayWhereTheyAreWhileSomebodyHasThem) {
  SharedBytes rest;
  const char* at = nullptr;
  {
    std::string text(100, 'a');
    text.append("the end");
    const SharedBytes whole(text);
    at = whole.view().data();
    rest = whole.From(100);
  }
  EXPECT_EQ(rest.view(), "the end");
  EXPECT_EQ(rest.view().data(), at + 100);
  EXPECT_EQ(rest.From(7).size(), 0u);
  EXPECT_EQ(SharedBytes().size(), 0u);
}

TEST(SharedBytes, AreWhatWasWrittenAtAnySize) {
  for (const std::size_t size : {0u, 1u, 4096u, (2u << 20) - 1, 2u << 20, (5u << 20) + 17}) {
    std::span<char> memory;
    const SharedBytes bytes = SharedBytes::New(size, &memory);
    ASSERT_EQ(memory.size(), size);
    for (std::size_t i = 0; i < size; ++i) memory[i] = static_cast<char>(i % 251);
    const SharedBytes copy = bytes.From(size / 2);
    ASSERT_EQ(copy.size(), size - size / 2);
    for (std::size_t i = 0; i < copy.size(); i += 97) {
      ASSERT_EQ(copy.view()[i], static_cast<char>((i + size / 2) % 251)) << size;
    }
  }
}

}  // namespace
}  // namespace cairn
