// cairn verify: whether a map is good, and what is wrong with it.
#include <cstdio>

#include "cli/cli.h"
#include "cli/findings.h"
#include "cli/input_options.h"
#include "cli/server_option.h"
#include "host/inspect.h"
#include "store/finding_limit.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

using text::WrappedOn;

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
  TellNotes("verify", report.notes);
  for (const map::Finding& finding : report.findings) std::fputs(WrappedOn(stdout, Describe(finding)).c_str(), stdout);
  if (report.findings.empty() && report.summary) {
    const std::string good = absl::StrCat(
        text::Shown(options.map), ": good. Revision ", report.summary->revision, ", ", report.summary->keyframes,
        " keyframes, ", report.summary->points, " points: structure, checksums and references",
        options.deep ? ", words and geometry" : " (--deep also checks words and geometry)");
    std::fputs(WrappedOn(stdout, good).c_str(), stdout);
    return;
  }
  const std::string file = options.server.empty() ? options.map : absl::StrCat("MAPS/", options.map, ".cairn");
  const std::string damaged =
      absl::StrCat(text::Shown(options.map), ": DAMAGED, ",
                   report.findings.size() < store::kMaxFindings ? "" : "at least ", report.findings.size(), " finding",
                   report.findings.size() == 1 ? "" : "s", ". Keep the file as it is, and get back what is good with",
                   options.server.empty() ? "" : ", where the server keeps it", ":");
  std::fputs(WrappedOn(stdout, damaged).c_str(), stdout);
  std::printf("  cairn recover %s NEW.cairn\n", text::Shown(file).c_str());
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
