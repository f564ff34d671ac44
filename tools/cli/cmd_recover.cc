// cairn recover: what is good of a damaged map, as a map.
#include <cstdio>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/cli.h"
#include "cli/findings.h"
#include "health/recover_map.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

struct RecoverOptions {
  std::string bad;
  std::string good;
  bool json = false;
};

nlohmann::ordered_json AsJson(const store::RecoverReport& report, const RecoverOptions& options) {
  nlohmann::ordered_json json = {{"from", options.bad},
                                 {"map", options.good},
                                 {"revision", report.revision},
                                 {"keyframes", report.keyframes},
                                 {"points", report.points},
                                 {"keyframes_lost", nullptr},
                                 {"points_lost", nullptr},
                                 {"lost_keyframes", report.lost_keyframes},
                                 {"vocabulary", report.vocabulary},
                                 {"notes", report.notes},
                                 {"findings", FindingsAsJson(report.findings)}};
  if (report.keyframes_lost >= 0) json["keyframes_lost"] = report.keyframes_lost;
  if (report.points_lost >= 0) json["points_lost"] = report.points_lost;
  return json;
}

// " of 45", where that is known.
std::string OfAll(std::int64_t kept, std::int64_t lost) { return lost < 0 ? "" : absl::StrCat(" of ", kept + lost); }

void Print(const store::RecoverReport& report, const RecoverOptions& options) {
  text::Say(absl::StrFormat("%s: %lld%s keyframes and %lld%s points of %s\n", text::Shown(options.good),
                            static_cast<long long>(report.keyframes), OfAll(report.keyframes, report.keyframes_lost),
                            static_cast<long long>(report.points), OfAll(report.points, report.points_lost),
                            text::Shown(options.bad)));
  constexpr std::size_t kMaxListed = 20;
  if (!report.lost_keyframes.empty()) {
    const std::size_t listed = std::min(kMaxListed, report.lost_keyframes.size());
    const std::vector<std::int64_t> first(report.lost_keyframes.begin(),
                                          report.lost_keyframes.begin() + static_cast<std::ptrdiff_t>(listed));
    text::Say(absl::StrFormat("  lost keyframes of which something was left: %s%s\n", absl::StrJoin(first, ", "),
                              listed < report.lost_keyframes.size() ? ", ..." : ""));
  }
  for (const std::string& note : report.notes) text::Say(absl::StrFormat("  %s\n", text::Shown(note)));
}

}  // namespace

void AddRecoverCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("recover", "Save what is good of a damaged map as a new map");
  auto options = std::make_shared<RecoverOptions>();
  verb->add_option("BAD", options->bad, "The damaged map file; it is only read, with the log beside it")->required();
  verb->add_option("GOOD", options->good, "The new map file")->required();
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer(
      "Every keyframe and point whose own bytes are as they were written is kept, wherever it lies in the file.\n"
      "Exit code 0: the new map is good ('cairn verify'); what was lost is said. 3: nothing could be saved. 1: also of "
      "a map without keyframes, of which there is nothing to save.\n"
      "Examples:\n"
      "  cairn verify office.cairn\n"
      "  cairn recover office.cairn office_recovered.cairn");
  verb->callback([=] {
    *action = [=] {
      const auto report = health::RecoverMap(options->bad, options->good);
      if (!report.ok()) return Fail("recover", report.status(), options->json);
      if (options->json) {
        PrintJson(AsJson(*report, *options));
      } else {
        Print(*report, *options);
      }
      return static_cast<int>(kOk);
    };
  });
}

}  // namespace cairn::cli
