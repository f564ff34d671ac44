// Whole requests over HTTP, behind what Boost.Beast makes of them: lines with method and path, content type, Accept and
// Origin, the rest is the body. Whatever is asked, the answer is of a documented status, JSON where it says so, and its
// headers are a line each.
#include <google/protobuf/stubs/logging.h>

#include <nlohmann/json.hpp>

#include "server/http/http_api.h"

using namespace cairn;

namespace {

// Has the map `room`, aligned and on the earth, in which everything is located.
class FakeMaps : public api::MapService {
 public:
  absl::StatusOr<std::vector<api::MapSummary>> List() override { return std::vector{Summary()}; }
  absl::StatusOr<api::MapDescription> Describe(const std::string& map) override {
    api::MapDescription description;
    description.summary = Summary();
    return Of(map, description);
  }
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& /*query*/) override {
    return Of(map, Located());
  }
  absl::StatusOr<api::AcrossAnswer> LocalizeAcross(const std::vector<std::string>& maps,
                                                   const api::LocalizeQuery& /*query*/) override {
    for (const std::string& map : maps) {
      if (const auto found = Of(map, 0); !found.ok()) return found.status();
    }
    return api::AcrossAnswer{.map = "room", .answers = {{"room", absl::OkStatus(), Located()}}};
  }
  absl::StatusOr<std::unique_ptr<api::Tracker>> NewTracker(const std::string& map, const Camera& /*camera*/) override {
    return Of(map, 0).status();
  }
  absl::StatusOr<std::unique_ptr<api::MapFeed>> Follow(const std::string& map,
                                                       const api::FollowRequest& /*request*/) override {
    return Of(map, 0).status();
  }
  absl::StatusOr<std::unique_ptr<api::MapSession>> StartSession(const api::SessionRequest& request) override {
    return Of(request.map, 0).status();
  }
  absl::StatusOr<std::unique_ptr<api::MapSession>> ResumeSession(const std::string& token) override {
    return Of(token, 0).status();
  }
  absl::StatusOr<std::vector<api::ActiveSession>> Sessions(const std::string& map) override {
    return Of(map, std::vector<api::ActiveSession>(1));
  }
  absl::StatusOr<api::MapSummary> Create(const std::string& map, const std::string& title) override {
    api::MapSummary created = Summary();
    created.title = title;
    return Of(map, created);
  }
  absl::StatusOr<api::MapSummary> Snapshot(const std::string& map, const std::string& as) override {
    if (const absl::Status name = api::CheckMapName(as); !name.ok()) return name;
    return Of(map, Summary());
  }
  absl::StatusOr<std::string> Delete(const std::string& map) override { return Of(map, map + ".1"); }
  absl::StatusOr<std::vector<api::DeletedMap>> ListDeleted() override {
    return std::vector<api::DeletedMap>{{"room.1", "room", 1, 1}};
  }
  absl::StatusOr<std::string> Restore(const std::string& deleted, const std::string& as) override {
    const auto name = api::ParseDeletedName(deleted);
    if (!name.ok()) return name.status();
    return as.empty() ? name->map : as;
  }
  absl::StatusOr<api::MapVerification> Verify(const std::string& map, api::VerifyDepth /*depth*/) override {
    return Of(map, api::MapVerification{Summary(), {{}}, {"a note"}});
  }
  absl::StatusOr<api::AlignAnswer> Align(const std::string& map, const api::AlignRequest& request) override {
    if (const absl::Status good = request.Validate(); !good.ok()) return good;
    return Of(map, api::AlignAnswer{.component = api::ComponentAlignment()});
  }
  absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session) override {
    api::SessionRemoval removal;
    removal.session = session;
    return Of(map, removal);
  }
  absl::StatusOr<map::MapOverview> Overview(const std::string& map) override { return Of(map, map::MapOverview()); }
  absl::StatusOr<api::MapLog> Log(const std::string& map, const map::ChangeQuery& /*query*/) override {
    return Of(map, api::MapLog{1, {{}}});
  }
  absl::Status Export(const std::string& map, api::ExportContent /*content*/, const api::ExportSink& sink) override {
    if (const auto found = Of(map, 0); !found.ok()) return found.status();
    return sink("part");
  }

 private:
  static api::MapSummary Summary() {
    api::MapSummary summary;
    summary.name = "room";
    summary.geo_anchor = map::GeoAnchor{60.17, 24.94, 30.0};
    return summary;
  }
  static api::LocalizeAnswer Located() {
    api::LocalizeAnswer answer;
    answer.localized = answer.world_is_metric = true;
    answer.stage = api::LocalizeStage::kDone;
    return answer;
  }
  template <class Answer>
  static absl::StatusOr<Answer> Of(const std::string& map, Answer answer) {
    if (const absl::Status name = api::CheckMapName(map); !name.ok()) return name;
    if (map != "room") return absl::NotFoundError("there is no map " + map);
    return answer;
  }
};

// The line at the front of `rest`, without its end.
std::string TakeLine(absl::string_view* rest) {
  const std::size_t end = rest->find('\n');
  const std::string line(rest->substr(0, end));
  rest->remove_prefix(end == absl::string_view::npos ? rest->size() : end + 1);
  return line;
}

void CheckHead(const server::HttpResponse& response) {
  if (response.status < 200 || response.status > 599) std::abort();
  for (const auto& [name, value] : response.headers) {
    if ((name + value).find_first_of(std::string("\r\n\0", 3)) != std::string::npos) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  google::protobuf::SetLogHandler(nullptr);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static FakeMaps maps;
  static const server::HttpApi api({&maps, {.max_pixels = 10'000}},
                                   {[] { return absl::OkStatus(); }, [] { return std::string("metrics 1\n"); }},
                                   {{"https://maps.example.org"}});
  absl::string_view rest(reinterpret_cast<const char*>(data), size);
  server::HttpRequest request;
  const std::string target = TakeLine(&rest);
  const std::size_t space = target.find(' ');
  request.method = target.substr(0, space);
  request.path = space == std::string::npos ? "/" : target.substr(space + 1);
  if (const std::size_t mark = request.path.find('?'); mark != std::string::npos) {
    request.query = request.path.substr(mark + 1);
    request.path.resize(mark);
  }
  request.content_type = TakeLine(&rest);
  request.accept = TakeLine(&rest);
  request.origin = TakeLine(&rest);
  request.body = std::string(rest);
  request.send_part = [](const server::HttpResponse& head, absl::string_view /*part*/) {
    CheckHead(head);
    return absl::OkStatus();
  };
  // As the connection gives them: no header has the end of a line in it, and no path what would end it.
  for (std::string* text : {&request.content_type, &request.accept, &request.origin, &request.path, &request.query}) {
    std::erase_if(*text, [](char c) { return c == '\r' || c == '\0'; });
  }
  const server::HttpResponse response = api.Handle(request);
  CheckHead(response);
  const bool has_text = response.status != 204 && !response.body.empty();
  if (has_text && response.content_type == "application/json" && !nlohmann::json::accept(response.body)) std::abort();
  return 0;
}
