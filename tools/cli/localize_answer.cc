#include "cli/localize_answer.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <utility>

#include "absl/strings/str_format.h"
#include "cli/component_report.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// Of the camera's centre in the world frame. The covariance is of a left increment, which turns about the origin.
double PositionSigma(const api::LocatedPose& answer) {
  Eigen::Matrix<double, 3, 6> by_increment;
  by_increment << Matrix3d::Identity(), -Hat(answer.map_from_camera.translation());
  return answer.world_per_map * std::sqrt((by_increment * answer.covariance * by_increment.transpose()).trace());
}

double RotationSigmaDeg(const api::LocatedPose& answer) {
  return std::sqrt(answer.covariance.bottomRightCorner<3, 3>().trace()) * 180.0 / std::numbers::pi;
}

bool InWorld(const api::LocatedPose& answer) { return answer.world_is_metric; }

void AddPose(const api::LocatedPose& answer, nlohmann::ordered_json* json) {
  const SE3& pose = InWorld(answer) ? answer.world_from_camera : answer.map_from_camera;
  const Vector3d& t = pose.translation();
  const Quaterniond& q = pose.rotation();
  AddFrameAndUnit(InWorld(answer), json);
  (*json)["position"] = {t.x(), t.y(), t.z()};
  (*json)["quaternion_xyzw"] = {q.x(), q.y(), q.z(), q.w()};
  (*json)["position_sigma"] = PositionSigma(answer) / (InWorld(answer) ? 1.0 : answer.world_per_map);
  (*json)["rotation_sigma_deg"] = RotationSigmaDeg(answer);
  if (answer.focal_factor != 1.0) (*json)["focal_factor"] = answer.focal_factor;
  (*json)["reference_keyframe"] = answer.reference_keyframe.value();
  (*json)["component"] = answer.component.value();
}

// A focal length that is right leaves the principal point.
std::string WhatFits(double focal_factor) {
  const std::string focal = absl::StrFormat("focal length x %.3f", focal_factor);
  constexpr double kNearlyRight = 0.03;
  return std::abs(focal_factor - 1.0) < kNearlyRight ? absl::StrCat(focal, ", principal point elsewhere") : focal;
}

void PrintRivals(const api::LocalizeAnswer& answer) {
  for (const api::LocatedPose& rival : answer.rivals) {
    const Vector3d& t = (InWorld(rival) ? rival.world_from_camera : rival.map_from_camera).translation();
    std::printf("  perhaps at %.4f %.4f %.4f %s, %d inliers, keyframe %u of component %u\n", t.x(), t.y(), t.z(),
                InWorld(rival) ? "m" : "(map units)", rival.inliers, rival.reference_keyframe.value(),
                rival.component.value());
  }
  if (!answer.rivals.empty()) std::printf("  --prior tells them apart\n");
}

}  // namespace

nlohmann::ordered_json AnswerToJson(const api::LocalizeAnswer& answer, const std::string& path, TimeNs time_ns) {
  nlohmann::ordered_json json = {{"image", path}, {"time_s", ToSeconds(time_ns)}, {"localized", answer.localized}};
  if (answer.localized) {
    AddPose(answer, &json);
    json["components"] = answer.components;
  } else {
    json["failed_stage"] = api::LocalizeStageName(answer.stage);
    json["reason"] = answer.reason;
    if (answer.focal_factor != 1.0) json["focal_factor"] = answer.focal_factor;
  }
  if (!answer.rivals.empty()) {
    json["ambiguous"] = nlohmann::ordered_json::array();
    for (const api::LocatedPose& rival : answer.rivals) {
      nlohmann::ordered_json pose = {{"inliers", rival.inliers}};
      AddPose(rival, &pose);
      json["ambiguous"].push_back(std::move(pose));
    }
  }
  const api::LocalizeCounts& c = answer.counts;
  json["counts"] = {
      {"features", c.features},       {"candidates", c.candidates},         {"word_matches", c.word_matches},
      {"pnp_inliers", c.pnp_inliers}, {"guided_matches", c.guided_matches}, {"inliers", c.inliers}};
  json["lens"] = api::LensUseName(answer.lens);
  json["map"] = answer.map_id;
  json["revision"] = answer.revision;
  json["ms"] = answer.extract_ms + answer.locate_ms;
  return json;
}

void PrintLocalizeAnswer(const api::LocalizeAnswer& answer, const std::string& path, const std::string& head) {
  const std::string name = std::filesystem::path(path).filename().string();
  if (answer.localized) {
    const Vector3d& t = (InWorld(answer) ? answer.world_from_camera : answer.map_from_camera).translation();
    std::string told = absl::StrFormat("%s%s: at %.4f %.4f %.4f %s, %d inliers, %.0f ms", head, text::Shown(name),
                                       t.x(), t.y(), t.z(), InWorld(answer) ? "m" : "(map units)",
                                       answer.counts.inliers, answer.extract_ms + answer.locate_ms);
    if (answer.components > 1) absl::StrAppend(&told, ", in component ", answer.component.value());
    if (answer.focal_factor != 1.0) {
      absl::StrAppend(&told, ", but the calibration does not fit: ", WhatFits(answer.focal_factor));
    }
    std::fputs(text::WrappedOn(stdout, told).c_str(), stdout);
  } else {
    const std::string told = absl::StrCat(head, text::Shown(name), ": not located at stage \"",
                                          api::LocalizeStageName(answer.stage), "\": ", text::Shown(answer.reason));
    std::fputs(text::WrappedOn(stdout, told).c_str(), stdout);
    PrintRivals(answer);
  }
}

}  // namespace cairn::cli
