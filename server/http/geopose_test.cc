#include "server/http/geopose.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "absl/strings/escaping.h"
#include "client/conformance/conformance_map.h"
#include "host/map_host.h"
#include "io/image_codecs.h"
#include "store/sqlite_map_store.h"

namespace cairn::server {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;
constexpr const char* kAccept = "application/vnd.oscp+json;version=2.0;";  // as @oarc/gpp-access sends it

// The room's world is that of a camera: y down, z ahead. Ahead is 30 degrees east of north.
map::GeoAnchor Anchor() {
  return map::AnchorAt({60.1699, 24.9384, 30.0}, map::EnuFromWorld(-Vector3d::UnitY(), Vector3d::UnitZ(), 30.0));
}

class GeoPoseTest : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/geopose_test_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    ASSERT_TRUE(conformance::WriteConformanceMap(directory_ + "/room.cairn").ok());
    host::MapHostOptions options;
    options.directory = directory_;
    options.refresh_interval_s = 0.0;
    host_ = *host::MapHost::Open(options);
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }

  void Place(const std::string& map, const map::GeoAnchor& anchor) {
    api::AlignRequest request;
    request.by = anchor;
    const auto placed = host_->Align(map, request);
    ASSERT_TRUE(placed.ok()) << placed.status();
  }

  static cv::Mat Photo() {
    const conformance::ConformanceMap& map = conformance::TheConformanceMap();
    return map.room.Render(map.pinhole, conformance::LookInRoom({0.2, 0.0, -1.4}, 0.05));
  }
  static json Request() {
    const Pinhole& pinhole = conformance::TheConformanceMap().pinhole;
    const json reading = {
        {"timestamp", 1.0},
        {"sensorId", "camera"},
        {"sequenceNumber", 0},
        {"imageFormat", "JPG"},
        {"size", {pinhole.width_px, pinhole.height_px}},
        {"imageBytes", absl::Base64Escape(*io::EncodePng(Photo(), 1))},
        {"imageOrientation", {{"mirrored", false}, {"rotation", 0}}},
        {"params",
         {{"model", "PINHOLE"},
          {"modelParams", {pinhole.fx_px, pinhole.fy_px, pinhole.cx_px + 0.5, pinhole.cy_px + 0.5}}}}};
    return {{"id", "9cf3c6f2"},
            {"timestamp", 1674062540000},
            {"type", "geopose"},
            {"sensors", {{{"id", "camera"}, {"type", "camera"}}}},
            {"sensorReadings", {{"cameraReadings", {reading}}}}};
  }
  HttpResponse Post(const json& request, const std::string& accept = kAccept, const std::string& only = "") const {
    HttpRequest http{"POST", "/geopose", "application/json", request.dump()};
    http.accept = accept;
    return AnswerGeoPose({host_.get(), {}}, {}, http, only);
  }
  static json& Reading(json* request) { return (*request)["sensorReadings"]["cameraReadings"][0]; }
  static std::string MessageOf(const HttpResponse& response) {
    return json::parse(response.body)["error"]["message"].get<std::string>();
  }

  std::string directory_;
  std::unique_ptr<host::MapHost> host_;
};

// Everything is known: where the camera is in the room, and where the room is on the earth.
TEST_F(GeoPoseTest, AKnownAnswer) {
  Place("room", Anchor());
  const HttpResponse response = Post(Request());
  ASSERT_EQ(response.status, 200) << response.body;
  EXPECT_EQ(response.content_type, "application/vnd.oscp+json; version=2.0");
  const json answer = json::parse(response.body);
  EXPECT_EQ(answer["id"], "9cf3c6f2");
  EXPECT_EQ(answer["timestamp"], 1674062540000);
  EXPECT_EQ(answer["type"], "geopose");
  // The camera is 10.4 m to the right of the world's origin and 2.8 m behind it, in the direction of 30 degrees. There
  // a degree is 111415.2 m long to the north and 55513.6 m to the east.
  const double east_m = 10.4 * std::cos(30 * kDegree) - 2.8 * std::sin(30 * kDegree);
  const double north_m = -10.4 * std::sin(30 * kDegree) - 2.8 * std::cos(30 * kDegree);
  const json& position = answer["geopose"]["position"];
  EXPECT_NEAR(position["lat"].get<double>(), 60.1699 + north_m / 111415.2, 0.05 / 111415.2);
  EXPECT_NEAR(position["lon"].get<double>(), 24.9384 + east_m / 55513.6, 0.05 / 55513.6);
  EXPECT_NEAR(position["h"].get<double>(), 30.0, 0.05);
  // It is level and looks to 30 degrees + 0.05 rad: its x axis is turned from east by as much less than 90 degrees.
  const double turned = M_PI / 2 - 30 * kDegree - 0.05;
  const json& q = answer["geopose"]["quaternion"];
  const Quaterniond found(q["w"].get<double>(), q["x"].get<double>(), q["y"].get<double>(), q["z"].get<double>());
  EXPECT_LT(found.angularDistance(Quaterniond(Eigen::AngleAxisd(turned, Vector3d::UnitZ()))), 0.5 * kDegree);
  const double accuracy_m = answer["accuracy"]["position"].get<double>();
  EXPECT_GT(accuracy_m, 0.0);
  EXPECT_LT(accuracy_m, 0.2);
  EXPECT_GT(answer["accuracy"]["orientation"].get<double>(), 0.0);
  EXPECT_LT(answer["accuracy"]["orientation"].get<double>(), 2.0);
}

TEST_F(GeoPoseTest, AccuracyIsThatOfTheCentre) {
  api::LocatedPose located;
  located.map_from_camera = SE3(Quaterniond::Identity(), Vector3d(10.0, 0.0, 0.0));
  located.world_per_map = 2.0;
  located.covariance.diagonal() << 0.04, 0.01, 0.01, 0.0, 0.0, 0.0;
  // Standard deviations of 0.2, 0.1 and 0.1 map units.
  EXPECT_NEAR(AccuracyOf(located).position_m, 2.0 * (0.2 + 0.1 + 0.1) / 3.0, 1e-12);
  EXPECT_EQ(AccuracyOf(located).orientation_deg, 0.0);
  // Turned about z by 0.01 rad, 10 units away: moved along y by 0.1.
  located.covariance.setZero();
  located.covariance(5, 5) = 1e-4;
  EXPECT_NEAR(AccuracyOf(located).position_m, 2.0 * 0.1 / 3.0, 1e-12);
  EXPECT_NEAR(AccuracyOf(located).orientation_deg, 0.01 / kDegree / 3.0, 1e-12);
}

TEST_F(GeoPoseTest, VersionsAreNegotiated) {
  for (const char* good : {kAccept, "application/vnd.oscp+json; version=2.0", "application/vnd.oscp+json;version=2",
                           "text/html, application/vnd.oscp+json; version=2.0;",
                           "application/vnd.oscp+json; version=\"2.0\"", "*/*", "application/json"}) {
    EXPECT_TRUE(CheckGeoPoseVersion(good).ok()) << good;
  }
  for (const char* bad : {"", "application/vnd.oscp+json", "application/vnd.oscp+json; version=1.0", "text/html",
                          "application/vnd.oscp+json; version=3.0;",
                          "application/vnd.oscp+json; version=", "application/vnd.oscp+json; version=\""}) {
    EXPECT_EQ(CheckGeoPoseVersion(bad).code(), absl::StatusCode::kInvalidArgument) << bad;
  }
  Place("room", Anchor());
  const HttpResponse old = Post(Request(), "application/vnd.oscp+json; version=1.0;");
  EXPECT_EQ(old.status, 400);
  EXPECT_THAT(MessageOf(old), HasSubstr("version=2.0"));
}

TEST_F(GeoPoseTest, NotFoundSaysWhy) {
  const HttpResponse nowhere = Post(Request());
  EXPECT_EQ(nowhere.status, 404) << "no map has an anchor";
  EXPECT_THAT(MessageOf(nowhere), HasSubstr("cairn align --geo"));
  Place("room", Anchor());
  json blank = Request();
  Reading(&blank)["imageBytes"] = absl::Base64Escape(*io::EncodePng(cv::Mat(360, 480, CV_8UC1, cv::Scalar(90)), 1));
  const HttpResponse missed = Post(blank);
  EXPECT_EQ(missed.status, 404);
  EXPECT_THAT(MessageOf(missed), HasSubstr("features"));
  EXPECT_EQ(Post(Request(), kAccept, "hall").status, 404) << "another map is configured";
  EXPECT_EQ(Post(Request(), kAccept, "room").status, 200);
}

// Whatever other maps have.
TEST_F(GeoPoseTest, AMapThatIsConfiguredAndHasNoAnchorIsNamed) {
  std::filesystem::copy_file(directory_ + "/room.cairn", directory_ + "/office.cairn");
  Place("office", Anchor());
  const HttpResponse unplaced = Post(Request(), kAccept, "room");
  EXPECT_EQ(unplaced.status, 404);
  EXPECT_THAT(MessageOf(unplaced), testing::AllOf(HasSubstr("the map room"), HasSubstr("--geopose-map")));
  EXPECT_THAT(MessageOf(Post(Request(), kAccept, "hall")),
              testing::AllOf(HasSubstr("hall"), HasSubstr("--geopose-map")));
}

TEST_F(GeoPoseTest, TheNewestReadingCountsWhereverItStands) {
  Place("room", Anchor());
  json request = Request();
  json blank = Reading(&request);
  blank["imageBytes"] = absl::Base64Escape(*io::EncodePng(cv::Mat(360, 480, CV_8UC1, cv::Scalar(90)), 1));
  const auto status_of = [&](const json& photo_time, const json& blank_time, bool photo_first) {
    json asked = Request();
    json photo = Reading(&asked), other = blank;
    photo["timestamp"] = photo_time;
    other["timestamp"] = blank_time;
    for (json* reading : {&photo, &other}) {
      if ((*reading)["timestamp"].is_null()) reading->erase("timestamp");
    }
    asked["sensorReadings"]["cameraReadings"] = photo_first ? json{photo, other} : json{other, photo};
    return Post(asked).status;
  };
  for (const bool photo_first : {true, false}) {
    EXPECT_EQ(status_of(2.5, 1, photo_first), 200);
    EXPECT_EQ(status_of(1, 2.5, photo_first), 404);
    EXPECT_EQ(status_of(-3, nullptr, photo_first), 200) << "what does not say is older";
    EXPECT_EQ(status_of(5, 5, photo_first), photo_first ? 404 : 200) << "the last of equal ones";
    EXPECT_EQ(status_of(nullptr, nullptr, photo_first), photo_first ? 404 : 200);
  }
  const json here = {{"timestamp", 7}, {"latitude", 60.17}, {"longitude", 24.94}};
  const json far = {{"timestamp", 3}, {"latitude", -33.9}, {"longitude", 151.2}};
  request["sensorReadings"]["geolocationReadings"] = {here, far};
  EXPECT_EQ(Post(request).status, 200);
  request["sensorReadings"]["geolocationReadings"] = {far, here};
  EXPECT_EQ(Post(request).status, 200);
  const auto pose_at = [](double time, double latitude) {
    return json{{"timestamp", time}, {"geopose", {{"position", {{"lat", latitude}, {"lon", 24.94}, {"h", 5.0}}}}}};
  };
  request["priorPoses"] = {pose_at(9, 60.17), pose_at(8, -33.9)};
  EXPECT_EQ(Post(request).status, 200);
  request["priorPoses"] = {pose_at(9, -33.9), pose_at(8, 60.17)};
  EXPECT_EQ(Post(request).status, 404);
}

TEST_F(GeoPoseTest, OnlyMapsNearAPriorPositionAreAsked) {
  Place("room", Anchor());
  json request = Request();
  request["sensorReadings"]["geolocationReadings"] = {
      {{"latitude", 60.18}, {"longitude", 24.94}, {"altitude", nullptr}, {"accuracy", 50.0}}};
  EXPECT_EQ(Post(request).status, 200) << "a kilometre away";
  request["sensorReadings"]["geolocationReadings"][0]["latitude"] = 61.0;
  EXPECT_EQ(Post(request).status, 404) << "a hundred";
  request["sensorReadings"]["geolocationReadings"][0]["accuracy"] = 1e5;
  EXPECT_EQ(Post(request).status, 200) << "but nobody knows";
  request["priorPoses"] = {{{"geopose", {{"position", {{"lat", -33.9}, {"lon", 151.2}, {"h", 5.0}}}}},
                            {"accuracy", {{"position", 1.0}, {"orientation", 1.0}}}}};
  EXPECT_EQ(Post(request).status, 404) << "a prior pose counts more";
  request["priorPoses"][0]["geopose"]["position"]["lat"] = 95.0;
  EXPECT_EQ(Post(request).status, 400);
}

// Two maps of one room that do not know of each other.
TEST_F(GeoPoseTest, OverlappingMapsMustAgree) {
  const conformance::ConformanceMap& map = conformance::TheConformanceMap();
  map::MapInfo info = map.snapshot->info();
  info.id = std::string(32, 'a');
  {
    store::CreateOptions options;
    options.vocabulary = map.vocabulary;
    const auto other = store::SqliteMapStore::Create(directory_ + "/other.cairn", info, options);
    ASSERT_TRUE(other.ok()) << other.status();
    map::Delta delta = map.delta;
    delta.info.reset();
    ASSERT_TRUE((*other)->Commit(delta).ok());
    ASSERT_TRUE((*other)->Close().ok());
  }
  Place("room", Anchor());
  map::GeoAnchor close = Anchor();
  close.height_m += 0.3;
  Place("other", close);
  EXPECT_EQ(Post(Request()).status, 200) << "as well as anchors are known";
  api::AlignRequest elsewhere;
  close.height_m += 30.0;
  elsewhere.by = close;
  elsewhere.overwrite = true;
  ASSERT_TRUE(host_->Align("other", elsewhere).ok());
  const HttpResponse contradicted = Post(Request());
  EXPECT_EQ(contradicted.status, 404);
  EXPECT_THAT(MessageOf(contradicted), HasSubstr("at different places"));
  EXPECT_EQ(Post(Request(), kAccept, "other").status, 200) << "one alone is asked";
}

TEST_F(GeoPoseTest, NearestMapsFirst) {
  const auto at = [](const std::string& name, double latitude) {
    api::MapSummary map;
    map.name = name;
    map.geo_anchor = map::AnchorAt({latitude, 25.0, 0.0}, Quaterniond::Identity());
    return map;
  };
  api::MapSummary unplaced;
  unplaced.name = "unplaced";
  const std::vector<api::MapSummary> maps = {at("a", 60.03), at("b", 60.0), unplaced, at("c", 60.01), at("d", 10.0)};
  GeoPoseRequest request;
  EXPECT_THAT(*MapsNear(maps, request), testing::ElementsAre("a", "b", "c", "d"));
  request.prior = GeoPosition{60.0, 25.0, 0.0};
  EXPECT_THAT(*MapsNear(maps, request), testing::ElementsAre("b", "c", "a"));
  EXPECT_EQ(MapsNear({unplaced}, request).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(GeoPoseTest, RawImages) {
  Place("room", Anchor());
  const cv::Mat photo = Photo();
  json request = Request();
  Reading(&request)["imageFormat"] = "GRAY8";
  const std::string gray(reinterpret_cast<const char*>(photo.data), photo.total());
  Reading(&request)["imageBytes"] = absl::Base64Escape(gray);
  EXPECT_EQ(Post(request).status, 200);
  std::string rgba;
  for (const char value : gray) rgba += std::string(3, value) + '\xFF';
  Reading(&request)["imageFormat"] = "RGBA32";
  Reading(&request)["imageBytes"] = absl::Base64Escape(rgba);
  EXPECT_EQ(Post(request).status, 200);
  Reading(&request)["imageBytes"] = absl::Base64Escape(gray);
  EXPECT_EQ(Post(request).status, 400) << "too few bytes";
}

TEST_F(GeoPoseTest, BadRequestsSayWhatIsWrong) {
  Place("room", Anchor());
  const auto refused = [&](const std::function<void(json*)>& spoil, const std::string& says) {
    json request = Request();
    spoil(&request);
    const HttpResponse response = Post(request);
    EXPECT_EQ(response.status, 400) << response.body.substr(0, 300);
    EXPECT_THAT(response.body, HasSubstr(says));
  };
  refused([](json* r) { *r = json::array(); }, "GeoPoseReq");
  refused([](json* r) { r->erase("id"); }, "`id` is missing");
  refused([](json* r) { (*r)["id"] = 5; }, "`id` must be a text");
  refused([](json* r) { (*r)["id"] = ""; }, "`id` must be a text");
  refused([](json* r) { (*r)["type"] = "weather"; }, "`type`");
  refused([](json* r) { (*r)["type"] = 7; }, "`type`");
  for (const json& no_time : {json("2026-01-01T00:00:00Z"), json(1e30), json(true), json::array()}) {
    refused([&](json* r) { (*r)["timestamp"] = no_time; }, "geopose: `timestamp` must be a number");
    refused([&](json* r) { Reading(r)["timestamp"] = no_time; }, "geopose: `cameraReadings[0].timestamp` must be");
    refused(
        [&](json* r) {
          (*r)["priorPoses"] = {{{"timestamp", no_time}}};
        },
        "geopose: `priorPoses[0].timestamp` must be");
    refused(
        [&](json* r) {
          (*r)["sensorReadings"]["geolocationReadings"] = {{{"timestamp", no_time}}};
        },
        "geopose: `geolocationReadings[0].timestamp` must be");
  }
  refused(
      [](json* r) {
        (*r)["priorPoses"] = {{{"timestamp", 4}}, {{"timestamp", 3}}};
      },
      "\"geopose: `priorPoses[0].geopose.position.lat` must be a number");
  refused(
      [](json* r) {
        (*r)["sensorReadings"]["geolocationReadings"] = {{{"latitude", "60"}, {"longitude", 24}}};
      },
      "\"geopose: `geolocationReadings[0].latitude` must be a number");
  refused(
      [](json* r) {
        (*r)["sensorReadings"]["geolocationReadings"] = {{{"latitude", 60}, {"longitude", 1e9}}};
      },
      "\"geopose: `geolocationReadings[0]`: geographic position: the longitude");
  refused([](json* r) { r->erase("sensorReadings"); }, "no camera readings");
  refused([](json* r) { (*r)["sensorReadings"]["cameraReadings"] = json::array(); }, "no camera readings");
  refused([](json* r) { (*r)["sensorReadings"]["cameraReadings"] = {7}; }, "`cameraReadings[0].size`");
  refused([](json* r) { Reading(r)["size"] = {480, -1}; }, "[0].size`");
  refused([](json* r) { Reading(r)["size"] = {479, 360}; }, "480x360");
  refused([](json* r) { Reading(r).erase("imageBytes"); }, "[0].imageBytes` must be the image");
  refused([](json* r) { Reading(r)["imageBytes"] = "***"; }, "base64");
  refused([](json* r) { Reading(r)["imageBytes"] = "AAAA"; }, "neither a PNG nor a JPEG");
  refused([](json* r) { Reading(r)["imageFormat"] = "DEPTH"; }, "imageFormat");
  refused([](json* r) { Reading(r)["imageOrientation"]["mirrored"] = true; }, "mirrored");
  refused([](json* r) { Reading(r).erase("params"); }, "[0].params`");
  refused([](json* r) { Reading(r)["params"]["model"] = "UNKNOWN"; }, "UNKNOWN");
  refused([](json* r) { Reading(r)["params"]["modelParams"] = {1, 2}; }, "4 numbers");
  refused([](json* r) { Reading(r)["params"]["modelParams"][0] = -5; }, "focal");
  for (const std::string& body :
       {std::string("{"), std::string(1 << 20, '['), std::string("\"\xff\""), std::string()}) {
    HttpRequest no_json{"POST", "/geopose", "application/json", body};
    no_json.accept = kAccept;
    EXPECT_EQ(AnswerGeoPose({host_.get(), {}}, {}, no_json).status, 400);
  }
}

}  // namespace
}  // namespace cairn::server
