#include "mapping/loop_correction.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "base/dense_ids.h"
#include "base/median.h"
#include "mapping/grid_cache.h"
#include "mapping/held.h"
#include "mapping/point_fusion.h"
#include "optimization/pose_graph.h"

namespace cairn::mapping {
namespace {

using optimization::PoseGraphProblem;
using EssentialEdges = std::map<std::pair<KeyframeId, KeyframeId>, double>;  // with weights

std::vector<PointId> PointsOf(const map::Edit& edit, std::span<const KeyframeId> keyframes) {
  std::vector<PointId> points;
  for (const KeyframeId id : keyframes) {
    for (const PointId point : edit.keyframe(id).points) {
      if (point) points.push_back(point);
    }
  }
  SortUnique(&points);
  return points;
}

class Corrector {
 public:
  Corrector(const Loop& loop, const LoopEdges& earlier, const LoopOptions& options, map::Edit& edit)
      : loop_(loop), earlier_(earlier), options_(options), edit_(edit), base_(edit.base()) {}

  absl::StatusOr<LoopCorrection> Run() {
    MoveNeighbourhood();
    Fuse();
    FindLoopEdges();
    CAIRN_RETURN_IF_ERROR(Spread());
    return std::move(result_);
  }

 private:
  bool Held(KeyframeId id) const { return IsHeld(base_, base_.keyframe(id), base_.keyframe(loop_.current).session); }

  Sim3 Before(KeyframeId id) const { return Sim3(base_.keyframe(id).camera_from_map); }

  // The current keyframe and those covisible with it go where the similarity puts them, with their points; what is held
  // stays, and the points that it knows best.
  void MoveNeighbourhood() {
    const map::Keyframe& current = base_.keyframe(loop_.current);
    const Sim3 current_from_map = loop_.current_from_loop * Before(loop_.loop);
    corrected_[current.id] = current_from_map;
    for (const KeyframeId id : map::BestCovisible(current)) {
      if (Held(id) || std::ranges::find(loop_.loop_side, id) != loop_.loop_side.end()) continue;
      corrected_[id] = Sim3(base_.keyframe(id).camera_from_map * current.camera_from_map.Inverse()) * current_from_map;
    }
    for (const auto& [id, camera_from_map] : corrected_) {
      for (const PointId point : base_.keyframe(id).points) {
        if (!point || moved_by_.contains(point)) continue;
        // With the keyframe that knows it best, if that moves as well.
        const KeyframeId reference = base_.point(point).reference.keyframe;
        if (Held(reference)) continue;
        const KeyframeId by = corrected_.contains(reference) ? reference : id;
        moved_by_[point] = by;
        edit_.SetPosition(point, corrected_[by].Inverse() * (Before(by) * base_.point(point).position));
      }
    }
    for (const auto& [id, camera_from_map] : corrected_) edit_.SetPose(id, RigidPart(camera_from_map));
    for (const auto& [point, by] : moved_by_) edit_.UpdatePoint(point);
  }

  void Fuse() {
    std::vector<KeyframeId> neighbourhood;
    for (const auto& [id, camera_from_map] : corrected_) neighbourhood.push_back(id);
    const FusedSides fused = FuseSides(loop_, neighbourhood, loop_.loop_side, options_, edit_);
    result_.fused_points = fused.points;
    result_.added_observations = fused.observations;
  }

  // What fusion has linked across the loop.
  void FindLoopEdges() {
    result_.new_edges.emplace_back(loop_.current, loop_.loop);
    for (const auto& [id, camera_from_map] : corrected_) {
      edit_.UpdateCovisibility(id);
      const auto& before = base_.keyframe(id).covisible;
      for (const map::CovisibilityEdge& edge : edit_.keyframe(id).covisible) {
        if (edge.shared_points < map::kMinEssentialPoints) break;
        if (corrected_.contains(edge.keyframe) || (id == loop_.current && edge.keyframe == loop_.loop)) continue;
        const auto known = std::ranges::find(before, edge.keyframe, &map::CovisibilityEdge::keyframe);
        if (known == before.end()) result_.new_edges.emplace_back(id, edge.keyframe);
      }
    }
  }

  // The spanning tree, strong covisibility as it was before, earlier loops: each pair once, with its weight. A link of
  // the tree without shared points is no measurement of features: mapping began anew there, by the odometry's word.
  EssentialEdges Essential() const {
    EssentialEdges edges;
    const auto add = [&edges](KeyframeId a, KeyframeId b, double weight) {
      double& known = edges[{std::min(a, b), std::max(a, b)}];
      known = std::max(known, weight);
    };
    base_.keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
      if (keyframe->parent) {
        const bool shares = std::ranges::find(keyframe->covisible, keyframe->parent,
                                              &map::CovisibilityEdge::keyframe) != keyframe->covisible.end();
        add(keyframe->id, keyframe->parent, shares ? 1.0 : options_.restart_edge_weight);
      }
      for (const map::CovisibilityEdge& edge : keyframe->covisible) {
        if (edge.shared_points < map::kMinEssentialPoints) break;
        add(keyframe->id, edge.keyframe, 1.0);
      }
    });
    for (const LoopEdges& known : {earlier_, KnownLoopEdges(base_)}) {
      for (const auto& [a, b] : known) {
        if (base_.keyframes().Contains(a) && base_.keyframes().Contains(b)) add(a, b, 1.0);
      }
    }
    return edges;
  }

  // Only what hangs together with the loop keyframe takes part.
  void ChooseKeyframes(const EssentialEdges& edges) {
    std::unordered_map<KeyframeId, std::vector<KeyframeId>> linked;
    const auto link = [&linked](KeyframeId a, KeyframeId b) {
      linked[a].push_back(b);
      linked[b].push_back(a);
    };
    for (const auto& [pair, weight] : edges) link(pair.first, pair.second);
    for (const auto& [a, b] : result_.new_edges) link(a, b);
    std::set<KeyframeId> reached = {loop_.loop};
    std::vector<KeyframeId> open = {loop_.loop};
    while (!open.empty()) {
      const KeyframeId at = open.back();
      open.pop_back();
      for (const KeyframeId next : linked[at]) {
        if (reached.insert(next).second) open.push_back(next);
      }
    }
    for (const KeyframeId id : reached) {
      node_of_[id] = static_cast<std::uint32_t>(keyframes_.size());
      keyframes_.push_back(id);
    }
  }

  // Distance of what the current keyframe sees, in the map's unit.
  double TypicalDistance() const {
    std::vector<double> distances;
    const map::Keyframe& loop = base_.keyframe(loop_.loop);
    for (const PointId point : loop.points) {
      if (point) distances.push_back((loop.camera_from_map * base_.point(point).position).norm());
    }
    return distances.empty() ? 1.0 : Median(std::move(distances));
  }

  Sim3 Start(KeyframeId id) const {
    const auto corrected = corrected_.find(id);
    return corrected != corrected_.end() ? corrected->second : Before(id);
  }

  absl::Status Spread() {
    const EssentialEdges edges = Essential();
    ChooseKeyframes(edges);
    PoseGraphProblem problem;
    for (const KeyframeId id : keyframes_) problem.nodes.push_back({Start(id), id == loop_.loop || Held(id)});
    for (const auto& [pair, weight] : edges) {
      const auto& [a, b] = pair;
      if (!node_of_.contains(a)) continue;
      problem.edges.push_back({node_of_.at(a), node_of_.at(b), Before(b) * Before(a).Inverse(), weight});
    }
    for (const auto& [a, b] : result_.new_edges) {
      problem.edges.push_back(
          {node_of_.at(a), node_of_.at(b), Start(b) * Start(a).Inverse(), options_.loop_edge_weight});
    }
    optimization::PoseGraphOptions graph;
    graph.max_iterations = options_.pose_graph_iterations;
    graph.translation_unit = std::max(1e-9, TypicalDistance());
    CAIRN_ASSIGN_OR_RETURN(const optimization::PoseGraphResult solved, optimization::OptimizePoseGraph(problem, graph));
    result_.graph_keyframes = static_cast<int>(problem.nodes.size());
    result_.graph_edges = static_cast<int>(problem.edges.size());
    result_.graph_initial_cost = solved.initial_cost;
    result_.graph_final_cost = solved.final_cost;
    Apply(solved.camera_from_map);
    return absl::OkStatus();
  }

  void Apply(const std::vector<Sim3>& solved) {
    for (std::size_t i = 0; i < keyframes_.size(); ++i) {
      edit_.SetPose(keyframes_[i], RigidPart(solved[i]));
      result_.scales[keyframes_[i]] = 1.0 / solved[i].scale();
    }
    base_.points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
      const map::MapPoint* now = edit_.FindPoint(point->id);
      if (now == nullptr) return;
      const auto moved = moved_by_.find(point->id);
      const KeyframeId by = moved != moved_by_.end() ? moved->second : point->reference.keyframe;
      const auto node = node_of_.find(by);
      if (node == node_of_.end()) return;
      // Points of the neighbourhood are where the similarity put them, all others where they were.
      const Vector3d in_camera = (moved != moved_by_.end() ? corrected_.at(by) : Before(by)) * now->position;
      edit_.SetPosition(point->id, solved[node->second].Inverse() * in_camera);
    });
  }

  const Loop& loop_;
  const LoopEdges& earlier_;
  const LoopOptions& options_;
  map::Edit& edit_;
  const map::Snapshot& base_;
  LoopCorrection result_;
  std::map<KeyframeId, Sim3> corrected_;    // camera_from_map of the neighbourhood after the similarity
  std::map<PointId, KeyframeId> moved_by_;  // points that moved with it, and with which keyframe
  std::vector<KeyframeId> keyframes_;       // nodes of the graph
  std::unordered_map<KeyframeId, std::uint32_t> node_of_;
};

}  // namespace

FusedSides FuseSides(const Loop& loop, std::span<const KeyframeId> here, std::span<const KeyframeId> there,
                     const LoopOptions& options, map::Edit& edit) {
  FusedSides fused;
  for (const LoopMatch& match : loop.matches) {
    if (edit.FindPoint(match.point) == nullptr) continue;
    const PointId own = edit.keyframe(loop.current).points[match.feature];
    if (own == match.point) continue;
    if (own) {
      edit.FusePoints(own, match.point);
      ++fused.points;
    } else {
      fused.observations += edit.AddObservation(match.point, loop.current, match.feature) ? 1 : 0;
    }
  }
  FusionOptions fusion;
  fusion.radius_px = options.fusion_radius_px;
  fusion.extra_sigma_px = options.fusion_extra_sigma_px;
  GridCache grids;
  const auto fuse_into = [&](KeyframeId id, std::span<const PointId> points) {
    const FusionCounts counts = FuseInto(edit, id, points, grids, fusion);
    fused.points += counts.fused;
    fused.observations += counts.observations;
  };
  const std::vector<PointId> of_there = PointsOf(edit, there), of_here = PointsOf(edit, here);
  for (const KeyframeId id : here) fuse_into(id, of_there);
  for (const KeyframeId id : there) fuse_into(id, of_here);
  return fused;
}

LoopEdges KnownLoopEdges(const map::Snapshot& map) {
  LoopEdges edges;
  const auto add = [&](KeyframeId a, KeyframeId b) {
    if (map.keyframes().Contains(a) && map.keyframes().Contains(b)) edges.emplace_back(a, b);
  };
  for (const auto& [id, session] : map.sessions()) {
    for (const map::ClosedLoop& loop : session.loops) add(loop.keyframe, loop.loop_keyframe);
  }
  for (const auto& [id, component] : map.components()) {
    if (component.joined) add(component.joined->keyframe, component.joined->into_keyframe);
  }
  return edges;
}

absl::StatusOr<LoopCorrection> CorrectLoop(const Loop& loop, const LoopEdges& earlier, const LoopOptions& options,
                                           map::Edit& edit) {
  return Corrector(loop, earlier, options, edit).Run();
}

}  // namespace cairn::mapping
