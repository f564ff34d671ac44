#include "cli/localize_across.h"

#include <cstdio>
#include <memory>

#include "cli/cli.h"
#include "cli/localize_answer.h"
#include "cli/server_option.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

nlohmann::ordered_json AsJson(const api::AcrossAnswer& across, const std::string& image, TimeNs time_ns) {
  nlohmann::ordered_json answers = nlohmann::ordered_json::array();
  for (const api::AnswerOfMap& answer : across.answers) {
    nlohmann::ordered_json& json = answers.emplace_back(nlohmann::ordered_json{{"in_map", answer.map}});
    if (answer.status.ok()) {
      json.update(AnswerToJson(answer.answer, image, time_ns));
    } else {
      json["error"] = std::string(answer.status.message());
    }
  }
  nlohmann::ordered_json json = {{"image", image},
                                 {"localized", across.located() != nullptr},
                                 {"in_map", nullptr},
                                 {"ambiguous_maps", across.ambiguous}};
  if (across.located() != nullptr) {
    json.update(answers[0]);
  }
  json["answers"] = answers;
  return json;
}

void Print(const api::AcrossAnswer& across, const std::string& image) {
  if (across.ambiguous) std::printf("the image fits several maps about as well:\n");
  if (across.answers.empty()) std::printf("there is no map\n");
  for (const api::AnswerOfMap& answer : across.answers) {
    if (across.located() != nullptr && answer.status.ok() && !answer.answer.localized) continue;
    std::printf("%s: ", text::Shown(answer.map).c_str());
    if (answer.status.ok()) {
      PrintLocalizeAnswer(answer.answer, image);
    } else {
      std::printf("%s\n", std::string(answer.status.message()).c_str());
    }
  }
}

}  // namespace

absl::StatusOr<int> LocalizeAcrossMaps(const ServerChoice& server, const std::vector<std::string>& maps,
                                       const api::LocalizeQuery& query, const std::string& image, bool json) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(server));
  CAIRN_ASSIGN_OR_RETURN(const api::AcrossAnswer across, service->LocalizeAcross(maps, query));
  if (json) {
    PrintJson(AsJson(across, image, query.time_ns));
  } else {
    Print(across, image);
  }
  return across.located() != nullptr ? kOk : kNotLocalized;
}

}  // namespace cairn::cli
