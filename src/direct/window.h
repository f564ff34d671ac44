// Windowed photometric bundle adjustment (DSO Sec. 2.3): Gauss-Newton over poses, brightness and inverse depths with
// the Schur complement over the depths, first-estimate Jacobians, and marginalization of points and keyframes into a
// prior.
//
// Per keyframe k: 8 unknowns, the left increment of camera_from_direct and (a, b). A residual depends on its host h and
// target t through the relative increment  A_t d_t + A_h d_h  with A_t = diag(I, 1, 1) and A_h = diag(-Ad(t_from_h),
// -1, -gain), taken at the linearization point.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "direct/keyframe.h"

namespace cairn::direct {

struct WindowOptions {
  double huber_gray = 9.0;
  double outlier_gray = 12.0;
  double outlier_median_factor = 2.5;
  double affine_a_sigma = 0.0;
  double affine_b_sigma_gray = 0.0;
  double min_marginalization_hessian = 50.0;
};

struct OptimizationReport {
  int iterations = 0;
  int residuals = 0;
  double rms_gray = 0.0;  // weighted, over the pixels of all good residuals
};

class Window {
 public:
  Window(const PyramidGeometry& geometry, const WindowOptions& options);

  // Appends; its linearization point is the current pose. The keyframe's pose, light, id and data must be set.
  Keyframe& AddKeyframe(std::unique_ptr<Keyframe> keyframe);
  int size() const { return static_cast<int>(keyframes_.size()); }
  bool empty() const { return keyframes_.empty(); }
  Keyframe& keyframe(int index) { return *keyframes_[index]; }
  const Keyframe& keyframe(int index) const { return *keyframes_[index]; }
  Keyframe& newest() { return *keyframes_.back(); }
  std::vector<ActivePoint>& points() { return points_; }
  const std::vector<ActivePoint>& points() const { return points_; }

  // Residuals of all points against the newest keyframe start anew.
  void ConnectNewest();
  // A point whose residuals against all other keyframes are to be tried.
  void AddPoint(const ActivePoint& point);

  OptimizationReport Optimize(int max_iterations);
  // Gauss-Newton of one candidate against all keyframes, poses fixed. False if its depth is not determined or too few
  // keyframes agree.
  bool RefineCandidate(const ImmaturePoint& candidate, int host, double min_hessian, int min_good, ActivePoint* point);

  // After Optimize(): drops points without residuals, then turns into prior (or drops, when badly known) every point
  // that left the newest keyframes or whose host is to go.
  void MarginalizePoints(const std::vector<bool>& keyframe_goes);
  // Folds the keyframe into the prior and takes it out. All its points must be gone.
  std::unique_ptr<Keyframe> MarginalizeKeyframe(int index);
  void Clear();

  // Of a point in a keyframe other than its host, at the current estimate; false if it is out of the image.
  bool EnergyAgainst(const ActivePoint& point, int target, float* energy) const {
    return Evaluate(point, target, point.inverse_depth, energy, nullptr);
  }

  // Geometry of a host and target at the current estimate.
  PairProjection Projection(int host, int target) const;

  // For tests: the full linear system at the current state, unknowns ordered keyframes then points, no gauge term.
  struct DenseSystem {
    Eigen::MatrixXd h;
    Eigen::VectorXd b;
    Eigen::MatrixXd gauge;  // what a step's system adds to the keyframes' block
    double energy = 0.0;
  };
  DenseSystem Linearize();
  // The step that Optimize() would try, without damping: keyframes then points.
  Eigen::VectorXd SchurStep(double damping);
  const Eigen::MatrixXd& prior_h() const { return prior_h_; }
  const Eigen::VectorXd& prior_b() const { return prior_b_; }

 private:
  // Both directions of every pair, prepared once per linearization.
  struct Pair {
    PairProjection projection;
    Matrix3d linear_rotation;
    Vector3d linear_translation;
    Matrix8d host_map;        // d relative / d host; d relative / d target is the identity
    Vector8d relative_delta;  // of the linearization point to the current estimate
    Matrix8d h;               // sums over the residuals of the pair
    Vector8d b;
  };
  struct ResidualRow {
    Vector8d h_pose_depth;  // in relative unknowns
    Matrix8d h;
    Vector8d b;
    double h_depth = 0.0;
    double b_depth = 0.0;
  };

  Pair& pair(int host, int target) { return pairs_[host * kMaxWindow + target]; }
  const Pair& pair(int host, int target) const { return pairs_[host * kMaxWindow + target]; }
  void PreparePairs();
  // One residual at the current estimate; false if outside. `row` may be null.
  bool Evaluate(const ActivePoint& point, int target, float inverse_depth, float* energy, ResidualRow* row) const;
  double LinearizeActive();  // fills system(); returns the energy
  double PriorEnergy() const;
  void AddPriors(Eigen::MatrixXd* h, Eigen::VectorXd* b) const;
  bool SolveStep(double damping, Eigen::VectorXd* step, std::vector<double>* depth_steps);
  Eigen::MatrixXd GaugeBasis() const;
  Eigen::MatrixXd GaugeTerm() const;  // of the linearized system
  void ApplyStep(const Eigen::VectorXd& step, const std::vector<double>& depth_steps);
  void Relinearize();
  void UpdateEnergyLimits();
  void SetEnergyLimit(int target);
  void RemoveKeyframeFromPoints(int index);

  PyramidGeometry geometry_;
  WindowOptions options_;
  ResidualKernel kernel_;
  std::vector<std::unique_ptr<Keyframe>> keyframes_;
  std::vector<ActivePoint> points_;
  std::vector<Pair> pairs_;
  Eigen::MatrixXd prior_h_;
  Eigen::VectorXd prior_b_;

  // Two linearizations: the accepted one and the one being tried.
  struct System {
    Eigen::MatrixXd h;
    Eigen::VectorXd b;
    Eigen::MatrixXd rows;  // 8n x points: H between poses and depth, in absolute unknowns
    std::vector<double> depth_h, depth_b;
  };
  System systems_[2];
  int current_system_ = 0;
  System& system() { return systems_[current_system_]; }
  const System& system() const { return systems_[current_system_]; }
  Eigen::MatrixXd scaled_rows_;
  std::vector<float> energies_;
};

}  // namespace cairn::direct
