#include "client/remote/feature_sender.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "client/query_image.h"

namespace cairn::client {

absl::StatusOr<FeatureSender::Asked> FeatureSender::AskedBy(const std::string& map, const Describe& describe) {
  {
    const std::lock_guard lock(mutex_);
    const auto known = asked_.find(map);
    if (known != asked_.end()) return known->second;
  }
  CAIRN_ASSIGN_OR_RETURN(const api::MapDescription description, describe());
  Asked asked;
  asked.orb = description.orb;
  for (const api::CameraInfo& camera : description.cameras) {
    CAIRN_ASSIGN_OR_RETURN(const auto undistorter, undistorters_.For(camera.camera));
    asked.finest_px = std::max(asked.finest_px, undistorter->pinhole().fx_px);
  }
  const std::lock_guard lock(mutex_);
  return asked_[map] = asked;
}

absl::StatusOr<api::LocalizeAnswer> FeatureSender::Localize(const std::string& map, const api::LocalizeQuery& query,
                                                            const Describe& describe, const Send& send) {
  CAIRN_RETURN_IF_ERROR(Annotate(query.camera.Validate(), "localize"));
  CAIRN_RETURN_IF_ERROR(CheckImage(query.image, query.camera, "localize"));
  for (bool again = false;; again = true) {
    CAIRN_ASSIGN_OR_RETURN(const Asked asked, AskedBy(map, describe));
    absl::StatusOr<api::LocalizeAnswer> answer = SendFeatures(asked, query, send);
    if (again || !absl::IsFailedPrecondition(answer.status())) return answer;
    const std::lock_guard lock(mutex_);  // another map has this name by now
    asked_.erase(map);
  }
}

absl::StatusOr<api::LocalizeAnswer> FeatureSender::SendFeatures(const Asked& asked, const api::LocalizeQuery& query,
                                                                const Send& send) {
  using Clock = std::chrono::steady_clock;
  auto start = Clock::now();
  CAIRN_ASSIGN_OR_RETURN(const auto undistorter, undistorters_.For(query.camera));
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat image, undistorter->Undistort(query.image));
  api::LocalizeQuery sent{cv::Mat(), query.camera, query.time_ns, query.prior};
  absl::StatusOr<api::LocalizeAnswer> answer;
  double extract_ms = 0.0;
  for (const double scale : ScalesFor(asked.finest_px, undistorter->pinhole())) {
    CAIRN_ASSIGN_OR_RETURN(sent.features, ExtractAt(asked.orb, undistorter->pinhole(), image, scale, 0));
    extract_ms += std::chrono::duration<double, std::milli>(Clock::now() - start).count();
    answer = send(sent);
    if (!answer.ok()) return answer;
    answer->extract_ms += extract_ms;
    if (answer->localized || !answer->rivals.empty()) break;
    start = Clock::now();
  }
  return answer;
}

}  // namespace cairn::client
