// cairn verify: whether a map is good, and what is wrong with it.
#include <cstdio>
#include <iostream>

#include "cli/cli.h"
#include "cli/findings.h"
#include "cli/server_option.h"
#include "host/inspect.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct VerifyOptions {
  std::string map;
  ServerChoice server;
  bool deep = false;
  bool json = false;
};

nlohmann::ordered_json AsJson(const api::MapVerification& report, const VerifyOptions& options) {
  nlohmann::ordered_json json = {{"map", options.map}, {"good", report.findings.empty()}, {"deep", options.deep}};
  json["revision"] = nullptr;
  if (report.summary) {
    json["revision"] = report.summary->revision;
    json["keyframes"] = report.summary->keyframes;
    json["points"] = report.summary->points;
  }
  json["findings"] = FindingsAsJson(report.findings);
  json["notes"] = report.notes;
  return json;
}

std::string Describe(const map::Finding& finding) {
  if (finding.table.empty()) return finding.message;
  if (finding.id == 0) return absl::StrCat(finding.table, ": ", finding.message);
  return absl::StrCat(finding.table, " ", finding.id, ": ", finding.message);
}

void Print(const api::MapVerification& report, const VerifyOptions& options) {
  for (const std::string& note : report.notes) std::cerr << "cairn verify: " << note << "\n";
  for (const map::Finding& finding : report.findings) std::printf("%s\n", Describe(finding).c_str());
  if (report.findings.empty() && report.summary) {
    std::printf("%s: good. Revision %llu, %lld keyframes, %lld points: structure, checksums and references%s\n",
                text::Shown(options.map).c_str(), static_cast<unsigned long long>(report.summary->revision),
                static_cast<long long>(report.summary->keyframes), static_cast<long long>(report.summary->points),
                options.deep ? ", words and geometry" : " (--deep also checks words and geometry)");
    return;
  }
  const std::string file = options.server.empty() ? options.map : absl::StrCat("MAPS/", options.map, ".cairn");
  std::printf(
      "%s: DAMAGED, %zu finding%s. Keep the file as it is, and get back what is good with%s:\n"
      "  cairn recover %s NEW.cairn\n",
      text::Shown(options.map).c_str(), report.findings.size(), report.findings.size() == 1 ? "" : "s",
      options.server.empty() ? "" : ", where the server keeps it", file.c_str());
}

absl::StatusOr<api::MapVerification> Check(const VerifyOptions& options) {
  const api::VerifyDepth depth = options.deep ? api::VerifyDepth::kDeep : api::VerifyDepth::kStored;
  if (options.server.empty()) return host::VerifyMap(options.map, options.map, depth);
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(options.server));
  return service->Verify(options.map, depth);
}

absl::StatusOr<int> Verify(const VerifyOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapVerification report, Check(options));
  if (options.json) {
    PrintJson(AsJson(report, options));
  } else {
    Print(report, options);
  }
  return report.findings.empty() ? kOk : kDamagedMap;
}

}  // namespace

void AddVerifyCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("verify", "Check a map: whether everything in it is as it was written");
  auto options = std::make_shared<VerifyOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn), with --server the name of a map there")->required();
  verb->add_flag("--deep", options->deep, "Check also that the map makes sense: geometry, words, linked components");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Exit code 0: the map is good; 3: it is damaged, and what is wrong is listed.\n"
      "Nothing is changed. What is good of a damaged map is saved by 'cairn recover'.\n"
      "Examples:\n"
      "  cairn verify office.cairn\n"
      "  cairn verify office.cairn --deep --json\n"
      "  cairn --server localhost:7878 verify office");
  verb->callback([=, &app] {
    options->server = ServerOf(app);
    *action = [=] {
      const absl::StatusOr<int> code = Verify(*options);
      return code.ok() ? *code : Fail("verify", code.status(), options->json);
    };
  });
}

}  // namespace cairn::cli
