#include "server/http/geopose.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "server/http/camera_json.h"
#include "server/http/http_api.h"
#include "server/rpc/images.h"
#include "server/rpc/serve.h"

namespace cairn::server {
namespace {

constexpr double kDegreesPerRad = 180.0 / std::numbers::pi;

absl::Status BadRequest(absl::string_view what) { return absl::InvalidArgumentError(absl::StrCat("geopose: ", what)); }

// A member of an object, null if it is not there.
const nlohmann::json& Member(const nlohmann::json& object, const char* key) {
  static const nlohmann::json none;
  const auto found = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && found != object.end() ? *found : none;
}

std::string TextOf(const nlohmann::json& value) { return value.is_string() ? value.get<std::string>() : ""; }

// `path`: of the object in the request, for people.
absl::StatusOr<double> NumberOf(const nlohmann::json& object, const char* key, absl::string_view path) {
  const nlohmann::json& value = Member(object, key);
  if (!value.is_number() || !std::isfinite(value.get<double>())) {
    return BadRequest(absl::StrCat("`", path, ".", key, "` must be a number"));
  }
  return value.get<double>();
}

// Milliseconds since 1970; none: the object does not say.
absl::StatusOr<std::optional<double>> TimestampOf(const nlohmann::json& object, absl::string_view path) {
  constexpr double kMost_ms = 8.64e15;  // as a Date of JavaScript has them
  const nlohmann::json& value = Member(object, "timestamp");
  if (value.is_null()) return std::nullopt;
  if (!value.is_number() || !(std::abs(value.get<double>()) <= kMost_ms)) {
    return BadRequest(
        absl::StrCat("`", path, path.empty() ? "" : ".", "timestamp` must be a number: milliseconds since 1970"));
  }
  return value.get<double>();
}

// An element of an array of the request, with its path there.
struct Element {
  const nlohmann::json* json = nullptr;
  std::string path;
};

// By its timestamp; one without is older than any that has one, and of equal ones the last is meant. All must make
// sense: a time that is none may be that of the newest. Null if the array is empty, or none.
absl::StatusOr<Element> NewestOf(const nlohmann::json& array, absl::string_view name) {
  Element newest;
  double newest_ms = 0.0;
  for (std::size_t i = 0; array.is_array() && i < array.size(); ++i) {
    const std::string path = absl::StrCat(name, "[", i, "]");
    CAIRN_ASSIGN_OR_RETURN(const std::optional<double> time_ms, TimestampOf(array[i], path));
    const double at_ms = time_ms.value_or(-std::numeric_limits<double>::infinity());
    if (newest.json != nullptr && at_ms < newest_ms) continue;
    newest = {&array[i], path};
    newest_ms = at_ms;
  }
  return newest;
}

struct Size {
  int width_px = 0;
  int height_px = 0;
};

absl::StatusOr<Size> SizeFrom(const Element& reading) {
  const nlohmann::json& size = Member(*reading.json, "size");
  const auto good = [](const nlohmann::json& side) {
    return side.is_number() && side.get<double>() >= 1.0 && side.get<double>() <= 1e6 &&
           side.get<double>() == std::floor(side.get<double>());
  };
  if (!size.is_array() || size.size() != 2 || !good(size[0]) || !good(size[1])) {
    return BadRequest(absl::StrCat("`", reading.path, ".size` must be [width, height] in pixels"));
  }
  return Size{static_cast<int>(size[0].get<double>()), static_cast<int>(size[1].get<double>())};
}

absl::StatusOr<v1::Image> ImageFrom(const Element& reading, const Size& size) {
  std::string bytes;
  const auto bad = [&](absl::string_view key, absl::string_view what) {
    return BadRequest(absl::StrCat("`", reading.path, ".", key, "` ", what));
  };
  const std::string text = TextOf(Member(*reading.json, "imageBytes"));
  if (text.empty()) return bad("imageBytes", "must be the image, in base64");
  if (!absl::Base64Unescape(text, &bytes)) return bad("imageBytes", "is not base64");
  if (Member(Member(*reading.json, "imageOrientation"), "mirrored") == nlohmann::json(true)) {
    return bad("imageOrientation.mirrored", "is true, and such images are not located: turn it back before sending it");
  }
  const std::string format = TextOf(Member(*reading.json, "imageFormat"));
  const std::size_t pixels = static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px);
  v1::Image image;
  if (format == "JPG" || format == "JPEG" || format == "PNG") {
    image.set_encoded(std::move(bytes));
  } else if (format == "GRAY8") {
    image.set_gray(std::move(bytes));
  } else if (format == "RGBA32") {
    if (bytes.size() != 4 * pixels) return bad("imageBytes", "must be 4 bytes a pixel");
    std::string& rgb = *image.mutable_rgb();
    rgb.resize(3 * pixels);
    for (std::size_t i = 0; i < pixels; ++i) std::copy_n(&bytes[4 * i], 3, &rgb[3 * i]);
  } else {
    return bad("imageFormat", "must be JPG, GRAY8 or RGBA32");
  }
  return image;
}

absl::StatusOr<Camera> CameraFrom(const Element& reading, const Size& size) {
  const nlohmann::json& params = Member(*reading.json, "params");
  const std::string path = absl::StrCat(reading.path, ".params");
  if (!params.is_object()) return BadRequest(absl::StrCat("`", path, "` must be {model, modelParams}, as COLMAP's"));
  nlohmann::json camera = {{"width", size.width_px}, {"height", size.height_px}};
  if (params.contains("model")) camera["model"] = params["model"];
  if (params.contains("modelParams")) camera["params"] = params["modelParams"];
  absl::StatusOr<Camera> read = CameraFromJson(camera.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  CAIRN_RETURN_IF_ERROR(Annotate(read.status(), absl::StrCat("geopose: `", path, "`")));
  return read;
}

absl::Status SetPrior(const GeoPosition& prior, const absl::StatusOr<double>& accuracy_m, absl::string_view path,
                      GeoPoseRequest* request) {
  request->prior = prior;
  request->prior_accuracy_m = accuracy_m.ok() ? std::max(0.0, *accuracy_m) : 0.0;
  return Annotate(prior.Validate(), absl::StrCat("geopose: `", path, "`"));
}

absl::Status ReadPriorPose(const Element& pose, GeoPoseRequest* request) {
  const nlohmann::json& position = Member(Member(*pose.json, "geopose"), "position");
  const std::string path = absl::StrCat(pose.path, ".geopose.position");
  GeoPosition prior;
  CAIRN_ASSIGN_OR_RETURN(prior.latitude_deg, NumberOf(position, "lat", path));
  CAIRN_ASSIGN_OR_RETURN(prior.longitude_deg, NumberOf(position, "lon", path));
  CAIRN_ASSIGN_OR_RETURN(prior.height_m, NumberOf(position, "h", path));
  return SetPrior(prior, NumberOf(Member(*pose.json, "accuracy"), "position", pose.path), path, request);
}

absl::Status ReadGeolocation(const Element& reading, GeoPoseRequest* request) {
  GeoPosition prior;
  CAIRN_ASSIGN_OR_RETURN(prior.latitude_deg, NumberOf(*reading.json, "latitude", reading.path));
  CAIRN_ASSIGN_OR_RETURN(prior.longitude_deg, NumberOf(*reading.json, "longitude", reading.path));
  const auto altitude = NumberOf(*reading.json, "altitude", reading.path);  // null where the device does not know
  prior.height_m = altitude.ok() ? *altitude : 0.0;
  return SetPrior(prior, NumberOf(*reading.json, "accuracy", reading.path), reading.path, request);
}

absl::Status ReadPrior(const nlohmann::json& body, GeoPoseRequest* request) {
  CAIRN_ASSIGN_OR_RETURN(const Element pose, NewestOf(Member(body, "priorPoses"), "priorPoses"));
  if (pose.json != nullptr) return ReadPriorPose(pose, request);
  // The protocol's client library writes the name in another way than the protocol.
  for (const char* name : {"geolocationReadings", "geoLocationReadings"}) {
    CAIRN_ASSIGN_OR_RETURN(const Element reading, NewestOf(Member(Member(body, "sensorReadings"), name), name));
    if (reading.json != nullptr) return ReadGeolocation(reading, request);
  }
  return absl::OkStatus();
}

// Mean of the standard deviations along three axes.
double MeanSigma(const Matrix3d& covariance) { return covariance.diagonal().cwiseMax(0.0).cwiseSqrt().mean(); }

std::string AnswerText(const GeoPoseRequest& request, const map::GeoPose& pose, const GeoPoseAccuracy& accuracy) {
  const Quaterniond& q = pose.enu_from_body;
  const nlohmann::ordered_json answer = {
      {"id", request.id},
      {"timestamp", request.timestamp_ms},
      {"accuracy", {{"position", accuracy.position_m}, {"orientation", accuracy.orientation_deg}}},
      {"type", "geopose"},
      {"geopose",
       {{"position",
         {{"lon", pose.position.longitude_deg}, {"lat", pose.position.latitude_deg}, {"h", pose.position.height_m}}},
        {"quaternion", {{"x", q.x()}, {"y", q.y()}, {"z", q.z()}, {"w", q.w()}}}}}};
  return answer.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// The one that is configured, or all.
absl::StatusOr<std::vector<api::MapSummary>> MapsToAsk(const CallContext& context, absl::string_view only) {
  if (only.empty()) return context.maps->List();
  const absl::StatusOr<api::MapDescription> map = context.maps->Describe(std::string(only));
  CAIRN_RETURN_IF_ERROR(Annotate(map.status(), "geopose: this server is set to ask one map (--geopose-map)"));
  return std::vector<api::MapSummary>{map->summary};
}

// An answer of a map, on the earth.
struct Placed {
  map::GeoPose pose;
  GeoPoseAccuracy accuracy;
};

std::optional<Placed> PlacedBy(const api::AnswerOfMap& answer, const std::vector<api::MapSummary>& maps) {
  const auto map = std::ranges::find(maps, answer.map, &api::MapSummary::name);
  if (!answer.answer.localized || !answer.answer.world_is_metric || map == maps.end()) return std::nullopt;
  return Placed{map::GeoPoseOf(*map->geo_anchor, answer.answer.world_from_camera), AccuracyOf(answer.answer)};
}

// Maps of one area overlap: those that put the camera at the same place do not contradict each other.
bool Agree(const Placed& a, const Placed& b) {
  constexpr double kAlways_m = 1.0;  // anchors are hardly better
  const double distance_m = (EcefFromGeodetic(a.pose.position) - EcefFromGeodetic(b.pose.position)).norm();
  return distance_m <= kAlways_m + 3.0 * (a.accuracy.position_m + b.accuracy.position_m);
}

// The best answer, unless another map contradicts it; NotFound says why there is none.
absl::StatusOr<Placed> Judge(const api::AcrossAnswer& across, const std::vector<api::MapSummary>& maps) {
  const api::AnswerOfMap& best = across.answers.at(0);
  if (!best.answer.localized) {
    return absl::NotFoundError(absl::StrCat("geopose: the camera was not found: ",
                                            best.status.ok() ? best.answer.reason : best.status.message()));
  }
  const std::optional<Placed> placed = PlacedBy(best, maps);
  if (!placed) {
    return absl::NotFoundError("geopose: the camera was found in a part of the map whose place is not known");
  }
  if (!across.ambiguous) return *placed;
  for (const api::AnswerOfMap& other : across.answers) {
    if (std::ranges::find(across.rivals, other.map) == across.rivals.end()) continue;
    if (!other.answer.localized) {
      return absl::NotFoundError(absl::StrCat("geopose: the image fits several places of map ", other.map));
    }
    const std::optional<Placed> elsewhere = PlacedBy(other, maps);
    if (elsewhere && !Agree(*placed, *elsewhere)) {
      return absl::NotFoundError(absl::StrCat("geopose: the image fits the maps ", best.map, " and ", other.map,
                                              " about as well, at different places"));
    }
  }
  return *placed;
}

absl::StatusOr<std::string> Find(const CallContext& context, const HttpRequest& http, absl::string_view only) {
  CAIRN_RETURN_IF_ERROR(CheckGeoPoseVersion(http.accept));
  CAIRN_ASSIGN_OR_RETURN(const GeoPoseRequest request, ReadGeoPoseRequest(http.body));
  api::LocalizeQuery query;
  query.camera = request.camera;
  CAIRN_RETURN_IF_ERROR(Annotate(query.camera.Validate(), "geopose"));
  CAIRN_ASSIGN_OR_RETURN(query.image, GrayImageOf(request.image, query.camera, context.images));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::MapSummary> maps, MapsToAsk(context, only));
  if (!only.empty() && !maps.at(0).geo_anchor) {
    return absl::NotFoundError(
        absl::StrCat("geopose: the map ", only,
                     ", which this server is set to ask "
                     "(--geopose-map), has no geographic anchor: cairn align --geo gives it one"));
  }
  CAIRN_ASSIGN_OR_RETURN(const std::vector<std::string> near, MapsNear(maps, request));
  CAIRN_ASSIGN_OR_RETURN(const api::AcrossAnswer across, context.maps->LocalizeAcross(near, query));
  if (context.observer != nullptr && !across.answers.empty() && across.answers[0].status.ok()) {
    context.observer->OnLocalized(across.answers[0].answer);
  }
  CAIRN_ASSIGN_OR_RETURN(const Placed placed, Judge(across, maps));
  return AnswerText(request, placed.pose, placed.accuracy);
}

}  // namespace

absl::Status CheckGeoPoseVersion(absl::string_view accept) {
  const absl::Status wrong =
      BadRequest(absl::StrCat("the header Accept must take version 2.0 of the protocol: ", kGeoPoseMediaType));
  for (const absl::string_view range : absl::StrSplit(accept, ',')) {
    const std::vector<std::string> parts = absl::StrSplit(absl::AsciiStrToLower(range), ';');
    const absl::string_view type = absl::StripAsciiWhitespace(parts[0]);
    // Whoever takes anything takes the newest version.
    if (type == "*/*" || type == "application/*" || type == "application/json") return absl::OkStatus();
    if (type != "application/vnd.oscp+json") continue;
    for (std::size_t i = 1; i < parts.size(); ++i) {
      const std::vector<absl::string_view> pair = absl::StrSplit(parts[i], '=');
      if (pair.size() != 2 || absl::StripAsciiWhitespace(pair[0]) != "version") continue;
      absl::string_view version = absl::StripAsciiWhitespace(pair[1]);
      if (version.size() >= 2 && version.front() == '"' && version.back() == '"') {
        version = version.substr(1, version.size() - 2);
      }
      if (version == "2.0" || version == "2") return absl::OkStatus();
    }
  }
  return wrong;
}

absl::StatusOr<GeoPoseRequest> ReadGeoPoseRequest(const std::string& body) {
  const nlohmann::json parsed = nlohmann::json::parse(body, nullptr, /*allow_exceptions=*/false);
  if (!parsed.is_object()) return BadRequest("the body must be a GeoPoseReq in JSON");
  GeoPoseRequest request;
  request.id = TextOf(Member(parsed, "id"));
  if (Member(parsed, "id").is_null()) return BadRequest("`id` is missing");
  if (request.id.empty()) return BadRequest("`id` must be a text that is not empty");
  const nlohmann::json& type = Member(parsed, "type");
  if (!type.is_null() && type != "geopose") return BadRequest("`type` must be geopose");
  CAIRN_ASSIGN_OR_RETURN(const std::optional<double> time_ms, TimestampOf(parsed, ""));
  request.timestamp_ms = static_cast<std::int64_t>(time_ms.value_or(0.0));
  const nlohmann::json& readings = Member(Member(parsed, "sensorReadings"), "cameraReadings");
  CAIRN_ASSIGN_OR_RETURN(const Element reading, NewestOf(readings, "cameraReadings"));
  if (reading.json == nullptr) return BadRequest("the request has no camera readings");
  CAIRN_ASSIGN_OR_RETURN(const Size size, SizeFrom(reading));
  CAIRN_ASSIGN_OR_RETURN(request.camera, CameraFrom(reading, size));
  CAIRN_ASSIGN_OR_RETURN(request.image, ImageFrom(reading, size));
  CAIRN_RETURN_IF_ERROR(ReadPrior(parsed, &request));
  return request;
}

GeoPoseAccuracy AccuracyOf(const api::LocatedPose& located) {
  // The covariance is of a left increment, which turns about the origin of the map: of the centre of the camera it is
  // that of the increment's translation and what turning adds.
  Eigen::Matrix<double, 3, 6> center_by_increment;
  center_by_increment << Matrix3d::Identity(), -Hat(located.map_from_camera.translation());
  const Matrix3d center = center_by_increment * located.covariance * center_by_increment.transpose();
  const Matrix3d rotation = located.covariance.bottomRightCorner<3, 3>();
  const Matrix3d world_from_map =
      (located.world_from_camera.rotation() * located.map_from_camera.rotation().conjugate()).toRotationMatrix();
  return {located.world_per_map * MeanSigma(world_from_map * center * world_from_map.transpose()),
          kDegreesPerRad * MeanSigma(world_from_map * rotation * world_from_map.transpose())};
}

absl::StatusOr<std::vector<std::string>> MapsNear(const std::vector<api::MapSummary>& maps,
                                                  const GeoPoseRequest& request) {
  // A map reaches as far from its anchor as somebody has walked, and a prior may be of a cell of a phone network.
  constexpr double kReach_m = 5000.0;
  constexpr std::size_t kMaxMaps = 8;
  struct Candidate {
    double distance_m;
    std::string name;
  };
  std::vector<Candidate> candidates;
  for (const api::MapSummary& map : maps) {
    if (!map.geo_anchor) continue;
    double distance_m = 0.0;
    if (request.prior) {
      distance_m = (EcefFromGeodetic(*request.prior) - EcefFromGeodetic(map::PositionOf(*map.geo_anchor))).norm();
      if (distance_m > kReach_m + 3.0 * request.prior_accuracy_m) continue;
    }
    candidates.push_back({distance_m, map.name});
  }
  if (candidates.empty()) {
    return absl::NotFoundError(request.prior ? "geopose: there is no map near the position that the request names"
                                             : "geopose: no map here has a geographic anchor (cairn align --geo)");
  }
  std::ranges::stable_sort(candidates, {}, &Candidate::distance_m);
  if (candidates.size() > kMaxMaps) candidates.resize(kMaxMaps);
  std::vector<std::string> names;
  for (Candidate& candidate : candidates) names.push_back(std::move(candidate.name));
  return names;
}

HttpResponse AnswerGeoPose(const CallContext& server, const Caller& caller, const HttpRequest& http,
                           absl::string_view only) {
  std::string answer;
  const Served served = Serve(server, caller, "GeoPose", [&](const CallContext& context) -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(answer, Find(context, http, only));
    return absl::OkStatus();
  });
  if (!served.status.ok()) return ErrorResponse(served.status, served.request_id);
  return {200, std::string(kGeoPoseMediaType), answer};
}

}  // namespace cairn::server
