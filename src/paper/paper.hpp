// method: paper - the score of Liang et al., "Unsupervised UAV 3D Trajectories Estimation with
// Sparse Point Clouds" (ICASSP 2025, arXiv 2412.12716), for reproduction and comparison.
//
// All frames are superimposed and clustered (global clusters C_k); the share of each window of
// frames in a cluster is its local cluster C_k,i. A target overlaps little with itself from one
// window to the next (psi_iou) and is as dense in one window as in all of them (psi_rho). Where the
// paper is ambiguous, an enum lists the readings; docs/paper.md compares them on a real recording.
// The paper has no test for "no drone": the best cluster always wins.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Score and statistics of a global cluster, all finite.
struct ClusterScore {
  std::int32_t id = 0;    // label of the global clustering
  int rank = 0;           // 1 is the best; ineligible clusters come last
  bool eligible = false;  // seen in at least min_windows windows
  std::int64_t size = 0;  // |C_k|
  int frames = 0;         // frames with a return of the cluster
  int windows = 0;        // windows with a local cluster
  int pairs = 0;          // window pairs that were compared
  TimeNs first_ns = 0;    // stamps of the first and last frame with a return
  TimeNs last_ns = 0;
  Eigen::Vector3d centroid_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d extent_m = Eigen::Vector3d::Zero();
  double volume_m3 = 0.0;              // V_k of the merged cluster
  double local_volume_m3 = 0.0;        // mean V_k,i
  double merged_density_per_m3 = 0.0;  // rho_k
  double local_density_per_m3 = 0.0;   // mean rho_k,i
  double iou = 0.0;                    // mean IoU of the pairs
  double relative_density = 0.0;       // mean R
  double psi_iou = 0.0;
  double psi_rho = 0.0;
  double psi = 0.0;
  // Not in the paper: mean squared step of the per-frame centroids over their variance (von Neumann
  // 1941). 2 for white jitter, near 0 for a smooth path; 2 if undefined.
  double von_neumann_ratio = 2.0;
};

// rho = |C| / V; 0 for an empty volume.
inline double Density(std::size_t returns, double volume_m3) {
  return volume_m3 > 0.0 ? static_cast<double>(returns) / volume_m3 : 0.0;
}

// Relative density R; both densities must be positive.
double RelativeDensity(double local_per_m3, double merged_per_m3, DensityReading reading);

// Summand of psi_rho. e^R is capped at e^600 so that sums stay finite.
double DensitySummand(double relative_density, DensityTerm term);

// Summand of psi_iou.
double IouSummand(double iou, IouTerm term, double min_iou);

// Returns the sum or the mean; 0 if there are no summands.
double Accumulate(const std::vector<double>& summands, Accumulation accumulation);

// psi = psi_rho + lambda psi_iou.
double Psi(double psi_rho, double psi_iou, double lambda);

// Von Neumann ratio of centroids in time order; 2 for fewer than two or if all coincide.
double VonNeumannRatio(const std::vector<Eigen::Vector3d>& centroids_m);

// Returns all global clusters by rank: eligible ones first, then by falling psi, then by id.
std::vector<ClusterScore> ScoreClusters(const Recording& recording, const PaperConfig& config);

// Returns the winner, or nothing if no cluster is eligible. Its measurements are the per-frame
// centroids of its local clusters; their covariance is that of one return (pooled scatter within
// frames plus return_sigma_m^2) over the number of returns. Its score is psi; it has no trajectory.
// `scores`, if not null, receives the result of ScoreClusters().
std::vector<Target> FindTargetsPaper(const Recording& recording, const PaperConfig& config,
                                     std::vector<ClusterScore>* scores = nullptr);

}  // namespace unlidar
