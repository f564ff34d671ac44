#include "cli/known_places.h"

#include <cmath>
#include <cstdio>
#include <memory>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "cli/cli.h"
#include "io/text_lines.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

std::vector<std::string> WordsOf(absl::string_view text) {
  const std::vector<absl::string_view> fields = io::SplitFields(text);
  return {fields.begin(), fields.end()};
}

// X Y Z, and nothing else: finite numbers.
absl::StatusOr<Vector3d> VectorFrom(const std::vector<std::string>& words) {
  Vector3d vector;
  bool good = words.size() == 3;
  for (std::size_t i = 0; good && i < 3; ++i) {
    good = absl::SimpleAtod(words[i], &vector[static_cast<Eigen::Index>(i)]);
  }
  if (good && vector.allFinite()) return vector;
  return absl::InvalidArgumentError(
      absl::StrCat("three numbers X Y Z are needed, not \"", absl::StrJoin(words, " "), "\"",
                   words.size() > 3 ? " (a comma separates columns, the decimal sign is a point)" : ""));
}

// Takes its words from the front.
absl::StatusOr<api::Landmark> TakeLandmark(std::vector<std::string>* words) {
  const absl::Status wanted = absl::InvalidArgumentError(
      "a place is \"point ID\", \"keyframe ID\" or \"pixel KEYFRAME X Y\" (undistorted image)");
  std::uint32_t id = 0;
  if (words->size() < 2 || !absl::SimpleAtoi((*words)[1], &id) || id == 0) return wanted;
  const std::string kind = (*words)[0];
  std::size_t used = 2;
  api::Landmark landmark = PointId(id);
  if (kind == "keyframe") {
    landmark = KeyframeId(id);
  } else if (kind == "pixel") {
    api::SeenAt seen{KeyframeId(id), {}};
    used = 4;
    if (words->size() < used || !absl::SimpleAtod((*words)[2], &seen.pixel.x()) ||
        !absl::SimpleAtod((*words)[3], &seen.pixel.y())) {
      return wanted;
    }
    landmark = seen;
  } else if (kind != "point") {
    return wanted;
  }
  words->erase(words->begin(), words->begin() + static_cast<std::ptrdiff_t>(used));
  return landmark;
}

absl::StatusOr<std::vector<api::KnownPosition>> ReadPositions(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const io::TextTable table, io::ReadTable(path));
  std::vector<api::KnownPosition> positions;
  for (const io::TextLine& line : table.lines) {
    std::vector<std::string> words = WordsOf(line.text);
    api::KnownPosition position;
    absl::StatusOr<api::Landmark> landmark = TakeLandmark(&words);
    if (!landmark.ok()) return io::LineError(path, line.number, landmark.status().message());
    const absl::StatusOr<Vector3d> world = VectorFrom(words);
    if (!world.ok()) return io::LineError(path, line.number, world.status().message());
    positions.push_back({*std::move(landmark), *world});
  }
  return positions;
}

bool SamePlace(const api::Landmark& a, const api::Landmark& b) {
  const auto *seen_a = std::get_if<api::SeenAt>(&a), *seen_b = std::get_if<api::SeenAt>(&b);
  if (seen_a != nullptr && seen_b != nullptr) {
    return seen_a->keyframe == seen_b->keyframe && seen_a->pixel == seen_b->pixel;
  }
  const auto *point_a = std::get_if<PointId>(&a), *point_b = std::get_if<PointId>(&b);
  if (point_a != nullptr && point_b != nullptr) return *point_a == *point_b;
  const auto *keyframe_a = std::get_if<KeyframeId>(&a), *keyframe_b = std::get_if<KeyframeId>(&b);
  return keyframe_a != nullptr && keyframe_b != nullptr && *keyframe_a == *keyframe_b;
}

absl::StatusOr<api::KnownDistance> DistanceFrom(const std::string& text) {
  std::vector<std::string> words = WordsOf(text);
  api::KnownDistance distance;
  const auto read = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(distance.from, TakeLandmark(&words));
    CAIRN_ASSIGN_OR_RETURN(distance.to, TakeLandmark(&words));
    if (SamePlace(distance.from, distance.to)) {
      return absl::InvalidArgumentError("a known distance is between two places, not of one to itself");
    }
    if (words.size() != 1 || !absl::SimpleAtod(words[0], &distance.metres)) {
      return absl::InvalidArgumentError("behind the two places stands how many metres they are apart");
    }
    api::KnownPlaces alone;
    alone.distances = {distance};
    return alone.Validate();
  };
  const absl::Status status = read();
  if (status.ok()) return distance;
  return UsageError(absl::StrCat("--distance \"", text, "\": ", absl::StripPrefix(status.message(), "align: ")));
}

// 0: what was measured leaves nothing over that would tell.
nlohmann::ordered_json SigmaAsJson(double sigma) { return sigma > 0.0 ? nlohmann::ordered_json(sigma) : nullptr; }
std::string SigmaText(double sigma, const char* unit) {
  return sigma > 0.0 ? absl::StrFormat("+- %.2g %s", sigma, unit) : "(nothing tells how sure)";
}

}  // namespace

absl::StatusOr<api::KnownPlaces> ReadKnownPlaces(const KnownPlacesOptions& options) {
  api::KnownPlaces known;
  if (!options.positions.empty()) {
    CAIRN_ASSIGN_OR_RETURN(known.positions, ReadPositions(options.positions));
  }
  for (const std::string& text : options.distances) {
    CAIRN_ASSIGN_OR_RETURN(known.distances.emplace_back(), DistanceFrom(text));
  }
  known.upright_cameras = options.gravity == "cameras";
  if (!options.gravity.empty() && !known.upright_cameras) {
    const absl::StatusOr<Vector3d> gravity = VectorFrom(WordsOf(options.gravity));
    if (!gravity.ok()) return UsageError(absl::StrCat("--gravity: ", gravity.status().message()));
    if (!(gravity->norm() > 1e-9)) {
      return UsageError(absl::StrCat("--gravity \"", options.gravity, "\" has no direction"));
    }
    known.gravity = *gravity;
  }
  return known;
}

void PrintKnownAlignment(const std::string& map, const api::AlignAnswer& answer, bool json) {
  const api::ComponentAlignment& aligned = *answer.component;
  const double rotation_deg = aligned.rotation_sigma_rad * 180.0 / M_PI;
  if (json) {
    PrintJson({{"map", map},
               {"revision", answer.revision},
               {"component", aligned.component.value()},
               {"scale", aligned.world_from_component.scale()},
               {"rmse_m", aligned.rmse_all_m},
               {"errors_m", aligned.errors_m},
               {"scale_sigma_share", SigmaAsJson(aligned.scale_sigma)},
               {"rotation_sigma_deg", SigmaAsJson(rotation_deg)}});
    return;
  }
  text::Say(absl::StrFormat("%s, component %u, is aligned: scale %.4f %s, rotation %s\n", text::Shown(map),
                            aligned.component.value(), aligned.world_from_component.scale(),
                            SigmaText(100.0 * aligned.scale_sigma, "%"), SigmaText(rotation_deg, "deg")));
  if (aligned.errors_m.empty()) return;
  text::Say(
      absl::StrFormat("  what is known is off by %.4f m (RMSE of %zu)\n", aligned.rmse_all_m, aligned.errors_m.size()));
}

}  // namespace cairn::cli
