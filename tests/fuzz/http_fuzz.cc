// Bodies of HTTP requests: the first line is the content type, the rest is the body.
#include <google/protobuf/stubs/logging.h>

#include "server/http/camera_json.h"
#include "server/http/localize_request.h"
#include "server/http/multipart.h"
#include "wire/convert.h"

using namespace cairn;

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  google::protobuf::SetLogHandler(nullptr);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  const std::size_t line = text.find('\n');
  server::HttpRequest request{"POST", "/v1/maps/room:localize", text.substr(0, line),
                              line == std::string::npos ? "" : text.substr(line + 1)};
  const absl::StatusOr<v1::LocalizeImageRequest> read = server::ReadLocalizeRequest(request);
  if (read.ok()) (void)wire::FromProto(read->camera());
  const absl::StatusOr<Camera> camera = server::CameraFromJson(request.body);
  if (camera.ok()) (void)camera->Validate();
  const auto parts = server::ParseForm(request.content_type, request.body);
  if (parts.ok()) {
    for (const server::FormPart& part : *parts) {
      if (part.content.data() < request.body.data() ||
          part.content.data() + part.content.size() > request.body.data() + request.body.size()) {
        std::abort();
      }
    }
  }
  return 0;
}
