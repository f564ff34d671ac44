#include "server/http/localize_request.h"

#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "base/shown.h"
#include "server/http/camera_json.h"
#include "server/http/json_body.h"
#include "server/http/multipart.h"
#include "server/http/query.h"
#include "wire/convert.h"
#include "wire/image_header.h"

namespace cairn::server {
namespace {

// The message in the body, with what the query adds to it.
template <class Request>
absl::StatusOr<Request> FromJson(const HttpRequest& http) {
  Request request;
  CAIRN_RETURN_IF_ERROR(ReadJsonMessage(http.body, &request));
  CAIRN_ASSIGN_OR_RETURN(const QueryParameters parameters, ParseQuery(http.query));
  CAIRN_RETURN_IF_ERROR(SetFields(parameters, "map", &request));
  return request;
}

// What is said of maps goes to `maps`, unless it is null.
template <class Request>
absl::StatusOr<Request> FromForm(const std::vector<FormPart>& parts, std::string* maps) {
  Request request;
  std::string camera_json;
  for (const FormPart& part : parts) {
    if (part.name == "image") {
      request.mutable_image()->set_encoded(std::string(part.content));
    } else if (part.name == "camera") {
      camera_json = std::string(part.content);
    } else if (part.name == "time_ns") {
      std::int64_t time_ns = 0;
      if (!absl::SimpleAtoi(part.content, &time_ns)) {
        return absl::InvalidArgumentError("time_ns: must be a whole number of nanoseconds");
      }
      request.set_time_ns(time_ns);
    } else if (part.name == "maps" && maps != nullptr) {
      *maps = std::string(part.content);
      if (maps->find_first_not_of(", ") == std::string::npos) {
        return absl::InvalidArgumentError("maps: name them, with commas between, or leave the part out for all");
      }
    } else {
      return absl::InvalidArgumentError(absl::StrCat("form: there is no part `", Shown(part.name, 40),
                                                     "` here; there are image, camera, time_ns",
                                                     maps != nullptr ? ", maps" : "; the map is named by the path"));
    }
  }
  if (!request.has_image()) return absl::InvalidArgumentError("form: the part `image` is missing: a PNG or JPEG file");
  if (camera_json.empty()) {
    return absl::InvalidArgumentError(
        R"(form: the part `camera` is missing: {"model": "PINHOLE", "params": [fx, fy, cx, cy]})");
  }
  CAIRN_ASSIGN_OR_RETURN(Camera camera, CameraFromJson(camera_json));
  if (camera.width_px == 0 && camera.height_px == 0) {
    CAIRN_ASSIGN_OR_RETURN(const wire::ImageSize size, wire::EncodedImageSize(request.image().encoded()));
    camera.width_px = size.width_px;
    camera.height_px = size.height_px;
  }
  wire::ToProto(camera, request.mutable_camera());
  return request;
}

absl::Status CheckNoQuery(const HttpRequest& http, absl::string_view parts) {
  if (http.query.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("query: with a form, its parts say everything: ", parts, " stand there"));
}

}  // namespace

absl::StatusOr<v1::LocalizeImageRequest> ReadLocalizeRequest(const HttpRequest& http) {
  using Request = v1::LocalizeImageRequest;
  if (absl::StartsWithIgnoreCase(http.content_type, "application/json")) return FromJson<Request>(http);
  CAIRN_RETURN_IF_ERROR(CheckNoQuery(http, "image, camera and time_ns"));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<FormPart> parts, ParseForm(http.content_type, http.body));
  return FromForm<Request>(parts, nullptr);
}

absl::StatusOr<v1::LocalizeInMapsRequest> ReadLocalizeInMapsRequest(const HttpRequest& http) {
  using Request = v1::LocalizeInMapsRequest;
  if (absl::StartsWithIgnoreCase(http.content_type, "application/json")) return FromJson<Request>(http);
  CAIRN_RETURN_IF_ERROR(CheckNoQuery(http, "image, camera, time_ns and maps"));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<FormPart> parts, ParseForm(http.content_type, http.body));
  std::string maps;
  CAIRN_ASSIGN_OR_RETURN(Request request, FromForm<Request>(parts, &maps));
  for (const absl::string_view map : absl::StrSplit(maps, ',', absl::SkipEmpty())) request.add_maps(std::string(map));
  return request;
}

}  // namespace cairn::server
