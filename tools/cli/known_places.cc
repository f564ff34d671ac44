#include "cli/known_places.h"

#include <cmath>
#include <cstdio>
#include <memory>

#include "absl/strings/numbers.h"
#include "care/known_places.h"
#include "cli/cli.h"
#include "engine/live_map.h"
#include "io/text_lines.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

std::vector<std::string> WordsOf(absl::string_view text) {
  const std::vector<absl::string_view> fields = io::SplitFields(text);
  return {fields.begin(), fields.end()};
}

// X Y Z, and nothing else.
absl::StatusOr<Vector3d> VectorFrom(const std::vector<std::string>& words) {
  Vector3d vector;
  bool good = words.size() == 3;
  for (std::size_t i = 0; good && i < 3; ++i) {
    good = absl::SimpleAtod(words[i], &vector[static_cast<Eigen::Index>(i)]);
  }
  return good ? absl::StatusOr<Vector3d>(vector) : absl::InvalidArgumentError("three numbers X Y Z are needed");
}

absl::StatusOr<std::vector<care::KnownPosition>> ReadPositions(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const io::TextTable table, io::ReadTable(path));
  std::vector<care::KnownPosition> positions;
  for (const io::TextLine& line : table.lines) {
    std::vector<std::string> words = WordsOf(line.text);
    care::KnownPosition position;
    absl::StatusOr<care::Landmark> landmark = care::TakeLandmark(&words);
    if (!landmark.ok()) return io::LineError(path, line.number, landmark.status().message());
    const absl::StatusOr<Vector3d> world = VectorFrom(words);
    if (!world.ok()) return io::LineError(path, line.number, world.status().message());
    positions.push_back({*std::move(landmark), *world});
  }
  return positions;
}

absl::StatusOr<care::KnownDistance> DistanceFrom(const std::string& text) {
  std::vector<std::string> words = WordsOf(text);
  care::KnownDistance distance;
  const auto read = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(distance.from, care::TakeLandmark(&words));
    CAIRN_ASSIGN_OR_RETURN(distance.to, care::TakeLandmark(&words));
    if (words.size() == 1 && absl::SimpleAtod(words[0], &distance.metres)) return absl::OkStatus();
    return absl::InvalidArgumentError("behind the two places stands how many metres they are apart");
  };
  CAIRN_RETURN_IF_ERROR(Annotate(read(), absl::StrCat("--distance \"", text, "\"")));
  return distance;
}

absl::StatusOr<care::KnownPlaces> KnownFrom(const KnownPlacesOptions& options) {
  care::KnownPlaces known;
  known.overwrite = options.overwrite;
  known.force = options.force;
  if (!options.positions.empty()) {
    CAIRN_ASSIGN_OR_RETURN(known.positions, ReadPositions(options.positions));
  }
  for (const std::string& text : options.distances) {
    CAIRN_ASSIGN_OR_RETURN(known.distances.emplace_back(), DistanceFrom(text));
  }
  known.upright_cameras = options.gravity == "cameras";
  if (!options.gravity.empty() && !known.upright_cameras) {
    const absl::StatusOr<Vector3d> gravity = VectorFrom(WordsOf(options.gravity));
    if (!gravity.ok()) return Annotate(gravity.status(), "--gravity");
    known.gravity = *gravity;
  }
  return known;
}

absl::StatusOr<care::KnownAlignment> AlignMapFile(const std::string& map, const KnownPlacesOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const care::KnownPlaces known, KnownFrom(options));
  CAIRN_RETURN_IF_ERROR(known.Validate());
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live, engine::LiveMap::Open(map));
  CAIRN_ASSIGN_OR_RETURN(care::KnownAlignment aligned, care::AlignByKnownPlaces(map, known, *live));
  CAIRN_RETURN_IF_ERROR(live->Close());
  return aligned;
}

}  // namespace

int AlignByKnown(const std::string& map, const KnownPlacesOptions& options, bool json) {
  const absl::StatusOr<care::KnownAlignment> aligned = AlignMapFile(map, options);
  if (!aligned.ok()) return Fail("align", aligned.status(), json);
  const double rotation_deg = aligned->rotation_sigma_rad * 180.0 / M_PI;
  if (json) {
    PrintJson({{"map", map},
               {"revision", aligned->revision},
               {"component", aligned->component.value()},
               {"scale", aligned->world_from_component.scale()},
               {"rmse_m", aligned->rmse_m},
               {"errors_m", aligned->errors_m},
               {"scale_sigma_share", aligned->scale_sigma},
               {"rotation_sigma_deg", rotation_deg}});
    return kOk;
  }
  std::printf("%s, component %u, is aligned: scale %.4f +- %.2g %%, rotation +- %.2g deg\n", text::Shown(map).c_str(),
              aligned->component.value(), aligned->world_from_component.scale(), 100.0 * aligned->scale_sigma,
              rotation_deg);
  if (!aligned->errors_m.empty()) {
    std::printf("  what is known is off by %.4f m (RMSE of %zu)\n", aligned->rmse_m, aligned->errors_m.size());
  }
  return kOk;
}

}  // namespace cairn::cli
