#include "mapping/point_fusion.h"

#include <algorithm>
#include <unordered_set>

#include "base/dense_ids.h"
#include "image/matching.h"
#include "tracking/projection_matcher.h"

namespace cairn::mapping {
namespace {

bool Observes(const map::MapPoint& point, KeyframeId keyframe) {
  const auto at = std::lower_bound(point.observations.begin(), point.observations.end(), map::Observation{keyframe, 0});
  return at != point.observations.end() && at->keyframe == keyframe;
}

// The most alike feature near the projection.
std::uint32_t BestFeature(const map::Keyframe& keyframe, const tracking::PointProjection& projection,
                          const image::Descriptor& descriptor, const image::FeatureGrid& grid,
                          const std::vector<double>& scale, const FusionOptions& options,
                          std::vector<std::uint32_t>* near) {
  const double radius = options.extra_sigma_px + options.radius_px * scale[static_cast<std::size_t>(projection.octave)];
  grid.Query(projection.pixel.x(), projection.pixel.y(), radius, projection.octave - 1, projection.octave + 1, near);
  std::erase_if(*near, [&](std::uint32_t feature) {
    const image::Keypoint& keypoint = keyframe.keypoints()[feature];
    const double error_x = projection.pixel.x() - keypoint.x_px, error_y = projection.pixel.y() - keypoint.y_px;
    const double sigma = scale[keypoint.octave] + options.extra_sigma_px;
    return error_x * error_x + error_y * error_y > options.max_chi_square * sigma * sigma;
  });
  const image::BestTwo best = image::FindBestTwo(descriptor, keyframe.descriptors(), *near);
  return best.Accept(options.max_distance, 1.0) ? best.index : image::kNoFeature;
}

}  // namespace

FusionCounts FuseInto(map::Edit& edit, KeyframeId id, std::span<const PointId> points, GridCache& grids,
                      const FusionOptions& options) {
  FusionCounts counts;
  const image::OrbParameters& orb = edit.info().orb;
  const Pinhole pinhole = edit.pinhole(edit.keyframe(id).camera);
  const SE3 camera_from_map = edit.keyframe(id).camera_from_map;
  const image::FeatureGrid& grid = grids.Of(edit.keyframe(id), pinhole);
  std::vector<double> scale;
  for (int octave = 0; octave < orb.num_levels; ++octave) scale.push_back(orb.Scale(octave));
  std::vector<std::uint32_t> near;
  for (const PointId point_id : points) {
    const map::MapPoint* point = edit.FindPoint(point_id);
    if (point == nullptr || Observes(*point, id)) continue;
    const auto projection = tracking::PredictPoint(pinhole, camera_from_map, *point, orb);
    if (!projection) continue;
    const std::uint32_t feature =
        BestFeature(edit.keyframe(id), *projection, point->descriptor, grid, scale, options, &near);
    if (feature == image::kNoFeature) continue;
    const PointId known = edit.keyframe(id).points[feature];
    if (!known) {
      counts.observations += edit.AddObservation(point_id, id, feature) ? 1 : 0;
      continue;
    }
    // The one known better stays.
    const std::size_t of_known = edit.point(known).observations.size(), of_this = point->observations.size();
    const bool keep_known = of_known > of_this || (of_known == of_this && known < point_id);
    edit.FusePoints(keep_known ? point_id : known, keep_known ? known : point_id);
    edit.UpdatePoint(keep_known ? known : point_id);
    ++counts.fused;
  }
  return counts;
}

FusionCounts FuseAround(map::Edit& edit, KeyframeId id, std::span<const KeyframeId> around, GridCache& grids,
                        const FusionOptions& options) {
  const auto points_of = [&](KeyframeId keyframe, std::vector<PointId>* points) {
    for (const PointId point : edit.keyframe(keyframe).points) {
      if (point) points->push_back(point);
    }
  };
  FusionCounts counts;
  const auto add = [&counts](const FusionCounts& more) {
    counts.observations += more.observations;
    counts.fused += more.fused;
  };
  for (const KeyframeId other : around) {
    std::vector<PointId> own;
    points_of(id, &own);
    add(FuseInto(edit, other, own, grids, options));
  }
  std::vector<PointId> others;
  for (const KeyframeId other : around) points_of(other, &others);
  SortUnique(&others);
  add(FuseInto(edit, id, others, grids, options));
  return counts;
}

std::vector<KeyframeId> SurroundingKeyframes(const map::Edit& edit, KeyframeId keyframe, int first, int second,
                                             std::span<const KeyframeId> more) {
  std::vector<KeyframeId> around;
  std::unordered_set<KeyframeId> known = {keyframe};
  const auto add = [&](KeyframeId id) {
    if (edit.FindKeyframe(id) != nullptr && known.insert(id).second) around.push_back(id);
  };
  if (first > 0) {
    for (const KeyframeId id : map::BestCovisible(edit.keyframe(keyframe), first)) add(id);
  }
  const std::size_t direct = around.size();
  for (std::size_t i = 0; second > 0 && i < direct; ++i) {
    for (const KeyframeId id : map::BestCovisible(edit.keyframe(around[i]), second)) add(id);
  }
  for (const KeyframeId id : more) add(id);
  return around;
}

}  // namespace cairn::mapping
