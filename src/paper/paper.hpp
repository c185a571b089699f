// method: paper - the score of Liang et al., "Unsupervised UAV 3D Trajectories Estimation with
// Sparse Point Clouds" (ICASSP 2025, arXiv 2412.12716), so that anyone can reproduce and judge it.
//
// All frames are superimposed and clustered (global clusters C_k); the share of each window of
// frames in a cluster is its local cluster C_k,i. A target is what overlaps little with itself from
// one window to the next (psi_iou) and is as dense in a window as in all of them (psi_rho).
// Where the paper leaves a reading open, an enum names the readings; docs/paper.md compares
// them on a real recording. The paper has no test for "no drone": the best cluster always wins.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "paper/clustering.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Every number of a global cluster. All are finite.
struct ClusterScore {
  std::int32_t id = 0;    // label of the global clustering
  int rank = 0;           // 1 is the best; clusters that cannot win stand behind all others
  bool eligible = false;  // seen in at least min_windows windows
  std::int64_t size = 0;  // |C_k|
  int frames = 0;         // frames that hold a return of it
  int windows = 0;        // windows with a local cluster
  int pairs = 0;          // window pairs that were compared
  TimeNs first_ns = 0;    // stamps of the first and last such frame
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
  // Not of the paper: mean squared step of the per-frame centroids over their variance (von
  // Neumann 1941). 2 for white jitter, near 0 for a smooth path; 2 where it is not defined.
  double von_neumann_ratio = 2.0;
};

// rho = |C| / V; 0 for an empty volume.
double Density(std::size_t returns, double volume_m3);

// R, of positive densities.
double RelativeDensity(double local_per_m3, double merged_per_m3, DensityReading reading);

// The summand of psi_rho. e^R is capped at e^600 so that sums stay finite.
double DensitySummand(double relative_density, DensityTerm term);

// The summand of psi_iou.
double IouSummand(double iou, IouTerm term, double min_iou);

// The sum or the mean; 0 of nothing.
double Accumulate(const std::vector<double>& summands, Accumulation accumulation);

// psi = psi_rho + lambda psi_iou.
double Psi(double psi_rho, double psi_iou, double lambda);

// Of centroids in time order; 2 for fewer than two or all in one place.
double VonNeumannRatio(const std::vector<Eigen::Vector3d>& centroids_m);

// All global clusters in order of rank: by falling psi, then by id.
std::vector<ClusterScore> ScoreClusters(const Recording& recording, const PaperConfig& config);

// The winner, or nothing where no cluster is eligible. Its measurements are the centroids of its
// local cluster frame by frame, with the scatter within frames over the number of returns as
// covariance; its score is psi. `scores`, if given, receives what ScoreClusters returns.
std::vector<Target> FindTargetsPaper(const Recording& recording, const PaperConfig& config,
                                     std::vector<ClusterScore>* scores = nullptr);

}  // namespace unlidar
