#include "cli/localize_across.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/cli.h"
#include "cli/localize_answer.h"
#include "client/local_localizer.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// As of api::MapService::LocalizeAcross().
absl::Status TooMany(std::size_t count) {
  return absl::InvalidArgumentError(absl::StrCat("localize: ", count, " maps are too many at once, at most ",
                                                 api::kMaxMapsAcross, ": name those that it may be"));
}

class ServedMaps final : public AcrossTarget {
 public:
  ServedMaps(std::unique_ptr<client::RemoteMapService> service, std::vector<std::string> maps)
      : service_(std::move(service)), maps_(std::move(maps)) {}

  absl::StatusOr<std::vector<CamerasOfMap>> Cameras() override {
    std::vector<std::string> names = maps_;
    if (names.empty()) {
      CAIRN_ASSIGN_OR_RETURN(const std::vector<api::MapSummary> all, service_->List());
      for (const api::MapSummary& map : all) names.push_back(map.name);
    }
    if (names.size() > api::kMaxMapsAcross) return TooMany(names.size());
    std::vector<CamerasOfMap> cameras;
    absl::Status unread;
    for (const std::string& name : names) {
      const absl::StatusOr<api::MapDescription> map = service_->Describe(name);
      unread.Update(map.status());
      if (!map.ok()) continue;  // the answer says so, too
      CamerasOfMap& of_map = cameras.emplace_back(CamerasOfMap{name, {}});
      for (const api::CameraInfo& camera : map->cameras) of_map.cameras.push_back(camera.camera);
    }
    if (cameras.empty()) CAIRN_RETURN_IF_ERROR(unread);
    return cameras;
  }

  absl::StatusOr<api::AcrossAnswer> Localize(const api::LocalizeQuery& query) override {
    return service_->LocalizeAcross(maps_, query);
  }

 private:
  const std::unique_ptr<client::RemoteMapService> service_;
  const std::vector<std::string> maps_;
};

// One is open at a time: together they may be larger than the memory.
class MapFiles final : public AcrossTarget {
 public:
  explicit MapFiles(std::vector<std::string> files) : files_(std::move(files)) {}

  absl::StatusOr<std::vector<CamerasOfMap>> Cameras() override {
    std::vector<CamerasOfMap> cameras;
    absl::Status unread;
    for (const std::string& file : files_) {
      const auto map = client::LocalLocalizer::Open(file);
      unread.Update(map.status());
      if (map.ok()) cameras.push_back({file, CamerasOf((*map)->snapshot())});
    }
    if (cameras.empty()) CAIRN_RETURN_IF_ERROR(unread);
    return cameras;
  }

  absl::StatusOr<api::AcrossAnswer> Localize(const api::LocalizeQuery& query) override {
    const client::LocalLocalizerOptions options;
    std::vector<api::AnswerOfMap> answers;
    absl::Status unread;
    for (const std::string& file : files_) {
      const auto map = client::LocalLocalizer::Open(file, options);
      unread.Update(map.status());
      api::AnswerOfMap& answer = answers.emplace_back(api::AnswerOfMap{file, map.status(), {}});
      if (!map.ok()) continue;
      // What is wrong with the question is wrong with it everywhere.
      CAIRN_ASSIGN_OR_RETURN(answer.answer, (*map)->Localize(query));
    }
    const bool none = std::ranges::none_of(answers, [](const auto& answer) { return answer.status.ok(); });
    if (none) CAIRN_RETURN_IF_ERROR(unread);
    return api::JudgeAcross(std::move(answers), options.relocalizer.max_rival_share);
  }

 private:
  const std::vector<std::string> files_;
};

nlohmann::ordered_json AsJson(const api::AcrossAnswer& across, const std::string& image, TimeNs time_ns) {
  nlohmann::ordered_json answers = nlohmann::ordered_json::array();
  for (const api::AnswerOfMap& answer : across.answers) {
    nlohmann::ordered_json& json = answers.emplace_back(nlohmann::ordered_json{{"in_map", answer.map}});
    if (answer.status.ok()) {
      json.update(AnswerToJson(answer.answer, image, time_ns));
    } else {
      json["error"] = answer.status.message();
    }
  }
  nlohmann::ordered_json json = {{"image", image},
                                 {"localized", across.located() != nullptr},
                                 {"in_map", nullptr},
                                 {"ambiguous_maps", across.ambiguous},
                                 {"rivals", across.rivals}};
  if (across.located() != nullptr) {
    json.update(answers[0]);
  }
  json["answers"] = answers;
  return json;
}

void Print(const api::AcrossAnswer& across, const std::string& image) {
  if (across.ambiguous) {
    std::printf(across.rivals.size() > 1 ? "the image fits several maps about as well: %s\n"
                                         : "the image fits several places of one map about as well: %s\n",
                text::Shown(absl::StrJoin(across.rivals, ", ")).c_str());
  }
  if (across.answers.empty()) text::Say("there is no map\n");
  for (const api::AnswerOfMap& answer : across.answers) {
    if (across.located() != nullptr && answer.status.ok() && !answer.answer.localized) continue;
    if (answer.status.ok()) {
      PrintLocalizeAnswer(answer.answer, image, absl::StrCat(text::Shown(answer.map), ": "));
    } else {
      text::Say(absl::StrFormat("%s\n", answer.status.message()));
    }
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<AcrossTarget>> OpenAcrossTarget(const ServerChoice& server,
                                                               const std::vector<std::string>& maps) {
  if (server.empty()) {
    if (maps.size() > api::kMaxMapsAcross) return TooMany(maps.size());
    return std::make_unique<MapFiles>(maps);
  }
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<client::RemoteMapService> service, ConnectTo(server));
  return std::make_unique<ServedMaps>(std::move(service), maps);
}

int TellAcross(const api::AcrossAnswer& across, const std::string& image, bool json) {
  if (json) {
    PrintJson(AsJson(across, image, /*time_ns=*/0));
  } else {
    Print(across, image);
  }
  return across.located() != nullptr ? kOk : kNotLocalized;
}

}  // namespace cairn::cli
