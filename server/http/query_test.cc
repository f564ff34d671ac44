#include "server/http/query.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cairn/v1/admin.pb.h"

namespace cairn::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

TEST(Query, IsDecoded) {
  EXPECT_THAT(*ParseQuery("a=1&b=x+y%2Fz&&c=&d"),
              ElementsAre(Pair("a", "1"), Pair("b", "x y/z"), Pair("c", ""), Pair("d", "")));
  EXPECT_THAT(*ParseQuery(""), testing::IsEmpty());
  for (const char* bad : {"a=%", "a=%1", "a=%zz", "%4"}) EXPECT_FALSE(ParseQuery(bad).ok()) << bad;
}

std::string Refusal(const char* query) {
  v1::ReadLogRequest request;
  const absl::Status status = SetFields(*ParseQuery(query), "map", &request);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << query;
  return std::string(status.message());
}

TEST(Query, SetsFieldsAndRefusesWhatIsNone) {
  v1::ReadLogRequest request;
  ASSERT_TRUE(
      SetFields(*ParseQuery("max_count=20&session=3&from_revision=18446744073709551615"), "map", &request).ok());
  EXPECT_EQ(request.max_count(), 20);
  EXPECT_EQ(request.session(), 3u);
  EXPECT_EQ(request.from_revision(), 18446744073709551615u);
  EXPECT_THAT(Refusal("count=2"), HasSubstr("no `count` here; there are from_revision, session, max_count"));
  EXPECT_THAT(Refusal("max_count=abc"), HasSubstr("`max_count` cannot be \"abc\""));
  EXPECT_THAT(Refusal("max_count=3000000000"), HasSubstr("cannot be"));
  EXPECT_THAT(Refusal("max_count=1&max_count=2"), HasSubstr("repeated"));
  EXPECT_THAT(Refusal("map=other"), HasSubstr("no `map` here"));
  v1::ReadLogRequest from_body;
  from_body.set_session(2);
  EXPECT_THAT(std::string(SetFields(*ParseQuery("session=1"), "map", &from_body).message()), HasSubstr("in the body"));
  EXPECT_EQ(from_body.session(), 2u);
  v1::ExportMapRequest exported;
  ASSERT_TRUE(SetFields(*ParseQuery("content=CONTENT_POINTS"), "map", &exported).ok());
  EXPECT_EQ(exported.content(), v1::ExportMapRequest::CONTENT_POINTS);
  v1::VerifyMapRequest verify;
  ASSERT_TRUE(SetFields(*ParseQuery("deep=true"), "map", &verify).ok());
  EXPECT_TRUE(verify.deep());
}

}  // namespace
}  // namespace cairn::server
