#include <array>
#include <utility>

#include "wire/convert.h"
#include "wire/errors.h"
#include "wire/reading.h"
#include "wire/text.h"

namespace cairn::wire {
namespace {

using Answer = v1::LocalizeImageResponse;

constexpr std::array<std::pair<api::LocalizeStage, Answer::Stage>, 7> kStages = {{
    {api::LocalizeStage::kFeatures, Answer::STAGE_FEATURES},
    {api::LocalizeStage::kCandidates, Answer::STAGE_CANDIDATES},
    {api::LocalizeStage::kMatches, Answer::STAGE_MATCHES},
    {api::LocalizeStage::kPnp, Answer::STAGE_PNP},
    {api::LocalizeStage::kRefinement, Answer::STAGE_REFINEMENT},
    {api::LocalizeStage::kRivals, Answer::STAGE_RIVALS},
    {api::LocalizeStage::kDone, Answer::STAGE_DONE},
}};
constexpr std::array<std::pair<api::LensUse, Answer::LensUse>, 3> kLensUses = {{
    {api::LensUse::kNone, Answer::LENS_USE_NONE},
    {api::LensUse::kCorrected, Answer::LENS_USE_CORRECTED},
    {api::LensUse::kOtherCalibration, Answer::LENS_USE_OTHER_CALIBRATION},
}};

// The second of the pair with this first, and the other way round; the first pair's if there is none.
template <class Pairs, class Value>
auto ValueOf(const Pairs& pairs, Value first) {
  for (const auto& [a, b] : pairs) {
    if (a == first) return b;
  }
  return pairs[0].second;
}
template <class Pairs, class Value>
auto KeyOf(const Pairs& pairs, Value second) {
  for (const auto& [a, b] : pairs) {
    if (b == second) return a;
  }
  return pairs[0].first;
}

// A LocatedPose, or the answer, which has the same fields.
template <class Message>
void WritePose(const api::LocatedPose& pose, Message* out) {
  ToProto(pose.map_from_camera, out->mutable_map_from_camera());
  out->set_component(pose.component.value());
  ToProto(pose.world_from_camera, out->mutable_world_from_camera());
  out->set_world_per_map(pose.world_per_map);
  out->set_world_is_metric(pose.world_is_metric);
  Write(pose.covariance, out->mutable_covariance());
  out->set_reference_keyframe(pose.reference_keyframe.value());
  out->set_focal_factor(pose.focal_factor);
}

template <class Message>
absl::Status ReadPose(const Message& message, api::LocatedPose* pose) {
  CAIRN_ASSIGN_OR_RETURN(pose->map_from_camera, FromProto(message.map_from_camera()));
  pose->component = ComponentId(message.component());
  CAIRN_ASSIGN_OR_RETURN(pose->world_from_camera, FromProto(message.world_from_camera()));
  pose->world_per_map = message.world_per_map();
  pose->world_is_metric = message.world_is_metric();
  CAIRN_ASSIGN_OR_RETURN(pose->covariance, ReadMatrix(message.covariance()));
  pose->reference_keyframe = KeyframeId(message.reference_keyframe());
  pose->focal_factor = message.focal_factor();
  return absl::OkStatus();
}

}  // namespace

void ToProto(const api::PosePrior& prior, v1::PosePrior* out) {
  ToProto(prior.map_from_camera, out->mutable_map_from_camera());
  out->set_component(prior.component.value());
  out->set_position_sigma(prior.position_sigma);
  out->set_rotation_sigma_rad(prior.rotation_sigma_rad);
}

absl::StatusOr<api::PosePrior> FromProto(const v1::PosePrior& message) {
  api::PosePrior prior;
  CAIRN_ASSIGN_OR_RETURN(prior.map_from_camera, FromProto(message.map_from_camera()));
  prior.component = ComponentId(message.component());
  prior.position_sigma = message.position_sigma();
  prior.rotation_sigma_rad = message.rotation_sigma_rad();
  return prior;
}

void ToProto(const api::LocalizeAnswer& answer, Answer* out) {
  out->set_localized(answer.localized);
  out->set_stage(ValueOf(kStages, answer.stage));
  out->set_reason(answer.reason);
  Answer::Counts* counts = out->mutable_counts();
  counts->set_features(answer.counts.features);
  counts->set_candidates(answer.counts.candidates);
  counts->set_word_matches(answer.counts.word_matches);
  counts->set_pnp_inliers(answer.counts.pnp_inliers);
  counts->set_guided_matches(answer.counts.guided_matches);
  counts->set_inliers(answer.counts.inliers);
  out->set_map_id(answer.map_id);
  out->set_revision(answer.revision);
  out->set_components(answer.components);
  out->set_lens(ValueOf(kLensUses, answer.lens));
  out->set_extract_ms(answer.extract_ms);
  out->set_locate_ms(answer.locate_ms);
  for (const api::LocatedPose& rival : answer.rivals) {
    v1::LocatedPose* pose = out->add_rivals();
    WritePose(rival, pose);
    pose->set_inliers(rival.inliers);
  }
  if (answer.localized) {
    WritePose(answer, out);
  } else {
    out->set_focal_factor(answer.focal_factor);
  }
}

absl::StatusOr<api::LocalizeAnswer> FromProto(const Answer& message) {
  api::LocalizeAnswer answer;
  answer.localized = message.localized();
  answer.stage = KeyOf(kStages, message.stage());
  answer.reason = message.reason();
  const Answer::Counts& counts = message.counts();
  answer.counts = {counts.features(),    counts.candidates(),     counts.word_matches(),
                   counts.pnp_inliers(), counts.guided_matches(), counts.inliers()};
  answer.map_id = message.map_id();
  answer.revision = message.revision();
  answer.components = message.components();
  answer.lens = KeyOf(kLensUses, message.lens());
  answer.extract_ms = message.extract_ms();
  answer.locate_ms = message.locate_ms();
  for (const v1::LocatedPose& rival : message.rivals()) {
    CAIRN_RETURN_IF_ERROR(ReadPose(rival, &answer.rivals.emplace_back()));
    answer.rivals.back().inliers = rival.inliers();
  }
  if (!answer.localized) {
    if (message.focal_factor() > 0.0) answer.focal_factor = message.focal_factor();
    return answer;
  }
  CAIRN_RETURN_IF_ERROR(ReadPose(message, &answer));
  answer.inliers = answer.counts.inliers;
  return answer;
}

void ToProto(const api::AcrossAnswer& across, v1::LocalizeInMapsResponse* out) {
  out->set_map(across.map);
  out->set_ambiguous(across.ambiguous);
  for (const std::string& rival : across.rivals) out->add_rivals(rival);
  for (const api::AnswerOfMap& of_map : across.answers) {
    v1::LocalizeInMapsResponse::Answer* answer = out->add_answers();
    answer->set_map(of_map.map);
    if (of_map.status.ok()) {
      ToProto(of_map.answer, answer->mutable_answer());
    } else {
      answer->set_error_reason(std::string(KindOf(of_map.status).reason));
      answer->set_error_message(Utf8(of_map.status.message()));
    }
  }
}

absl::StatusOr<api::AcrossAnswer> FromProto(const v1::LocalizeInMapsResponse& message) {
  api::AcrossAnswer across;
  for (const v1::LocalizeInMapsResponse::Answer& answer : message.answers()) {
    api::AnswerOfMap& of_map = across.answers.emplace_back();
    of_map.map = answer.map();
    of_map.status = StatusOfReason(answer.error_reason(), answer.error_message());
    if (!of_map.status.ok()) continue;
    CAIRN_ASSIGN_OR_RETURN(of_map.answer, FromProto(answer.answer()));
  }
  across.ambiguous = message.ambiguous();
  across.rivals.assign(message.rivals().begin(), message.rivals().end());
  across.map = message.map();
  const bool consistent = across.map.empty() || (!across.answers.empty() && across.answers[0].map == across.map &&
                                                 across.answers[0].answer.localized);
  if (!consistent) return absl::InvalidArgumentError("answer: the map in which it was located is not the first");
  return across;
}

}  // namespace cairn::wire
