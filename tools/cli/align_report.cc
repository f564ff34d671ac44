#include "cli/align_report.h"

#include <algorithm>
#include <cstdio>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/geo_options.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

constexpr double kDegPerRad = 57.29577951308232;

using api::ComponentAlignment;

long long L(std::int64_t value) { return static_cast<long long>(value); }

std::string OrientationNote(const ComponentAlignment& found, bool positions_only) {
  if (positions_only) return "positions alone, as asked for";
  if (found.orientations.kind == OrientationKind::kCamera) return "";
  if (!found.orientations_used) {
    return absl::StrCat(eval::Describe(found.orientations), ": aligned by positions alone");
  }
  return absl::StrFormat("%s; the camera sits %.3f +- %.3f m from its centre", eval::Describe(found.orientations),
                         found.camera_in_body_m, found.camera_in_body_sigma_m);
}

void AddReference(const ComponentAlignment& found, const eval::Reference& reference, nlohmann::ordered_json* json) {
  nlohmann::ordered_json& out = *json;
  out["noise_rotation_deg"] = nullptr;
  out["orientations"] = eval::NameOf(found.orientations.kind);
  out["body_turned_deg"] = out["body_distance_m"] = out["sensor"] = nullptr;
  if (found.orientations_used) out["noise_rotation_deg"] = found.noise_rotation_rad * kDegPerRad;
  if (found.orientations_used && found.orientations.kind == OrientationKind::kBody) {
    out["body_turned_deg"] = AngleRad(found.orientations.camera_from_body) * kDegPerRad;
    out["body_distance_m"] = found.camera_in_body_m;
  }
  if (reference.body_from_camera) out["sensor"] = reference.sensor;
}

void AddComponent(const ComponentAlignment& found, const eval::Reference* reference, nlohmann::ordered_json* json) {
  nlohmann::ordered_json others = nlohmann::ordered_json::array();
  for (const ComponentAlignment::Other& other : found.others) {
    others.push_back({{"component", other.component.value()},
                      {"keyframes", other.keyframes},
                      {"with_reference", other.with_reference},
                      {"aligned", other.aligned}});
  }
  nlohmann::ordered_json& out = *json;
  out["component"] = found.component.value();
  out["components"] = found.others.size() + 1;
  out["keyframes"] = found.keyframes;
  out["keyframes_used"] = found.with_reference;
  out["inliers"] = found.fitting;
  out["misfits_s"] = found.misfits_s;
  out["rmse_m"] = found.rmse_fitting_m;
  out["rmse_all_m"] = found.rmse_all_m;
  out["scale"] = found.world_from_component.scale();
  out["scale_sigma"] = found.scale_sigma;
  out["rotation_sigma_deg"] = found.rotation_sigma_rad * kDegPerRad;
  out["position_sigma_m"] = found.position_sigma_m;
  out["noise_position_m"] = found.noise_position_m;
  if (reference != nullptr) AddReference(found, *reference, json);
  out["moved_m"] = found.moved_m ? nlohmann::ordered_json(*found.moved_m) : nlohmann::ordered_json(nullptr);
  out["other_components"] = others;
}

void PrintComponent(const AlignReport& report, const ComponentAlignment& found) {
  text::Say(
      absl::StrFormat("%s, component %u, is aligned: scale %.4f +- %.4f, rotation +- %.2f deg, position +- %.4f m\n",
                      text::Shown(report.map), found.component.value(), found.world_from_component.scale(),
                      found.scale_sigma, found.rotation_sigma_rad * kDegPerRad, found.position_sigma_m));
  text::Say(absl::StrFormat("  %lld of its %lld keyframes with a reference %s fit: %.4f m RMSE (all %lld: %.4f m)\n",
                            L(found.fitting), L(found.with_reference),
                            report.reference != nullptr ? "pose" : "position", found.rmse_fitting_m,
                            L(found.with_reference), found.rmse_all_m));
  if (!found.misfits_s.empty()) {
    constexpr std::size_t kFirst = 5;
    std::vector<std::string> first;
    for (std::size_t i = 0; i < std::min(found.misfits_s.size(), kFirst); ++i) {
      first.push_back(absl::StrFormat("%.3f", found.misfits_s[i]));
    }
    text::Say(absl::StrFormat("  %zu do not fit, at %s s%s\n", found.misfits_s.size(), absl::StrJoin(first, ", "),
                              found.misfits_s.size() > kFirst ? ", ..." : ""));
  }
  if (report.reference != nullptr) {
    for (const std::string& note : {eval::Describe(*report.reference), OrientationNote(found, report.positions_only)}) {
      if (!note.empty()) text::Say(absl::StrFormat("  %s\n", text::Shown(note)));
    }
  }
  if (found.moved_m) {
    text::Say(
        absl::StrFormat("  its keyframes moved by %.4f m (median) from the alignment that it had\n", *found.moved_m));
  }
  for (const ComponentAlignment::Other& other : found.others) {
    text::Say(absl::StrFormat("  component %u, %lld keyframes, %lld with a reference pose, remains %s\n",
                              other.component.value(), L(other.keyframes), L(other.with_reference),
                              other.aligned ? "aligned as it was" : "without alignment"));
  }
}

}  // namespace

nlohmann::ordered_json AnchorAsJson(const std::optional<map::GeoAnchor>& anchor) {
  if (!anchor) return nullptr;
  const Quaterniond& q = anchor->enu_from_world;
  return {{"latitude_deg", anchor->latitude_deg},
          {"longitude_deg", anchor->longitude_deg},
          {"height_m", anchor->height_m},
          {"enu_from_world_xyzw", {q.x(), q.y(), q.z(), q.w()}}};
}

nlohmann::ordered_json AlignReportAsJson(const AlignReport& report) {
  nlohmann::ordered_json json = {
      {"frame", "world"}, {"unit", "m"}, {"map", report.map}, {"revision", report.answer.revision}};
  if (report.answer.component) AddComponent(*report.answer.component, report.reference, &json);
  json["geo_anchor"] = AnchorAsJson(report.answer.geo_anchor);
  return json;
}

void PrintAlignReport(const AlignReport& report) {
  if (report.answer.component) PrintComponent(report, *report.answer.component);
  if (report.answer.geo_anchor_changed) {
    const std::string where = report.answer.geo_anchor ? "its origin is at " + DescribeAnchor(*report.answer.geo_anchor)
                                                       : std::string("its place on the earth is not known any more");
    text::Say(absl::StrFormat("%s: %s\n", text::Shown(report.map), where));
  }
}

}  // namespace cairn::cli
