
#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"
#include "engine/alignment_target.h"
#include "geometry/alignment.h"
#include "map/edit.h"

namespace cairn::engine {
namespace {

using api::KnownDistance;
using api::KnownPlaces;
using api::KnownPosition;
using api::Landmark;
using api::SeenAt;

constexpr double kMaxPixelGap = 8.0;  // of a feature from where somebody pointed
constexpr double kMaxKnownScaleSigma = 0.1, kMaxKnownRotationSigmaRad = 5.0 * M_PI / 180.0;

struct Place {
  ComponentId component;
  Vector3d at = Vector3d::Zero();  // frame of the component
};

class Finder {
 public:
  Finder(const std::string& name, const map::Snapshot& map) : name_(name), map_(map) {}

  absl::StatusOr<Place> operator()(PointId id) const {
    const map::MapPoint* point = map_.points().Find(id);
    if (point == nullptr) return Missing("point", id.value());
    return Place{map_.keyframe(point->reference.keyframe).component, point->position};
  }
  absl::StatusOr<Place> operator()(KeyframeId id) const {
    const map::Keyframe* keyframe = map_.keyframes().Find(id);
    if (keyframe == nullptr) return Missing("keyframe", id.value());
    return Place{keyframe->component, keyframe->CenterInMap()};
  }
  absl::StatusOr<Place> operator()(const SeenAt& seen) const {
    const map::Keyframe* keyframe = map_.keyframes().Find(seen.keyframe);
    if (keyframe == nullptr) return Missing("keyframe", seen.keyframe.value());
    double nearest = std::numeric_limits<double>::infinity();
    PointId found;
    for (std::size_t i = 0; i < keyframe->points.size(); ++i) {
      const image::Keypoint& keypoint = keyframe->keypoints()[i];
      const double gap = std::hypot(keypoint.x_px - seen.pixel.x(), keypoint.y_px - seen.pixel.y());
      if (!keyframe->points[i] || gap >= nearest) continue;
      nearest = gap;
      found = keyframe->points[i];
    }
    if (nearest <= kMaxPixelGap) return (*this)(found);
    return absl::NotFoundError(absl::StrFormat(
        "keyframe %u of %s sees no point within %.0f px of %g, %g (cairn show MAP keyframe %u --picture)",
        seen.keyframe.value(), name_, kMaxPixelGap, seen.pixel.x(), seen.pixel.y(), seen.keyframe.value()));
  }

 private:
  absl::Status Missing(const char* what, std::uint32_t id) const {
    return absl::NotFoundError(absl::StrCat(name_, " has no ", what, " ", id, " (cairn ls)"));
  }
  const std::string& name_;
  const map::Snapshot& map_;
};

class KnownAligner {
 public:
  KnownAligner(const std::string& name, const map::Snapshot& map, const api::AlignRequest& request)
      : name_(name), map_(map), request_(request), known_(std::get<KnownPlaces>(request.by)), find_(name, map) {
    result_.component = request.component;
  }

  absl::StatusOr<api::ComponentAlignment> Run() {
    if (!known_.positions.empty()) {
      CAIRN_RETURN_IF_ERROR(ByPositions());
    } else {
      CAIRN_RETURN_IF_ERROR(ByDistancesAndGravity());
    }
    return std::move(result_);
  }

 private:
  absl::StatusOr<Vector3d> Find(const Landmark& landmark) {
    CAIRN_ASSIGN_OR_RETURN(const Place place, std::visit(find_, landmark));
    if (result_.component && result_.component != place.component) {
      return absl::InvalidArgumentError(absl::StrCat("components ", result_.component.value(), " and ",
                                                     place.component.value(), " of ", name_,
                                                     " have frames of their own: name places of one of them"));
    }
    result_.component = place.component;
    return place.at;
  }

  const std::optional<Sim3>& Now() const { return map_.WorldFrom(result_.component); }

  absl::Status CheckOverwrite() const {
    if (!Now() || request_.overwrite) return absl::OkStatus();
    return absl::AlreadyExistsError(
        absl::StrCat("component ", result_.component.value(), " of ", name_,
                     " is aligned already: ask to overwrite that (--overwrite) to change it"));
  }

  absl::Status CheckScale(double scale, double relative_sigma) const {
    if (!Now() || request_.force) return absl::OkStatus();
    const absl::Status same = CheckScaleAgainst(*Now(), scale, relative_sigma);
    if (same.ok()) return same;
    return absl::FailedPreconditionError(absl::StrCat("component ", result_.component.value(), " of ", name_, ": ",
                                                      same.message(), " (--force aligns all the same)"));
  }

  // Lengths and gravity say nothing of where a component lies; in the world it would be compared with others.
  absl::Status CheckAlone() const {
    if (Now() || request_.force) return absl::OkStatus();
    for (const ComponentId other : map_.LiveComponents()) {
      if (other == result_.component || !map_.WorldFrom(other)) continue;
      return absl::FailedPreconditionError(absl::StrCat(
          "component ", other.value(), " of ", name_,
          " is aligned to the world, and distances do not tell where in it ", "component ", result_.component.value(),
          " lies: use --points or --groundtruth (--force gives it the scale "
          "all the same, at a place of its own)"));
    }
    return absl::OkStatus();
  }

  absl::Status ByPositions() {
    std::vector<Vector3d> world, map;
    for (const KnownPosition& position : known_.positions) {
      const absl::StatusOr<Vector3d> at = Find(position.of);
      if (!at.ok()) return Annotate(at.status(), absl::StrCat("known position ", map.size() + 1));
      map.push_back(*at);
      world.push_back(position.world_m);
    }
    CAIRN_RETURN_IF_ERROR(CheckOverwrite());
    AlignmentOptions options;
    options.min_spread_ratio = 0.01;  // what was measured errs more than that
    CAIRN_ASSIGN_OR_RETURN(const Alignment found, AlignPoints(world, map, options));
    result_.world_from_component = found.a_from_b;
    result_.rmse_all_m = found.rmse;
    result_.scale_sigma = found.scale_sigma / found.a_from_b.scale();
    CAIRN_RETURN_IF_ERROR(CheckScale(found.a_from_b.scale(), result_.scale_sigma));
    result_.rotation_sigma_rad = found.rotation_sigma_rad;
    for (std::size_t i = 0; i < world.size(); ++i) {
      result_.errors_m.push_back((found.a_from_b * map[i] - world[i]).norm());
    }
    if (request_.force ||
        (result_.scale_sigma <= kMaxKnownScaleSigma && result_.rotation_sigma_rad <= kMaxKnownRotationSigmaRad)) {
      return absl::OkStatus();
    }
    const auto worst = std::ranges::max_element(result_.errors_m) - result_.errors_m.begin();
    return absl::FailedPreconditionError(absl::StrFormat(
        "the positions do not fit %s; it is as it was: they are off by %.3f m (RMSE), most the one in place %d, by "
        "%.3f "
        "m, so that the scale is uncertain by %.0f %% and the rotation by %.1f deg (--force aligns all the same)",
        name_, result_.rmse_all_m, worst + 1, result_.errors_m[static_cast<std::size_t>(worst)],
        100.0 * result_.scale_sigma, result_.rotation_sigma_rad * 180.0 / M_PI));
  }

  absl::Status ByDistancesAndGravity() {
    std::vector<double> lengths;
    for (const KnownDistance& distance : known_.distances) {
      CAIRN_ASSIGN_OR_RETURN(const Vector3d from, Find(distance.from));
      CAIRN_ASSIGN_OR_RETURN(const Vector3d to, Find(distance.to));
      lengths.push_back((to - from).norm());
      if (lengths.back() > 0.0) continue;
      return absl::InvalidArgumentError("a known distance is between two places, not of one to itself");
    }
    if (!result_.component) CAIRN_RETURN_IF_ERROR(ChooseComponent());
    CAIRN_RETURN_IF_ERROR(CheckOverwrite());
    if (!Now() && lengths.empty()) {
      return absl::FailedPreconditionError(
          absl::StrCat("component ", result_.component.value(), " of ", name_,
                       " is not aligned, and gravity says nothing of its scale: give a distance as well (--distance)"));
    }
    CAIRN_RETURN_IF_ERROR(CheckAlone());
    Sim3 world = Now().value_or(Sim3());
    if (!lengths.empty()) CAIRN_RETURN_IF_ERROR(SetScale(lengths, &world));
    result_.world_from_component = Turned(world);
    return absl::OkStatus();
  }

  // The one with most keyframes: gravity names none.
  absl::Status ChooseComponent() {
    for (const ComponentId id : map_.LiveComponents()) {
      if (!result_.component || map_.NumKeyframes(id) > map_.NumKeyframes(result_.component)) result_.component = id;
    }
    return result_.component ? absl::OkStatus()
                             : absl::FailedPreconditionError(absl::StrCat(name_, " has no keyframes"));
  }

  // Scales about the world's origin.
  absl::Status SetScale(const std::vector<double>& lengths, Sim3* world) {
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < lengths.size(); ++i) sum += std::log(known_.distances[i].metres / lengths[i]);
    const auto n = static_cast<double>(lengths.size());
    const double scale = std::exp(sum / n);
    for (std::size_t i = 0; i < lengths.size(); ++i) {
      result_.errors_m.push_back(std::abs(scale * lengths[i] - known_.distances[i].metres));
      const double ratio = std::log(known_.distances[i].metres / (scale * lengths[i]));
      squares += ratio * ratio;
      result_.rmse_all_m += result_.errors_m.back() * result_.errors_m.back() / n;
    }
    result_.rmse_all_m = std::sqrt(result_.rmse_all_m);
    if (lengths.size() > 1) result_.scale_sigma = std::sqrt(squares / (n - 1.0) / n);
    if (result_.scale_sigma > kMaxKnownScaleSigma && !request_.force) {
      return absl::FailedPreconditionError(
          absl::StrFormat("the distances contradict each other; %s is as it was: the scale is uncertain by %.0f %% "
                          "(--force takes their mean all the same)",
                          name_, 100.0 * result_.scale_sigma));
    }
    CAIRN_RETURN_IF_ERROR(CheckScale(scale, result_.scale_sigma));
    const double factor = scale / world->scale();
    *world = Sim3(world->rotation(), factor * world->translation(), scale);
    return absl::OkStatus();
  }

  Sim3 Turned(const Sim3& world) const {
    Vector3d up = Vector3d::Zero();  // frame of the world
    if (known_.gravity) {
      up = -*known_.gravity;
    } else if (known_.upright_cameras) {
      map_.keyframes().ForEach([&](const auto& keyframe) {
        if (keyframe->component != result_.component) return;
        up -= world.rotation() * (keyframe->camera_from_map.rotation().conjugate() * Vector3d::UnitY());
      });
    }
    if (!(up.norm() > 1e-9)) return world;
    const Quaterniond turn = Quaterniond::FromTwoVectors(up, Vector3d::UnitZ());
    return Sim3(turn * world.rotation(), turn * world.translation(), world.scale());
  }

  const std::string& name_;
  const map::Snapshot& map_;
  const api::AlignRequest& request_;
  const KnownPlaces& known_;
  const Finder find_;
  api::ComponentAlignment result_;
};

}  // namespace

absl::StatusOr<api::ComponentAlignment> AlignByPlaces(const std::string& map, const api::AlignRequest& request,
                                                      map::Edit* edit) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<AlignmentTarget> targets, TargetsOf(map, edit->base(), request));
  if (request.component) CAIRN_RETURN_IF_ERROR(ChooseTarget(map, targets, request).status());
  CAIRN_ASSIGN_OR_RETURN(api::ComponentAlignment aligned, KnownAligner(map, edit->base(), request).Run());
  const auto chosen = std::ranges::find(targets, aligned.component, &AlignmentTarget::component);
  aligned.keyframes = static_cast<std::int64_t>(chosen->keyframes.size());
  aligned.moved_m = MedianMove(*chosen, aligned.world_from_component);
  aligned.others = OthersOf(targets, static_cast<std::size_t>(chosen - targets.begin()));
  PutAlignment(aligned.component, aligned.world_from_component, edit);
  return aligned;
}

}  // namespace cairn::engine
