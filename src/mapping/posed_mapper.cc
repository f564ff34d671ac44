#include "mapping/posed_mapper.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "base/angles.h"
#include "base/median.h"
#include "image/orb_extractor.h"
#include "mapping/grid_cache.h"
#include "mapping/local_adjustment.h"
#include "mapping/loop_options.h"
#include "mapping/new_points.h"
#include "mapping/point_fusion.h"
#include "tracking/relocalizer.h"

namespace cairn::mapping {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
// Uncertainty of the given poses as it shows in the images, on top of the features' own.
constexpr double kPoseSigmaPx = 0.5;
// While nothing is known of the scene, it is taken to lie between one and a hundred baselines away.
constexpr double kNearestBaselines = 1.0;
constexpr double kFarthestBaselines = 100.0;

// The one that given poses belong to: of those aligned to the world the one with most keyframes, or none.
ComponentId AlignedComponent(const map::Snapshot& map) {
  ComponentId best;
  for (const ComponentId id : map.LiveComponents()) {
    if (map.WorldFrom(id) && (!best || map.NumKeyframes(id) > map.NumKeyframes(best))) best = id;
  }
  return best;
}

}  // namespace

absl::Status PosedMapperOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("posed mapper: ", what)); };
  if (features_per_image < 100) return bad("features_per_image must be at least 100");
  if (pairs_per_image < 1) return bad("pairs_per_image must be at least 1");
  if (!(max_view_angle_deg > 0.0 && max_view_angle_deg < 180.0)) return bad("max_view_angle_deg must be in (0, 180)");
  if (!(max_baseline_share > 0.0)) return bad("max_baseline_share must be positive");
  if (!(max_epipolar_px > 0.0) || !(max_reprojection_px > 0.0)) return bad("pixel gates must be positive");
  if (!(min_parallax_deg > 0.0)) return bad("min_parallax_deg must be positive");
  if (!(position_sigma_share >= 0.0) || !(rotation_sigma_deg >= 0.0)) return bad("sigmas must not be negative");
  if ((position_sigma_share > 0.0) != (rotation_sigma_deg > 0.0)) {
    return bad("position_sigma_share and rotation_sigma_deg must both be positive, or both 0 for exact poses");
  }
  if (!(min_fit_share >= 0.0 && min_fit_share < 1.0)) return bad("min_fit_share must be in [0, 1)");
  if (adjustment_iterations < 1) return bad("adjustment_iterations must be at least 1");
  return absl::OkStatus();
}

class PosedMapper::Impl {
 public:
  Impl(const PosedMapperOptions& options, MapHead* head, SessionId session, CameraId camera)
      : options_(options),
        head_(head),
        map_(head->View()->snapshot()),
        session_(session),
        camera_(camera),
        pinhole_(map_->pinhole(camera)),
        vocabulary_(head->View()->places() == nullptr ? nullptr : &head->View()->places()->vocabulary()),
        extractor_(map_->info().orb) {
    component_ = AlignedComponent(*map_);
    if (component_) map_from_world_ = map_->WorldFrom(component_)->Inverse();
  }

  absl::StatusOr<int> Add(const PosedImage& image);
  absl::StatusOr<PosedMapperReport> Finish();

 private:
  struct View {
    map::Keyframe keyframe;
    place::BowVector words;
  };

  absl::Status CheckFit(PoseCheck* fit) const;
  absl::Status CheckAgainstMap(PosedMapperReport* report) const;
  void Insert(map::Edit& edit, std::size_t index);
  std::vector<KeyframeId> Partners(const map::Edit& edit, KeyframeId id, bool only_older) const;
  DepthRange RangeOf(const map::Edit& edit, KeyframeId id, std::span<const KeyframeId> partners) const;
  void Connect(map::Edit& edit, KeyframeId id, std::span<const KeyframeId> partners);
  absl::StatusOr<LocalAdjustmentReport> Adjust(map::Edit& edit) const;
  void DropUnconnected(map::Edit& edit, PosedMapperReport* report);
  absl::StatusOr<PosedMapperReport> CommitAll(map::Edit edit, PosedMapperReport report);

  const PosedMapperOptions options_;
  MapHead* const head_;
  std::shared_ptr<const map::Snapshot> map_;
  const SessionId session_;
  const CameraId camera_;
  const Pinhole pinhole_;
  const place::Vocabulary* const vocabulary_;  // of the view; null: none
  const image::OrbExtractor extractor_;
  ComponentId component_;  // that the views join; none: one is made
  Sim3 map_from_world_;
  GridCache grids_{512};
  std::vector<View> views_;
  std::vector<KeyframeId> ids_;  // per view, once in the edit
  std::unordered_map<KeyframeId, std::size_t> view_of_;
  double scene_depth_ = 0.0;  // median over the views so far; 0: unknown
  bool finished_ = false;
};

absl::StatusOr<int> PosedMapper::Impl::Add(const PosedImage& image) {
  if (finished_) return absl::FailedPreconditionError("posed mapper: the map is finished, nothing may be added");
  if (image.image.type() != CV_8UC1 || image.image.cols != pinhole_.width_px ||
      image.image.rows != pinhole_.height_px) {
    return absl::InvalidArgumentError(absl::StrCat("posed mapper: image ", image.index, " is ", image.image.cols, "x",
                                                   image.image.rows, ", the camera needs 8-bit grey of ",
                                                   pinhole_.width_px, "x", pinhole_.height_px));
  }
  if (!image.world_from_camera.Matrix().allFinite()) {
    return absl::InvalidArgumentError(absl::StrCat("posed mapper: the pose of image ", image.index, " is not finite"));
  }
  auto features = std::make_shared<map::KeyframeFeatures>();
  CAIRN_ASSIGN_OR_RETURN(features->features, extractor_.Extract(image.image, options_.features_per_image));
  View view;
  if (vocabulary_ != nullptr) {
    for (const image::Descriptor& descriptor : features->features.descriptors) {
      features->words.push_back(vocabulary_->Lookup(descriptor));
    }
    view.words = vocabulary_->Transform(features->features).words;
  }
  view.keyframe.session = session_;
  view.keyframe.camera = camera_;
  view.keyframe.time_ns = image.time_ns;
  view.keyframe.frame_index = image.index;
  view.keyframe.camera_from_map = map_from_world_.TransformPose(image.world_from_camera).Inverse();
  view.keyframe.camera_from_direct = view.keyframe.camera_from_map;
  view.keyframe.direct_segment = -1;
  view.keyframe.features = features;
  views_.push_back(std::move(view));
  return static_cast<int>(features->features.size());
}

// Views of this session that may see the same: near by pose, and alike by words.
std::vector<KeyframeId> PosedMapper::Impl::Partners(const map::Edit& edit, KeyframeId id, bool only_older) const {
  const map::Keyframe& keyframe = edit.keyframe(id);
  const Vector3d centre = keyframe.CenterInMap();
  const Vector3d axis = keyframe.camera_from_map.rotation().conjugate() * Vector3d::UnitZ();
  const double min_cosine = std::cos(options_.max_view_angle_deg * kRadPerDeg);
  const double unit = scene_depth_ > 0.0 ? scene_depth_ : 1.0;
  std::vector<std::pair<double, KeyframeId>> by_pose, by_words;
  for (const KeyframeId other_id : ids_) {
    if (other_id == id || (only_older && other_id > id)) continue;
    const map::Keyframe& other = edit.keyframe(other_id);
    const double cosine = axis.dot(other.camera_from_map.rotation().conjugate() * Vector3d::UnitZ());
    const double distance = (other.CenterInMap() - centre).norm();
    if (cosine < min_cosine || distance < 1e-6 * unit) continue;
    if (scene_depth_ > 0.0 && distance > options_.max_baseline_share * scene_depth_) continue;
    by_pose.emplace_back(distance / unit + std::acos(std::min(1.0, cosine)), other_id);
    if (vocabulary_ != nullptr) {
      by_words.emplace_back(-place::Score(views_[view_of_.at(id)].words, views_[view_of_.at(other_id)].words),
                            other_id);
    }
  }
  std::sort(by_pose.begin(), by_pose.end());
  std::sort(by_words.begin(), by_words.end());
  std::vector<KeyframeId> partners;
  const auto wanted = static_cast<std::size_t>(options_.pairs_per_image);
  const auto take = [&](const std::vector<std::pair<double, KeyframeId>>& ranked, std::size_t limit) {
    for (const auto& [score, other] : ranked) {
      if (partners.size() >= limit) return;
      if (std::find(partners.begin(), partners.end(), other) == partners.end()) partners.push_back(other);
    }
  };
  take(by_pose, by_words.empty() ? wanted : (3 * wanted + 3) / 4);
  take(by_words, wanted);
  return partners;
}

DepthRange PosedMapper::Impl::RangeOf(const map::Edit& edit, KeyframeId id,
                                      std::span<const KeyframeId> partners) const {
  const DepthRange own = DepthRangeOf(edit, id);
  if (own.valid()) return own;
  if (scene_depth_ > 0.0) return {0.1 / scene_depth_, 5.0 / scene_depth_, scene_depth_};
  if (partners.empty()) return {};
  const double baseline = (edit.keyframe(partners[0]).CenterInMap() - edit.keyframe(id).CenterInMap()).norm();
  return {1.0 / (kFarthestBaselines * baseline), 1.0 / (kNearestBaselines * baseline), 10.0 * baseline};
}

// Points that partners know are looked for, then new ones triangulated, then doubles joined.
void PosedMapper::Impl::Connect(map::Edit& edit, KeyframeId id, std::span<const KeyframeId> partners) {
  FusionOptions fusion;
  fusion.radius_px = options_.max_reprojection_px;
  fusion.extra_sigma_px = kPoseSigmaPx;
  fusion.max_chi_square = options_.max_reprojection_px * options_.max_reprojection_px;
  FuseAround(edit, id, partners, grids_, fusion);
  TriangulationOptions triangulation;
  triangulation.min_parallax_deg = options_.min_parallax_deg;
  triangulation.max_epipolar_chi_square = options_.max_epipolar_px * options_.max_epipolar_px;
  triangulation.max_chi_square = options_.max_reprojection_px * options_.max_reprojection_px;
  triangulation.extra_sigma_px = kPoseSigmaPx;
  TriangulateWith(edit, id, partners, {}, 1.0, RangeOf(edit, id, partners), triangulation);
  FuseAround(edit, id, partners, grids_, fusion);
}

void PosedMapper::Impl::Insert(map::Edit& edit, std::size_t index) {
  views_[index].keyframe.component = component_;
  const KeyframeId id = edit.AddKeyframe(views_[index].keyframe);
  view_of_[id] = index;
  ids_.push_back(id);
  Connect(edit, id, Partners(edit, id, true));
  std::vector<double> depths;
  for (const KeyframeId view : ids_) {
    const DepthRange range = DepthRangeOf(edit, view);
    if (range.valid()) depths.push_back(range.median_depth);
  }
  scene_depth_ = Median(depths);
}

absl::StatusOr<LocalAdjustmentReport> PosedMapper::Impl::Adjust(map::Edit& edit) const {
  LocalAdjustmentOptions adjustment;
  adjustment.first_iterations = options_.adjustment_iterations;
  adjustment.second_iterations = options_.adjustment_iterations;
  adjustment.max_fixed_keyframes = 0;
  adjustment.hold_poses = options_.position_sigma_share == 0.0;
  for (std::size_t i = 0; i < ids_.size() && !adjustment.hold_poses; ++i) {
    adjustment.priors.push_back({ids_[i], views_[i].keyframe.camera_from_map,
                                 options_.position_sigma_share * scene_depth_,
                                 options_.rotation_sigma_deg * kRadPerDeg});
  }
  return AdjustKeyframes(edit, ids_, adjustment);
}

// Pairs by order and by words, which do not depend on the poses.
absl::Status PosedMapper::Impl::CheckFit(PoseCheck* fit) const {
  constexpr std::size_t kMostPairs = 200;
  constexpr int kEnoughMatches = 50;
  std::vector<PosedFeatures> views;
  for (const View& view : views_) {
    views.push_back({&view.keyframe.features->features, view.keyframe.camera_from_map.Inverse()});
  }
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  const std::size_t stride = 2 * views.size() / kMostPairs + 1;
  for (std::size_t i = 0; i < views.size(); i += stride) {
    if (i + 1 < views.size()) pairs.emplace_back(i, i + 1);
    std::optional<std::pair<double, std::size_t>> alike;
    for (std::size_t j = 0; vocabulary_ != nullptr && j < views.size(); ++j) {
      if (j + 1 >= i && j <= i + 1) continue;
      const double score = place::Score(views_[i].words, views_[j].words);
      if (!alike || score > alike->first) alike = {score, j};
    }
    if (alike) pairs.emplace_back(i, alike->second);
  }
  *fit = CheckPoses(views, pairs, pinhole_);
  const bool inverses_fit = fit->inverted_share >= options_.min_fit_share && fit->inverted_share > fit->share + 0.2;
  if (options_.min_fit_share == 0.0 || fit->matches < kEnoughMatches) return absl::OkStatus();
  if (fit->share >= options_.min_fit_share && !inverses_fit) return absl::OkStatus();
  const int percent = static_cast<int>(100.0 * fit->share + 0.5);
  const int inverted = static_cast<int>(100.0 * fit->inverted_share + 0.5);
  std::string message =
      absl::StrCat("the given poses are not those of the images: they explain ", percent, " % of ", fit->matches,
                   " matches between ", fit->pairs, " pairs of images, where right ", "ones explain most");
  if (inverses_fit) {
    absl::StrAppend(&message, "; inverted they explain ", inverted,
                    " %: give world_from_camera, not camera_from_world");
  } else {
    absl::StrAppend(&message, "; nor inverted (", inverted,
                    " %). Check their order, their times, and that they are the camera's and not of a body");
  }
  return absl::FailedPreconditionError(message);
}

// Where the map has what the views see, it must be where their poses say: one place must not be there twice.
absl::Status PosedMapper::Impl::CheckAgainstMap(PosedMapperReport* report) const {
  constexpr std::size_t kMostViews = 60;
  constexpr int kMinContradictions = 3;
  const std::shared_ptr<const tracking::MapView> view = head_->View();
  if (view->places() == nullptr) return absl::OkStatus();
  const LoopOptions same;  // what counts as the same pose where a place is proven
  // The poses are known: what looks alike elsewhere is found out below.
  const tracking::Relocalizer relocalizer(tracking::RelocalizerOptions::WithoutRivals());
  std::vector<double> gaps;
  for (std::size_t i = 0; i < views_.size(); i += views_.size() / kMostViews + 1) {
    const map::Keyframe& keyframe = views_[i].keyframe;
    CAIRN_ASSIGN_OR_RETURN(const tracking::Relocalization found,
                           relocalizer.Relocalize(*map_, *view->places(), pinhole_, keyframe.features->features,
                                                  tracking::SearchArea::Only(component_)));
    if (!found.localized) continue;
    ++report->found_in_map;
    std::vector<double> depths;
    for (const tracking::PointObservation& inlier : found.place.inliers) {
      depths.push_back((found.place.camera_from_map * map_->point(inlier.point).position).z());
    }
    const SE3 difference = keyframe.camera_from_map * found.place.camera_from_map.Inverse();
    const double gap = difference.translation().norm();
    if (gap > same.max_neighbour_shift * Median(std::move(depths)) ||
        AngleRad(difference.rotation()) > same.max_neighbour_turn_deg * kRadPerDeg) {
      gaps.push_back(gap / map_from_world_.scale());
    }
  }
  const auto contradictions = static_cast<int>(gaps.size());
  if (contradictions < kMinContradictions || 2 * contradictions <= report->found_in_map) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrFormat(
      "the given poses contradict the map: of %d images that are found in it, %d are elsewhere, %.3g from their pose "
      "in the middle. Are the poses in the world that the map is aligned to?",
      report->found_in_map, contradictions, Median(std::move(gaps))));
}

void PosedMapper::Impl::DropUnconnected(map::Edit& edit, PosedMapperReport* report) {
  for (const KeyframeId id : ids_) {
    const auto& points = edit.keyframe(id).points;
    if (std::any_of(points.begin(), points.end(), [](PointId point) { return point.valid(); })) continue;
    if (edit.EraseKeyframe(id)) ++report->keyframes_without_points;
  }
}

absl::StatusOr<PosedMapperReport> PosedMapper::Impl::Finish() {
  if (finished_) return absl::FailedPreconditionError("posed mapper: the map is finished already");
  finished_ = true;
  map_ = head_->View()->snapshot();  // others may have changed it
  component_ = AlignedComponent(*map_);
  PosedMapperReport report;
  CAIRN_RETURN_IF_ERROR(CheckFit(&report.fit));
  if (component_) CAIRN_RETURN_IF_ERROR(CheckAgainstMap(&report));
  map::Edit edit(map_);
  if (!component_) {
    map::Component component;
    component.session = session_;
    component.world_from_component = Sim3();
    component_ = edit.AddComponent(component);
  }
  edit.SetSession(session_);
  map::Session session = edit.session(session_);
  session.components = {component_};
  edit.PutSession(session);
  for (std::size_t i = 0; i < views_.size(); ++i) Insert(edit, i);
  if (scene_depth_ == 0.0) {
    return absl::FailedPreconditionError(
        absl::StrCat("posed mapper: no two of the ", views_.size(), " views share points that can be triangulated"));
  }
  CAIRN_RETURN_IF_ERROR(Adjust(edit).status());
  // Once more with better poses, and with views that came later.
  for (const KeyframeId id : ids_) Connect(edit, id, Partners(edit, id, false));
  CAIRN_ASSIGN_OR_RETURN(const LocalAdjustmentReport adjusted, Adjust(edit));
  report.rmse_px = adjusted.rmse;
  DropUnconnected(edit, &report);
  return CommitAll(std::move(edit), report);
}

absl::StatusOr<PosedMapperReport> PosedMapper::Impl::CommitAll(map::Edit edit, PosedMapperReport report) {
  map::Delta delta = edit.Finish("map of images with known poses");
  report.keyframes = static_cast<int>(ids_.size()) - report.keyframes_without_points;
  report.points = static_cast<int>(delta.points.size());
  for (const auto& point : delta.points) report.observations += static_cast<int>(point->observations.size());
  CAIRN_RETURN_IF_ERROR(head_->Commit(std::move(delta), {}));
  map_ = head_->View()->snapshot();
  std::vector<double> changes;
  for (std::size_t i = 0; i < ids_.size(); ++i) {
    const map::Keyframe* keyframe = map_->keyframes().Find(ids_[i]);
    if (keyframe != nullptr) {
      changes.push_back((keyframe->CenterInMap() - views_[i].keyframe.CenterInMap()).norm() / map_from_world_.scale());
    }
  }
  report.median_pose_change = Median(std::move(changes));
  return report;
}

PosedMapper::PosedMapper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PosedMapper::~PosedMapper() = default;

absl::StatusOr<std::unique_ptr<PosedMapper>> PosedMapper::Create(const PosedMapperOptions& options, MapHead* head,
                                                                 SessionId session, CameraId camera) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const map::Snapshot& map = head->View()->map();
  if (!map.sessions().contains(session) || !map.cameras().contains(camera)) {
    return absl::InvalidArgumentError(
        absl::StrCat("posed mapper: the map has no session ", session.value(), " or no camera ", camera.value()));
  }
  if (!map.keyframes().empty() && !AlignedComponent(map)) {
    return absl::FailedPreconditionError(
        "posed mapper: the map is not aligned to the world of the poses; align it first (`cairn align`)");
  }
  return std::unique_ptr<PosedMapper>(new PosedMapper(std::make_unique<Impl>(options, head, session, camera)));
}

absl::StatusOr<int> PosedMapper::Add(const PosedImage& image) { return impl_->Add(image); }
absl::StatusOr<PosedMapperReport> PosedMapper::Finish() { return impl_->Finish(); }

}  // namespace cairn::mapping
