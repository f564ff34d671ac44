// cairn align: gives a map its place and scale in the world.
#include <cmath>
#include <cstdio>

#include "cli/cli.h"
#include "cli/component_report.h"
#include "engine/live_map.h"
#include "eval/association.h"
#include "geometry/alignment.h"
#include "io/trajectory.h"
#include "map/edit.h"

namespace cairn::cli {
namespace {

struct AlignOptions {
  std::string map;
  std::string groundtruth;
  double max_dt_s = 0.02;
  bool overwrite = false;
  bool json = false;
};

absl::Status Align(const AlignOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const io::Trajectory truth, io::ReadTrajectory(options.groundtruth));
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<engine::LiveMap> live, engine::LiveMap::Open(options.map));
  const std::shared_ptr<const map::Snapshot> map = live->Published()->snapshot();
  const ComponentId component = TogetherInOneFrame(*map).at(0);
  if (map->WorldFrom(component) && !options.overwrite) {
    return absl::AlreadyExistsError(
        absl::StrCat(options.map, " is aligned already: give --overwrite to align it anew"));
  }
  std::vector<io::StampedPose> keyframes;
  map->keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component != component) return;
    keyframes.push_back({keyframe->time_ns, keyframe->camera_from_map.Inverse()});
  });
  keyframes = eval::SortedFinite(keyframes);
  const std::vector<io::StampedPose> reference = eval::SortedFinite(truth.poses);

  std::vector<Vector3d> in_world, in_map;
  for (const eval::Association& pair : eval::AssociateNearest(keyframes, reference, options.max_dt_s)) {
    in_map.push_back(keyframes[pair.estimate].world_from_camera.translation());
    in_world.push_back(reference[pair.groundtruth].world_from_camera.translation());
  }
  absl::StatusOr<Alignment> alignment = AlignPointsRobust(in_world, in_map);
  if (!alignment.ok()) {
    return Annotate(alignment.status(),
                    absl::StrCat(in_map.size(), " of ", keyframes.size(), " keyframes have a pose within ",
                                 options.max_dt_s, " s in ", options.groundtruth));
  }
  // Positions of another place or clock fit nowhere, and their scale is not determined.
  constexpr double kMaxScaleUncertainty = 0.05;
  if (alignment->scale_sigma > kMaxScaleUncertainty * alignment->a_from_b.scale()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the keyframes do not fit ", options.groundtruth, ": the scale would be ", alignment->a_from_b.scale(), " +- ",
        alignment->scale_sigma, "; the map is as it was. Is it the trajectory of the mapped sequence?"));
  }
  map::Edit edit(map);
  map::Component aligned = map->component(component);
  aligned.world_from_component = alignment->a_from_b;
  edit.PutComponent(aligned);
  CAIRN_RETURN_IF_ERROR(live->BeginEdit().Commit(edit.Finish("align to the world"), {}));
  CAIRN_RETURN_IF_ERROR(live->Close());

  const double rotation_sigma_deg = alignment->rotation_sigma_rad * 57.29577951308232;
  if (options.json) {
    PrintJson({{"map", options.map},
               {"revision", live->Published()->revision()},
               {"component", component.value()},
               {"keyframes_used", in_map.size()},
               {"inliers", alignment->inlier_count},
               {"rmse_m", alignment->rmse},
               {"scale", alignment->a_from_b.scale()},
               {"scale_sigma", alignment->scale_sigma},
               {"rotation_sigma_deg", rotation_sigma_deg}});
  } else {
    std::printf("%s is aligned: scale %.4f +- %.4f, %.4f m RMSE over %d of %zu keyframes with a reference pose\n",
                options.map.c_str(), alignment->a_from_b.scale(), alignment->scale_sigma, alignment->rmse,
                alignment->inlier_count, in_map.size());
  }
  return absl::OkStatus();
}

}  // namespace

void AddAlignCommand(CLI::App& app, Action* action) {
  CLI::App* verb =
      app.add_subcommand("align", "Give a map its scale and place in the world, from known camera positions");
  auto options = std::make_shared<AlignOptions>();
  verb->add_option("MAP", options->map, "Map file (.cairn); stores world_from_map in it")->required();
  verb->add_option("--groundtruth", options->groundtruth,
                   "Camera poses of the mapped sequence: TUM, EuRoC csv or KITTI")
      ->required();
  verb->add_option("--max-dt", options->max_dt_s, "Largest time difference of keyframe and reference, seconds")
      ->capture_default_str();
  verb->add_flag("--overwrite", options->overwrite, "Replace an alignment that the map has");
  verb->add_flag("--json", options->json, "Answer in JSON");
  verb->footer("Example:\n  cairn align office.cairn --groundtruth groundtruth.txt");
  verb->callback([=] {
    *action = [=] {
      const absl::Status status = Align(*options);
      return status.ok() ? static_cast<int>(kOk) : Fail("align", status, options->json);
    };
  });
}

}  // namespace cairn::cli
