#include "server/http/http_api.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "base/files.h"
#include "client/conformance/conformance_map.h"
#include "host/map_host.h"
#include "io/image_codecs.h"
#include "wire/errors.h"

namespace cairn::server {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr const char* kAnchor =
    R"({"anchor": {"latitude_deg": 60.1699, "longitude_deg": 24.9384, "height_m": 30, "enu_from_world": {"w": 1}}})";

class HttpApiTest : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/http_api_test_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    ASSERT_TRUE(conformance::WriteConformanceMap(directory_ + "/room.cairn").ok());
    host::MapHostOptions options;
    options.directory = directory_;
    host_ = *host::MapHost::Open(options);
    api_ = std::make_unique<HttpApi>(CallContext{host_.get(), {}},
                                     HttpHooks{[this] { return ready_; }, [] { return std::string("metrics 1\n"); }});
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }

  HttpResponse Get(const std::string& path) const { return api_->Handle({"GET", path, "", ""}); }
  // Asks for tokens from now on, and gives one that may read `maps`.
  std::string UseTokens(const std::vector<std::string>& maps, const CorsOptions& cors = {}) {
    AccessOptions options;
    options.tokens = directory_ + "/tokens.json";
    Token token;
    token.name = "t" + std::to_string(maps.size());
    token.maps = maps;
    const std::string secret = *CreateToken(options.tokens, token, absl::ToUnixSeconds(absl::Now()));
    access_ = *Access::Open(options);
    api_ = std::make_unique<HttpApi>(CallContext{host_.get(), {}, nullptr, access_.get()},
                                     HttpHooks{[this] { return ready_; }, [] { return std::string("metrics 1\n"); }},
                                     cors);
    return "Bearer " + secret;
  }
  HttpResponse GetWith(const std::string& path, const std::string& authorization) const {
    HttpRequest request{"GET", path, "", ""};
    request.authorization = authorization;
    return api_->Handle(request);
  }
  static std::string Header(const HttpResponse& response, const std::string& name) {
    for (const auto& [key, value] : response.headers) {
      if (key == name) return value;
    }
    return "";
  }
  static std::string ReasonOf(const HttpResponse& response) {
    return json::parse(response.body)["error"]["reason"].get<std::string>();
  }

  // A form as curl -F makes it.
  static HttpRequest Form(const std::vector<std::pair<std::string, std::string>>& parts) {
    HttpRequest request{"POST", "/v1/maps/room:localize", "multipart/form-data; boundary=xyz", ""};
    for (const auto& [name, content] : parts) {
      request.body += "--xyz\r\nContent-Disposition: form-data; name=\"" + name + "\"\r\n\r\n" + content + "\r\n";
    }
    request.body += "--xyz--\r\n";
    return request;
  }
  static std::string Photo() {
    const conformance::ConformanceMap& map = conformance::TheConformanceMap();
    return *io::EncodePng(map.room.Render(map.pinhole, Truth()), 1);
  }
  static SE3 Truth() { return conformance::LookInRoom({0.2, 0.0, -1.4}, 0.05); }
  static std::string CameraText() {
    const Pinhole& pinhole = conformance::TheConformanceMap().pinhole;
    return json{{"model", "PINHOLE"},
                {"params", {pinhole.fx_px, pinhole.fy_px, pinhole.cx_px + 0.5, pinhole.cy_px + 0.5}}}
        .dump();
  }

  std::string directory_;
  std::unique_ptr<host::MapHost> host_;
  std::unique_ptr<Access> access_;
  absl::Status ready_;
  std::unique_ptr<HttpApi> api_;
};

TEST_F(HttpApiTest, LocatesAPhotoFromAForm) {
  const HttpResponse response = api_->Handle(Form({{"image", Photo()}, {"camera", CameraText()}, {"time_ns", "42"}}));
  ASSERT_EQ(response.status, 200) << response.body;
  EXPECT_EQ(response.content_type, "application/json");
  const json answer = json::parse(response.body);
  EXPECT_EQ(answer["localized"], true);
  EXPECT_EQ(answer["stage"], "STAGE_DONE");
  const Vector3d truth = Truth().Inverse().translation();
  EXPECT_NEAR(answer["map_from_camera"]["translation"]["x"].get<double>(), truth.x(), 0.02);
  EXPECT_NEAR(answer["map_from_camera"]["translation"]["z"].get<double>(), truth.z(), 0.02);
  EXPECT_NEAR(answer["world_from_camera"]["translation"]["x"].get<double>(), 2.0 * truth.x() + 10.0, 0.05);
  EXPECT_EQ(answer["world_is_metric"], true);
  EXPECT_EQ(answer["covariance"].size(), 36u);
  EXPECT_EQ(answer["revision"], "1");
}

TEST_F(HttpApiTest, AMissIsAnAnswer) {
  const cv::Mat blank(360, 480, CV_8UC1, cv::Scalar(90));
  const HttpResponse response = api_->Handle(Form({{"image", *io::EncodePng(blank, 1)}, {"camera", CameraText()}}));
  ASSERT_EQ(response.status, 200) << response.body;
  const json answer = json::parse(response.body);
  EXPECT_EQ(answer["localized"], false);
  EXPECT_EQ(answer["stage"], "STAGE_FEATURES");
  EXPECT_FALSE(answer["reason"].get<std::string>().empty());
  EXPECT_FALSE(answer.contains("map_from_camera"));
}

TEST_F(HttpApiTest, BadRequestsSayWhatIsWrong) {
  const auto refused = [&](const HttpRequest& request, const std::string& says) {
    const HttpResponse response = api_->Handle(request);
    EXPECT_EQ(response.status, 400) << response.body;
    EXPECT_EQ(ReasonOf(response), "invalid_argument");
    EXPECT_THAT(response.body, HasSubstr(says));
  };
  refused(Form({{"camera", CameraText()}}), "`image` is missing");
  refused(Form({{"image", Photo()}}), "`camera` is missing");
  refused(Form({{"image", "GIF89a"}, {"camera", CameraText()}}), "neither a PNG nor a JPEG");
  refused(Form({{"image", Photo()}, {"camera", "{}"}}), "`model` is missing");
  refused(Form({{"image", Photo()}, {"camera", CameraText()}, {"color", "red"}}),
          "no part `color` here; there are image, camera, time_ns; the map");
  HttpRequest across = Form({{"image", Photo()}, {"camera", CameraText()}, {"k\xC3\xBC\n", "red"}});
  across.path = "/v1/localize";
  refused(across, "no part `k\xC3\xBC\\\\x0a` here; there are image, camera, time_ns, maps");
  refused(Form({{"image", Photo()}, {"camera", R"({"model": "PINHOLE", "params": [NaN, 1, 2, 3]})"}}), "no JSON");
  refused(Form({{"image", Photo()}, {"camera", "[1]"}}), "camera: give {");
  refused({"POST", "/v1/maps/room:localize", "text/plain", "hello"}, "multipart/form-data");
  HttpRequest form = Form({{"image", Photo()}, {"camera", CameraText()}});
  form.query = "time_ns=3";
  refused(form, "query: with a form, its parts say everything: image, camera and time_ns");
  form.path = "/v1/localize";
  refused(form, "time_ns and maps");
  // What JSON says, in the terms of who wrote it.
  const auto json_refused = [&](const std::string& path, const std::string& body, const std::string& says) {
    refused({"POST", path, "application/json", body}, says);
    EXPECT_THAT(api_->Handle({"POST", path, "application/json", body}).body, testing::Not(HasSubstr("INVALID_ARG")));
  };
  json_refused("/v1/maps/room:localize", R"({"imagine": 1})", "no field `imagine`; there are map, image, camera");
  json_refused("/v1/maps/room:localize", R"({"camera": {"modell": 1}})", "no field `camera.modell`; there are model");
  json_refused("/v1/maps/room:align", R"({"poses": {"poses": [{}, {"tiem": 1}]}})", "[1].tiem`; there are time_ns");
  json_refused("/v1/maps", R"({"name": "hall"})", "request: there is no field `name`; there are map, title");
  json_refused("/v1/maps", R"({"map": })", "request: the body is no JSON, from byte 9 on");
  json_refused("/v1/maps", R"({"map": 1e999})", "request: a number in the body is too large");
  json_refused("/v1/maps", "[1]", "request: the body must be an object");
  json_refused("/v1/maps/room:removeSession", R"({"session": "x"})", "session");
  refused({"POST", "/v1/maps/room:localize", "application/json", "{}"}, "camera");
}

TEST_F(HttpApiTest, ListsAndDescribesMaps) {
  const json maps = json::parse(Get("/v1/maps").body)["maps"];
  ASSERT_EQ(maps.size(), 1u);
  EXPECT_EQ(maps[0]["name"], "room");
  EXPECT_EQ(maps[0]["keyframes"], "10");
  const json room = json::parse(Get("/v1/maps/room").body);
  EXPECT_EQ(room["summary"]["revision"], "1");
  EXPECT_EQ(room["components"][0]["world_from_component"]["scale"], 2.0);
  const HttpResponse missing = Get("/v1/maps/kitchen");
  EXPECT_EQ(missing.status, 404);
  EXPECT_EQ(ReasonOf(missing), "map_not_found");
  EXPECT_FALSE(json::parse(missing.body)["error"]["request_id"].get<std::string>().empty());
  EXPECT_EQ(Get("/v1/maps/..").status, 400);
  const HttpResponse echo = ErrorResponse(absl::InvalidArgumentError(std::string(100'000, 'x')), "id");
  EXPECT_EQ(echo.status, 400);
  EXPECT_LT(echo.body.size(), 2000u) << "a client gets back no more than it can read";
}

TEST_F(HttpApiTest, WhileItStopsNothingIsAnsweredButThatItLives) {
  EXPECT_EQ(Get("/readyz").status, 200);
  api_->Stop();
  EXPECT_EQ(Get("/healthz").status, 200);
  for (const HttpResponse& refused :
       {Get("/readyz"), Get("/v1/maps"), Get("/metrics"), api_->Handle(Form({{"image", Photo()}}))}) {
    EXPECT_EQ(refused.status, 503);
    EXPECT_EQ(ReasonOf(refused), "unavailable");
    EXPECT_THAT(refused.body, HasSubstr("the server stops"));
    EXPECT_NE(Header(refused, "X-Request-Id"), "");
  }
}

TEST_F(HttpApiTest, HealthReadinessAndMetrics) {
  EXPECT_EQ(Get("/healthz").body, "ok\n");
  EXPECT_EQ(Get("/readyz").status, 200);
  ready_ = absl::NotFoundError("the maps are gone");
  EXPECT_EQ(Get("/readyz").status, 503);
  EXPECT_EQ(Get("/metrics").body, "metrics 1\n");
}

TEST_F(HttpApiTest, AsksForTokens) {
  const std::string some = UseTokens({"room"}), all = UseTokens({"*", "x"});
  HttpResponse response = Get("/v1/maps/room");
  EXPECT_EQ(response.status, 401);
  EXPECT_EQ(ReasonOf(response), "unauthenticated");
  EXPECT_EQ(Header(response, "WWW-Authenticate"), "Bearer");
  EXPECT_EQ(GetWith("/v1/maps/room", some + "x").status, 401);
  EXPECT_EQ(GetWith("/v1/maps/room", some).status, 200);
  const HttpResponse other = GetWith("/v1/maps/other", some);
  EXPECT_EQ(other.status, 403);
  EXPECT_EQ(ReasonOf(other), "permission_denied");
  HttpRequest form = Form({{"image", Photo()}, {"camera", CameraText()}});
  EXPECT_EQ(api_->Handle(form).status, 401);
  EXPECT_EQ(api_->Refusal(form)->status, 401);
  form.authorization = some;
  EXPECT_FALSE(api_->Refusal(form).has_value()) << "its body is worth reading";
  EXPECT_EQ(api_->Handle(form).status, 200);
  // Names of maps are in the metrics; health and the description of the interface tell nothing of them.
  EXPECT_EQ(GetWith("/metrics", some).status, 403);
  EXPECT_EQ(GetWith("/metrics", all).status, 200);
  EXPECT_EQ(Get("/healthz").status, 200);
  EXPECT_EQ(Get("/readyz").status, 200);
  EXPECT_EQ(Get("/openapi.json").status, 200);
}

TEST_F(HttpApiTest, RequestsHaveAnId) {
  HttpRequest request{"GET", "/v1/maps/none", "", ""};
  request.request_id = "page-7";
  HttpResponse response = api_->Handle(request);
  EXPECT_EQ(Header(response, "X-Request-Id"), "page-7");
  EXPECT_EQ(json::parse(response.body)["error"]["request_id"], "page-7");
  request.request_id = "two\r\nlines";
  response = api_->Handle(request);
  EXPECT_EQ(json::parse(response.body)["error"]["request_id"], Header(response, "X-Request-Id"));
  EXPECT_THAT(Header(response, "X-Request-Id"), testing::MatchesRegex("[0-9a-f]+-[0-9a-f]+"));
}

TEST_F(HttpApiTest, WhatIsTooMuchSaysWhenToTryAgain) {
  const HttpResponse response = ErrorResponse(wire::RetryLater("too much", 1.2), "id");
  EXPECT_EQ(response.status, 429);
  EXPECT_EQ(Header(response, "Retry-After"), "2");
}

TEST_F(HttpApiTest, PagesOfOtherOriginsMayAskIfTheyAreNamed) {
  const std::string token = UseTokens({"room"}, {{"https://maps.example.org"}});
  HttpRequest request{"OPTIONS", "/v1/maps/room:localize", "", ""};
  request.origin = "https://maps.example.org";
  HttpResponse leave = api_->Handle(request);
  EXPECT_EQ(leave.status, 200);
  EXPECT_EQ(leave.body, "");
  EXPECT_EQ(Header(leave, "Access-Control-Allow-Origin"), request.origin);
  EXPECT_EQ(Header(leave, "Access-Control-Allow-Methods"), "POST");
  EXPECT_THAT(Header(leave, "Access-Control-Allow-Headers"), HasSubstr("Authorization"));
  request = {"GET", "/v1/maps/room", "", "", "", token, "", "https://maps.example.org"};
  HttpResponse answer = api_->Handle(request);
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(Header(answer, "Access-Control-Allow-Origin"), request.origin);
  EXPECT_EQ(Header(answer, "Vary"), "Origin");
  request.authorization = "";
  EXPECT_EQ(Header(api_->Handle(request), "Access-Control-Allow-Origin"), request.origin) << "errors are read, too";
  // Others, and pages of no origin, are told nothing.
  for (const char* origin : {"https://evil.example.org", "https://maps.example.org.evil", "null", ""}) {
    request.origin = origin;
    request.method = "GET";
    EXPECT_EQ(Header(api_->Handle(request), "Access-Control-Allow-Origin"), "") << origin;
    request.method = "OPTIONS";
    leave = api_->Handle(request);
    EXPECT_EQ(leave.status, 405);
    EXPECT_EQ(Header(leave, "Access-Control-Allow-Origin"), "") << origin;
  }
  UseTokens({"room", "a", "b"});
  request.origin = "https://maps.example.org";
  EXPECT_EQ(api_->Handle(request).status, 405) << "none are allowed unless it is said";
}

// Of every route: what a page may not send it could never ask for.
TEST_F(HttpApiTest, LeaveIsGivenForEveryMethodThatIsAnswered) {
  UseTokens({"room"}, {{"https://maps.example.org"}});
  for (const HttpApi::Route& route : HttpApi::Routes()) {
    HttpRequest request{"OPTIONS", absl::StrReplaceAll(route.path, {{"{map}", "room"}}), "", ""};
    request.origin = "https://maps.example.org";
    const HttpResponse leave = api_->Handle(request);
    EXPECT_EQ(leave.status, 200) << route.path;
    const std::vector<std::string> methods = absl::StrSplit(Header(leave, "Access-Control-Allow-Methods"), ", ");
    EXPECT_THAT(methods, testing::Contains(std::string(route.method))) << route.path;
  }
  HttpRequest of_a_map{"OPTIONS", "/v1/maps/room", "", ""};
  of_a_map.origin = "https://maps.example.org";
  EXPECT_EQ(Header(api_->Handle(of_a_map), "Access-Control-Allow-Methods"), "GET, DELETE");
}

TEST_F(HttpApiTest, BodiesThatAreEncodedAreRefusedBeforeTheyAreRead) {
  HttpRequest request{"POST", "/v1/maps", "application/json", "\x1f\x8b packed"};
  for (const char* encoding : {"gzip", "deflate", "br", "gzip, identity"}) {
    request.content_encoding = encoding;
    const HttpResponse response = api_->Handle(request);
    EXPECT_EQ(response.status, 415) << encoding;
    EXPECT_EQ(Header(response, "Accept-Encoding"), "identity");
    EXPECT_THAT(response.body, testing::AllOf(HasSubstr(encoding), HasSubstr("identity")));
    const auto refusal = api_->Refusal(request);
    ASSERT_TRUE(refusal.has_value());
    EXPECT_EQ(refusal->status, 415);
  }
  request.body = R"({"map": "made"})";
  for (const char* plain : {"", "identity", " Identity "}) {
    request.content_encoding = plain;
    EXPECT_FALSE(api_->Refusal(request).has_value());
    EXPECT_NE(api_->Handle(request).status, 415) << plain;
  }
}

TEST_F(HttpApiTest, ErrorsDoNotSayWhereTheMapsAre) {
  CallContext context{host_.get(), {}};
  context.maps_folder = &host_->directory();
  api_ = std::make_unique<HttpApi>(context, HttpHooks{[this] { return ready_; }, [] { return std::string(); }});
  ready_ = absl::UnavailableError(host_->directory() + "/tokens.json: gone from " + host_->directory());
  const HttpResponse response = Get("/readyz");
  EXPECT_EQ(response.status, 503);
  EXPECT_THAT(response.body, HasSubstr("tokens.json: gone from the folder of the maps"));
}

TEST(Cors, OriginsThatAreNone) {
  EXPECT_TRUE((CorsOptions{{"*", "http://localhost:8080", "https://a.b"}}).Validate().ok());
  for (const char* bad : {"", "maps.example.org", "https://", "https://a/", "ftp://a", "https://a b"}) {
    EXPECT_EQ(CorsOptions{{bad}}.Validate().code(), absl::StatusCode::kInvalidArgument) << bad;
  }
}

TEST_F(HttpApiTest, RequestsThatContradictThemselvesAreRefused) {
  HttpRequest other{"POST", "/v1/maps/room:localize", "application/json", R"({"map": "hall"})"};
  EXPECT_THAT(api_->Handle(other).body, HasSubstr("another map than the path"));
  HttpRequest query{"POST", "/v1/maps/room:localize", "application/json", "{}"};
  for (const char* bad : {"map=room", "zzz=1", "time_ns=x", "image=k9"}) {
    query.query = bad;
    const HttpResponse response = api_->Handle(query);
    EXPECT_EQ(response.status, 400) << bad;
    EXPECT_THAT(response.body, HasSubstr("query: ")) << bad;
  }
  HttpRequest none = Form({{"image", Photo()}, {"camera", CameraText()}, {"maps", ","}});
  none.path = "/v1/localize";
  EXPECT_THAT(api_->Handle(none).body, HasSubstr("maps: name them"));
}

TEST_F(HttpApiTest, NamesInPathsMayBeEncoded) {
  EXPECT_EQ(Get("/v1/maps/r%6Fom").status, 200);
  EXPECT_EQ(Get("/v1/maps/r%6fom/sessions").status, 200);
  for (const char* none :
       {"/v1/maps/..%2Froom", "/v1/maps/room%", "/v1/maps/room%00", "/v1/maps/room%2", "/v1/maps/ro+om"}) {
    EXPECT_EQ(Get(none).status, 400) << none;
  }
}

// Whoever looks for what there is leaves a trace, too.
TEST_F(HttpApiTest, WhatIsNotAnsweredIsWrittenDown) {
  struct Calls : CallObserver {
    void OnCall(absl::string_view call, absl::string_view reason, double /*seconds*/) override {
      calls.push_back(std::string(call) + " " + std::string(reason));
    }
    void OnLocalized(const api::LocalizeAnswer& /*answer*/) override {}
    void OnTracked(const api::TrackAnswer* /*answer*/) override {}
    void OnSessionFrame(absl::string_view /*state*/, double /*seconds*/) override {}
    void OnFramesDropped(std::int64_t /*count*/) override {}
    std::vector<std::string> calls;
  } seen;
  AccessOptions options;
  options.request_log = directory_ + "/requests.jsonl";
  access_ = *Access::Open(options);
  api_ = std::make_unique<HttpApi>(CallContext{host_.get(), {}, &seen, access_.get()}, HttpHooks{});
  EXPECT_EQ(Get("/wp-login.php").status, 404);
  EXPECT_EQ(api_->Handle({"PUT", "/v1/maps", "", ""}).status, 405);
  HttpRequest received;
  received.peer = "192.0.2.1";
  received.request_id = "photo-9";
  const HttpResponse large = api_->AnswerRefused(received, absl::InvalidArgumentError("too large"), 413);
  EXPECT_EQ(large.status, 413);
  EXPECT_EQ(Header(large, "X-Request-Id"), "photo-9");
  EXPECT_EQ(json::parse(large.body)["error"]["request_id"], "photo-9");
  EXPECT_THAT(seen.calls,
              testing::ElementsAre("unknown not_found", "unknown invalid_argument", "unknown invalid_argument"));
  const std::string log = *ReadWholeFile(options.request_log);
  EXPECT_EQ(std::ranges::count(log, '\n'), 3);
  EXPECT_THAT(log, HasSubstr("192.0.2.1"));
}

TEST_F(HttpApiTest, WhatIsNotThereOrTakesAnotherMethod) {
  for (const char* path :
       {"/", "", "/v1", "/v1/maps/", "/v1/maps/room/x", "/v1/maps/room:fly", "/v1/maps/a/b:localize"}) {
    const int status = Get(path).status;
    EXPECT_TRUE(status == 404 || status == 400) << path << " " << status;
  }
  const HttpResponse wrong = Get("/v1/maps/room:localize");
  EXPECT_EQ(wrong.status, 405);
  EXPECT_THAT(wrong.headers, testing::Contains(testing::Pair("Allow", "POST")));
  EXPECT_EQ(api_->Handle({"DELETE", "/v1/maps", "", ""}).status, 405);
}

// Every reference leads somewhere.
void CheckReferences(const json& node, const json& root) {
  if (node.is_object() && node.contains("$ref")) {
    const std::string reference = node["$ref"].get<std::string>();
    ASSERT_EQ(reference[0], '#');
    EXPECT_TRUE(root.contains(json::json_pointer(reference.substr(1)))) << reference;
  }
  if (node.is_structured()) {
    for (const json& child : node) CheckReferences(child, root);
  }
}

// Fields of an answer are those that the description has, and each is of the type that it says.
void CheckAgainst(const json& value, json schema, const json& root) {
  if (schema.contains("$ref")) schema = root.at(json::json_pointer(schema["$ref"].get<std::string>().substr(1)));
  const std::string type = schema["type"].get<std::string>();
  if (type == "object") {
    ASSERT_TRUE(value.is_object()) << value;
    for (const json& name : schema.value("required", json::array())) EXPECT_TRUE(value.contains(name)) << name;
    for (const auto& [name, field] : value.items()) {
      ASSERT_TRUE(schema["properties"].contains(name)) << name << " is not described";
      CheckAgainst(field, schema["properties"][name], root);
    }
  } else if (type == "array") {
    ASSERT_TRUE(value.is_array()) << value;
    for (const json& item : value) CheckAgainst(item, schema["items"], root);
  } else if (type == "string") {
    EXPECT_TRUE(value.is_string()) << value;
    if (schema.contains("enum")) {
      EXPECT_THAT(schema["enum"], testing::Contains(value));
    }
  } else if (type == "boolean") {
    EXPECT_TRUE(value.is_boolean()) << value;
  } else if (type == "integer") {
    EXPECT_TRUE(value.is_number_integer()) << value;
  } else {
    EXPECT_EQ(type, "number");
    EXPECT_TRUE(value.is_number()) << value;
  }
}

TEST_F(HttpApiTest, TheDescriptionHasEveryRouteAndFitsTheAnswers) {
  const HttpResponse served = Get("/openapi.json");
  const json described = json::parse(served.body);
  EXPECT_EQ(described["openapi"], "3.0.3");
  CheckReferences(described, described);
  std::set<std::string> routes, paths, operations;
  for (const HttpApi::Route& route : HttpApi::Routes()) {
    routes.insert(std::string(route.method) + " " + std::string(route.path));
  }
  for (const auto& [path, methods] : described["paths"].items()) {
    for (const auto& [method, operation] : methods.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(c));
      paths.insert(upper + " " + path);
      EXPECT_TRUE(operations.insert(operation["operationId"].get<std::string>()).second);
      EXPECT_TRUE(operation["responses"].contains("200"));
      // What becomes of a file that is no map, or one of a newer version.
      const bool of_a_map = path.starts_with("/v1/maps/{map}") || path == "/v1/localize";
      const bool opens_it = of_a_map && method != "delete" && !path.ends_with("/sessions");
      EXPECT_TRUE(!of_a_map || operation["responses"].contains("409")) << method << " " << path;
      EXPECT_TRUE(!opens_it || operation["responses"].contains("501")) << method << " " << path;
    }
  }
  EXPECT_EQ(routes, paths);
  const auto schema = [&](const std::string& path, const std::string& method, const std::string& status) {
    return described["paths"][path][method]["responses"][status]["content"]["application/json"]["schema"];
  };
  CheckAgainst(json::parse(Get("/v1/maps").body), schema("/v1/maps", "get", "200"), described);
  CheckAgainst(json::parse(Get("/v1/maps/room").body), schema("/v1/maps/{map}", "get", "200"), described);
  CheckAgainst(json::parse(Get("/v1/maps/none").body), schema("/v1/maps/{map}", "get", "404"), described);
  CheckAgainst(json::parse(api_->Handle(Form({{"image", Photo()}, {"camera", CameraText()}})).body),
               schema("/v1/maps/{map}:localize", "post", "200"), described);
  const auto post = [&](const std::string& path, const std::string& route, const std::string& body) {
    const HttpResponse response = api_->Handle({"POST", path, "application/json", body});
    EXPECT_EQ(response.status, 200) << path << ": " << response.body;
    CheckAgainst(json::parse(response.body), schema(route, "post", "200"), described);
    return json::parse(response.body);
  };
  post("/v1/maps/room:align", "/v1/maps/{map}:align", kAnchor);
  CheckAgainst(json::parse(Get("/v1/maps/room").body), schema("/v1/maps/{map}", "get", "200"), described);
  post("/v1/maps/room:snapshot", "/v1/maps/{map}:snapshot", R"({"as": "copy"})");
  post("/v1/maps", "/v1/maps", R"({"map": "hall"})");
  post("/v1/maps/room:verify", "/v1/maps/{map}:verify", "");
  CheckAgainst(json::parse(Get("/v1/maps/room/log").body), schema("/v1/maps/{map}/log", "get", "200"), described);
  CheckAgainst(json::parse(Get("/v1/maps/room/sessions").body), schema("/v1/maps/{map}/sessions", "get", "200"),
               described);
  HttpRequest across = Form({{"image", Photo()}, {"camera", CameraText()}, {"maps", "room,hall"}});
  across.path = "/v1/localize";
  const json found = json::parse(api_->Handle(across).body);
  CheckAgainst(found, schema("/v1/localize", "post", "200"), described);
  EXPECT_EQ(found["map"], "room");
  EXPECT_EQ(found["answers"].size(), 2u);
  const json deleted = json::parse(api_->Handle({"DELETE", "/v1/maps/copy", "", ""}).body);
  CheckAgainst(deleted, schema("/v1/maps/{map}", "delete", "200"), described);
  CheckAgainst(json::parse(Get("/v1/deleted").body), schema("/v1/deleted", "get", "200"), described);
  const std::string name = deleted["deleted"].get<std::string>();
  post("/v1/deleted/" + name + ":restore", "/v1/deleted/{map}:restore", R"({"as": "back"})");
  const json removal = post("/v1/maps/back:removeSession", "/v1/maps/{map}:removeSession", R"({"session": 1})");
  EXPECT_NE(removal["keyframes"], "0");
  EXPECT_EQ(api_->Handle({"POST", "/v1/maps/back:removeSession", "application/json", R"({"session": 9})"}).status, 404);
  CheckAgainst(json::parse(Get("/v1/status").body), schema("/v1/status", "get", "501"), described);
}

TEST_F(HttpApiTest, ParametersOfTheQueryAreCheckedAndUsed) {
  const auto log = [&](const std::string& query) {
    HttpRequest request{"GET", "/v1/maps/room/log", "", ""};
    request.query = query;
    return api_->Handle(request);
  };
  EXPECT_EQ(json::parse(log("").body)["changes"].size(), json::parse(log("max_count=1000").body)["changes"].size());
  EXPECT_EQ(json::parse(log("max_count=1").body)["changes"].size(), 1u);
  EXPECT_EQ(log("count=abc").status, 400);
  EXPECT_EQ(log("max_count=abc").status, 400);
  EXPECT_EQ(log("map=other").status, 400);
  // What no path names may stand there.
  HttpRequest create{"POST", "/v1/maps", "", ""};
  create.query = "map=hall&title=The+hall";
  EXPECT_EQ(api_->Handle(create).status, 200);
  EXPECT_EQ(json::parse(Get("/v1/maps/hall").body)["summary"]["title"], "The hall");
  const std::string deleted = json::parse(api_->Handle({"DELETE", "/v1/maps/hall", "", ""}).body)["deleted"];
  HttpRequest restore{"POST", "/v1/deleted/" + deleted + ":restore", "", ""};
  restore.query = "deleted=other";
  EXPECT_EQ(api_->Handle(restore).status, 400) << "the path says it";
  restore.query = "as=hall2";
  EXPECT_EQ(api_->Handle(restore).status, 200);
}

TEST_F(HttpApiTest, ExportsFiles) {
  std::string sent, type;
  HttpRequest request{"GET", "/v1/maps/room:export", "", ""};
  request.send_part = [&](const HttpResponse& head, absl::string_view part) {
    type = head.content_type;
    absl::StrAppend(&sent, part);
    return absl::OkStatus();
  };
  EXPECT_EQ(api_->Handle(request).parts, HttpResponse::Parts::kAll);
  EXPECT_THAT(sent, testing::StartsWith("SQLite format 3"));
  sent.clear();
  request.query = "content=points";
  EXPECT_EQ(api_->Handle(request).parts, HttpResponse::Parts::kAll);
  EXPECT_THAT(sent, testing::StartsWith("ply\n"));
  EXPECT_EQ(type, "application/octet-stream");
  request.query = "content=soup";
  EXPECT_EQ(api_->Handle(request).status, 400);
  request.query = "";
  request.path = "/v1/maps/none:export";
  EXPECT_EQ(api_->Handle(request).status, 404);
  request.path = "/v1/maps/room:export";
  request.send_part = [](const HttpResponse&, absl::string_view) { return absl::CancelledError("gone"); };
  EXPECT_EQ(api_->Handle(request).parts, HttpResponse::Parts::kBroken);
}

TEST_F(HttpApiTest, KeepsMaps) {
  const auto post = [&](const std::string& path, const std::string& body) {
    return api_->Handle({"POST", path, "application/json", body});
  };
  EXPECT_EQ(post("/v1/maps/room:snapshot", R"({"as": "../copy"})").status, 400);
  EXPECT_EQ(post("/v1/maps/room:snapshot", R"({"as": "room"})").status, 409);
  EXPECT_EQ(post("/v1/maps/room:snapshot", R"({"to": "copy"})").status, 400);
  EXPECT_EQ(post("/v1/maps/kitchen:snapshot", R"({"as": "copy"})").status, 404);
  EXPECT_EQ(post("/v1/maps/room:snapshot", R"({"as": "copy", "map": "kitchen"})").status, 400) << "which of them?";
  EXPECT_EQ(post("/v1/maps/room:snapshot", R"({"as": "copy", "map": "room"})").status, 200);
  const json placed = json::parse(post("/v1/maps/copy:align", kAnchor).body);
  EXPECT_EQ(placed["geo_anchor_changed"], true);
  EXPECT_EQ(json::parse(Get("/v1/maps/copy").body)["summary"]["geo_anchor"]["latitude_deg"], 60.1699);
  EXPECT_EQ(post("/v1/maps/copy:align", kAnchor).status, 409);
  EXPECT_EQ(post("/v1/maps/copy:align", "{}").status, 400);
  EXPECT_EQ(post("/v1/maps/copy:align", R"({"map": "room", "remove_anchor": true})").status, 400) << "which of them?";
  // Numbers that no camera and no room has.
  for (const char* metres : {"1e300", "1e-300", "-1"}) {
    const std::string places = absl::StrCat(
        R"({"overwrite": true, "places": {"distances": [{"from": {"keyframe": 1}, "to": {"keyframe": 2}, "metres": )",
        metres, "}]}}");
    EXPECT_EQ(post("/v1/maps/copy:align", places).status, 400) << metres;
  }
  EXPECT_EQ(json::parse(Get("/v1/maps/copy/log").body)["changes"][0]["reason"], "set the geographic anchor");
  EXPECT_EQ(json::parse(post("/v1/maps/copy:verify", R"({"deep": true})").body)["findings"].size(), 0u);
  const HttpResponse deleted = api_->Handle({"DELETE", "/v1/maps/copy", "", ""});
  EXPECT_EQ(deleted.status, 200);
  EXPECT_EQ(Get("/v1/maps/copy").status, 404);
  EXPECT_EQ(api_->Handle({"DELETE", "/v1/maps/copy", "", ""}).status, 404);
  EXPECT_EQ(post("/v1/deleted/copy.1:restore", "").status, 404);
  EXPECT_EQ(post("/v1/deleted/..:restore", "").status, 400);
  const std::string name = json::parse(deleted.body)["deleted"].get<std::string>();
  EXPECT_EQ(json::parse(post("/v1/deleted/" + name + ":restore", "").body)["map"], "copy");
  EXPECT_EQ(Get("/v1/maps/copy").status, 200);
  const HttpResponse wrong = api_->Handle({"PUT", "/v1/maps/copy", "", ""});
  EXPECT_EQ(wrong.status, 405);
  EXPECT_THAT(wrong.headers, testing::Contains(testing::Pair("Allow", "GET, DELETE")));
}

}  // namespace
}  // namespace cairn::server
