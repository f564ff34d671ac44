#include "server/access/tokens.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "server/access/token_store.h"

namespace cairn::server {
namespace {

using testing::HasSubstr;

constexpr std::int64_t kNow = 1'800'000'000;

Token Wanted(const std::string& name, std::vector<std::string> maps = {"*"}, Right right = Right::kRead) {
  Token token;
  token.name = name;
  token.maps = std::move(maps);
  token.right = right;
  return token;
}

class Tokens : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = testing::TempDir() + "/tokens_test_" + std::to_string(getpid());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directory(folder_);
    path_ = folder_ + "/tokens.json";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string Text() const {
    std::ostringstream text;
    text << std::ifstream(path_).rdbuf();
    return text.str();
  }

  std::string folder_, path_;
};

TEST_F(Tokens, AreKeptAsHashesInAFileOfTheirOwner) {
  Token wanted = Wanted("robot_1", {"office", "lab*"}, Right::kExtend);
  wanted.expires_unix_s = kNow + 60;
  const absl::StatusOr<std::string> secret = CreateToken(path_, wanted, kNow);
  ASSERT_TRUE(secret.ok()) << secret.status();
  EXPECT_THAT(*secret, testing::MatchesRegex("cairn_[A-Za-z0-9_-]{43}"));
  EXPECT_THAT(Text(), testing::Not(HasSubstr(secret->substr(6))));
  struct stat info = {};
  ASSERT_EQ(stat(path_.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
  const absl::StatusOr<std::vector<Token>> read = ReadTokens(path_);
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), 1u);
  EXPECT_EQ(read->front().name, "robot_1");
  EXPECT_EQ(read->front().hash, HashOfToken(*secret));
  EXPECT_EQ(read->front().maps, wanted.maps);
  EXPECT_EQ(read->front().right, Right::kExtend);
  EXPECT_EQ(read->front().created_unix_s, kNow);
  EXPECT_EQ(read->front().expires_unix_s, wanted.expires_unix_s);
  EXPECT_FALSE(read->front().Expired(kNow + 59));
  EXPECT_TRUE(read->front().Expired(kNow + 60));
}

TEST_F(Tokens, HaveOneNameEachUntilTheyAreRevoked) {
  const std::string first = *CreateToken(path_, Wanted("a"), kNow);
  EXPECT_EQ(CreateToken(path_, Wanted("a"), kNow).status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(CreateToken(path_, Wanted("b"), kNow).ok());
  EXPECT_TRUE(RevokeToken(path_, "a").ok());
  EXPECT_EQ(RevokeToken(path_, "a").code(), absl::StatusCode::kNotFound);
  const std::string second = *CreateToken(path_, Wanted("a"), kNow);
  EXPECT_NE(first, second);
  EXPECT_EQ(ReadTokens(path_)->size(), 2u);
}

// Nobody's token is lost when several are made at once.
TEST_F(Tokens, AreMadeOneAfterTheOther) {
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&, i] { EXPECT_TRUE(CreateToken(path_, Wanted("t" + std::to_string(i)), kNow).ok()); });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(ReadTokens(path_)->size(), 8u);
}

TEST_F(Tokens, WhatMakesNoSenseIsRefused) {
  const auto refused = [&](const Token& token) {
    return CreateToken(path_, token, kNow).status().code() == absl::StatusCode::kInvalidArgument;
  };
  EXPECT_TRUE(refused(Wanted("")));
  EXPECT_TRUE(refused(Wanted("a\nb")));
  EXPECT_TRUE(refused(Wanted("a", {})));
  EXPECT_TRUE(refused(Wanted("a", {"office", ""})));
  EXPECT_TRUE(refused(Wanted("a", {"../office"})));
  Token late = Wanted("a");
  late.expires_unix_s = kNow;
  EXPECT_TRUE(refused(late));
  EXPECT_FALSE(std::filesystem::exists(path_));
  EXPECT_FALSE(ParseRight("write").ok());
}

TEST(TokenPatterns, CoverWhatTheySay) {
  const auto covers = [](std::vector<std::string> maps, const std::string& map) {
    return Wanted("a", std::move(maps)).Covers(map);
  };
  EXPECT_TRUE(covers({"office"}, "office"));
  EXPECT_FALSE(covers({"office"}, "office2"));
  EXPECT_FALSE(covers({"office"}, "offic"));
  EXPECT_TRUE(covers({"x", "lab*"}, "lab"));
  EXPECT_TRUE(covers({"x", "lab*"}, "lab_3"));
  EXPECT_FALSE(covers({"x", "lab*"}, "my_lab"));
  EXPECT_TRUE(covers({"*_lab_*"}, "my_lab_lab_3"));
  EXPECT_FALSE(covers({"*a*b*c"}, "aabbcd"));
  EXPECT_TRUE(covers({"*a*b*c"}, "aabbcdc"));
  EXPECT_TRUE(Wanted("a", {"*"}).CoversAll());
  EXPECT_FALSE(Wanted("a", {"lab*", "*b"}).CoversAll());
}

TEST_F(Tokens, AFileThatIsNoneIsNobodysRequest) {
  std::ofstream(path_) << "{";
  const absl::Status status = ReadTokens(path_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr(path_));
}

TEST_F(Tokens, NamesThatAreNoneAreCalledThoseOfTokens) {
  Token token = Wanted("two words", {"*"});
  const absl::Status status = CreateToken(path_, token, kNow).status();
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("\"two words\" is no name of a token"));
}

TEST(TokenFile, MistakesAreNamed) {
  const auto says = [](const std::string& text) {
    const absl::Status status = ParseTokens(text).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    return std::string(status.message());
  };
  const std::string hash(64, 'a');
  const auto file = [&](const std::string& entry) { return R"({"version":1,"tokens":[)" + entry + "]}"; };
  const std::string good =
      R"({"name":"a","hash":")" + hash + R"(","maps":["*"],"rights":"read","created":"2026-11-26T00:00:00Z"})";
  ASSERT_TRUE(ParseTokens(file(good)).ok());
  EXPECT_THAT(says(""), HasSubstr("no file of tokens"));
  EXPECT_THAT(says("[]"), HasSubstr("no file of tokens"));
  EXPECT_THAT(says(R"({"version":2,"tokens":[]})"), HasSubstr("version"));
  EXPECT_THAT(says(file("3")), HasSubstr("token 1: it is no object"));
  EXPECT_THAT(says(file(good + "," + good)), HasSubstr("two tokens a"));
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = good;
    return file(changed.replace(changed.find(from), from.size(), to));
  };
  EXPECT_THAT(says(with("maps", "map")), HasSubstr("no key `map`"));
  EXPECT_THAT(says(with("[\"*\"]", "\"*\"")), HasSubstr("`maps` must be a list"));
  EXPECT_THAT(says(with("\"read\"", "\"write\"")), HasSubstr("read, extend, admin"));
  EXPECT_THAT(says(with(hash, "abc")), HasSubstr("64 hex digits"));
  EXPECT_THAT(says(with("2026-11-26T", "yesterday ")), HasSubstr("is no time"));
}

TEST_F(Tokens, AStoreSeesChangesAtOnceAndLetsNobodyInWhenItCannotReadThem) {
  const std::string first = *CreateToken(path_, Wanted("a"), kNow);
  const auto store = *TokenStore::Open(path_);
  const auto name_of = [&](const std::string& secret) -> std::string {
    const auto token = store->Find(HashOfToken(secret));
    if (!token.ok()) return std::string(absl::StatusCodeToString(token.status().code()));
    return *token == nullptr ? "none" : (*token)->name;
  };
  EXPECT_EQ(name_of(first), "a");
  EXPECT_EQ(name_of("cairn_x"), "none");
  const std::string second = *CreateToken(path_, Wanted("b"), kNow);
  EXPECT_EQ(name_of(second), "b");
  ASSERT_TRUE(RevokeToken(path_, "a").ok());
  EXPECT_EQ(name_of(first), "none");
  const std::string kept = Text();
  std::ofstream(path_) << "{";
  EXPECT_EQ(name_of(second), "UNAVAILABLE");
  std::ofstream(path_) << kept;
  EXPECT_EQ(name_of(second), "b");
  std::filesystem::remove(path_);
  EXPECT_EQ(name_of(second), "UNAVAILABLE");
  EXPECT_EQ(TokenStore::Open(path_).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace cairn::server
