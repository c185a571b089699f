#include "paper/paper.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "base/algorithms.hpp"
#include "base/voxel_grid.hpp"
#include "paper/clustering.hpp"

namespace unlidar {
namespace {

// Returns of one window in a global cluster, ascending.
struct LocalCluster {
  std::uint32_t window = 0;
  std::vector<std::uint32_t> returns;
};

struct GlobalCluster {
  std::vector<std::uint32_t> returns;  // ascending
  std::vector<LocalCluster> locals;    // by window, none empty
};

struct Clusters {
  std::vector<std::uint32_t> frame_of;  // (N) frame of each return
  std::vector<GlobalCluster> globals;   // by label
};

std::vector<std::uint32_t> FrameOfReturns(const Recording& recording) {
  std::vector<std::uint32_t> frame_of(recording.points_m.size(), 0);
  for (std::size_t frame = 0; frame < recording.frames.size(); ++frame) {
    const FrameInfo& info = recording.frames[frame];
    for (std::uint32_t i = info.first_return; i < info.last_return; ++i) {
      frame_of[i] = static_cast<std::uint32_t>(frame);
    }
  }
  return frame_of;
}

// Clusters each window separately; returns its labels, which start at 0 in each (returns).
std::vector<std::int32_t> LabelWindows(const std::vector<Eigen::Vector3f>& points_m,
                                       const std::vector<std::uint32_t>& window_of,
                                       const ClusteringConfig& config) {
  std::vector<std::int32_t> labels;
  labels.reserve(points_m.size());
  for (std::size_t begin = 0; begin < points_m.size();) {
    std::size_t end = begin + 1;
    while (end < points_m.size() && window_of[end] == window_of[begin]) ++end;
    const std::vector<Eigen::Vector3f> window_m(
        points_m.begin() + static_cast<std::ptrdiff_t>(begin),
        points_m.begin() + static_cast<std::ptrdiff_t>(end));
    const Clustering clustering = Cluster(window_m, config);
    labels.insert(labels.end(), clustering.labels.begin(), clustering.labels.end());
    begin = end;
  }
  return labels;
}

// Keeps the returns of the most frequent label, the lowest of equals; none if all are noise.
void KeepLargest(const std::vector<std::int32_t>& labels, std::vector<std::uint32_t>& returns) {
  std::map<std::int32_t, std::size_t> sizes;
  for (const std::uint32_t i : returns) {
    if (labels[i] != kNoise) ++sizes[labels[i]];
  }
  std::int32_t largest = kNoise;
  for (const auto& [label, size] : sizes) {
    if (largest == kNoise || size > sizes[largest]) largest = label;
  }
  EraseIf(&returns, [&](std::uint32_t i) { return largest == kNoise || labels[i] != largest; });
}

Clusters FindClusters(const Recording& recording, const PaperConfig& config) {
  Clusters clusters;
  clusters.frame_of = FrameOfReturns(recording);
  std::vector<std::uint32_t> window_of = clusters.frame_of;
  for (std::uint32_t& window : window_of) {
    window /= static_cast<std::uint32_t>(config.window_frames);
  }
  const Clustering global = Cluster(recording.points_m, config.global_clusters);
  clusters.globals.resize(static_cast<std::size_t>(global.num_clusters));
  for (std::uint32_t i = 0; i < global.labels.size(); ++i) {
    if (global.labels[i] == kNoise) continue;
    GlobalCluster& cluster = clusters.globals[static_cast<std::size_t>(global.labels[i])];
    cluster.returns.push_back(i);
    if (cluster.locals.empty() || cluster.locals.back().window != window_of[i]) {
      cluster.locals.push_back({window_of[i], {}});
    }
    cluster.locals.back().returns.push_back(i);
  }
  if (config.local == LocalClusters::kLargestOfWindow) {
    const auto labels = LabelWindows(recording.points_m, window_of, config.local_clusters);
    for (GlobalCluster& cluster : clusters.globals) {
      std::vector<LocalCluster> kept;
      for (LocalCluster& local : cluster.locals) {
        KeepLargest(labels, local.returns);
        if (!local.returns.empty()) kept.push_back(std::move(local));
      }
      cluster.locals = std::move(kept);
    }
  }
  return clusters;
}

// Calls visit(frame, returns) for the returns of each frame in turn.
template <typename Visit>
void VisitFrames(const std::vector<std::uint32_t>& returns,
                 const std::vector<std::uint32_t>& frame_of, Visit visit) {
  for (std::size_t begin = 0; begin < returns.size();) {
    const std::uint32_t frame = frame_of[returns[begin]];
    std::size_t end = begin + 1;
    while (end < returns.size() && frame_of[returns[end]] == frame) ++end;
    visit(frame, IndexView(returns.data() + begin, end - begin));
    begin = end;
  }
}

VoxelSet Voxels(const Recording& recording, const std::vector<std::uint32_t>& returns,
                double voxel_size_m) {
  std::vector<VoxelKey> keys;
  keys.reserve(returns.size());
  for (const std::uint32_t i : returns)
    keys.push_back(VoxelOf(recording.points_m[i], voxel_size_m));
  return SortedUnique(std::move(keys));
}

// Sets the position, extent and time span of a cluster.
void Describe(const Recording& recording, const Clusters& clusters, const GlobalCluster& cluster,
              ClusterScore& score) {
  score.size = static_cast<std::int64_t>(cluster.returns.size());
  Eigen::AlignedBox3d box_m;
  for (const std::uint32_t i : cluster.returns) box_m.extend(recording.points_m[i].cast<double>());
  score.extent_m = box_m.sizes();
  score.centroid_m = MeanOf(recording, cluster.returns);
  score.first_ns = recording.frames[clusters.frame_of[cluster.returns.front()]].stamp_ns;
  score.last_ns = recording.frames[clusters.frame_of[cluster.returns.back()]].stamp_ns;
  std::vector<Eigen::Vector3d> centroids_m;
  VisitFrames(cluster.returns, clusters.frame_of, [&](std::uint32_t, const IndexView& returns) {
    centroids_m.push_back(MeanOf(recording, returns));
  });
  score.frames = static_cast<int>(centroids_m.size());
  score.von_neumann_ratio = VonNeumannRatio(centroids_m);
}

// Evaluates the paper's equations in order.
void Score(const Recording& recording, const PaperConfig& config, const GlobalCluster& cluster,
           ClusterScore& score) {
  score.volume_m3 = VoxelVolumeM3(Voxels(recording, cluster.returns, config.voxel_size_m).size(),
                                  config.voxel_size_m);
  score.merged_density_per_m3 = Density(cluster.returns.size(), score.volume_m3);

  std::vector<double> volumes_m3, densities_per_m3, relative_densities, ious;
  std::vector<double> density_summands, iou_summands;
  VoxelSet previous;
  for (std::size_t i = 0; i < cluster.locals.size(); ++i) {
    const LocalCluster& local = cluster.locals[i];
    VoxelSet voxels = Voxels(recording, local.returns, config.voxel_size_m);
    volumes_m3.push_back(VoxelVolumeM3(voxels.size(), config.voxel_size_m));
    densities_per_m3.push_back(Density(local.returns.size(), volumes_m3.back()));
    relative_densities.push_back(RelativeDensity(
        densities_per_m3.back(), score.merged_density_per_m3, config.density_reading));
    density_summands.push_back(DensitySummand(relative_densities.back(), config.density_term));
    if (i > 0) {
      const bool gap = local.window > cluster.locals[i - 1].window + 1;
      if (gap && config.empty_windows == EmptyWindows::kZeroIou) {
        ious.insert(ious.end(), 2, 0.0);  // one at each end of the gap
      } else {
        ious.push_back(VoxelIou(previous, voxels));
      }
    }
    previous = std::move(voxels);
  }
  for (const double iou : ious) {
    iou_summands.push_back(IouSummand(iou, config.iou_term, config.min_iou));
  }
  score.windows = static_cast<int>(cluster.locals.size());
  score.pairs = static_cast<int>(ious.size());
  score.eligible = score.windows >= config.min_windows;
  score.local_volume_m3 = Accumulate(volumes_m3, Accumulation::kMean);
  score.local_density_per_m3 = Accumulate(densities_per_m3, Accumulation::kMean);
  score.relative_density = Accumulate(relative_densities, Accumulation::kMean);
  score.iou = Accumulate(ious, Accumulation::kMean);
  score.psi_iou = Accumulate(iou_summands, config.accumulation);
  score.psi_rho = Accumulate(density_summands, config.accumulation);
  score.psi = Psi(score.psi_rho, score.psi_iou, config.lambda);
}

std::vector<ClusterScore> ScoreAll(const Recording& recording, const PaperConfig& config,
                                   const Clusters& clusters) {
  std::vector<ClusterScore> scores(clusters.globals.size());
  for (std::size_t k = 0; k < scores.size(); ++k) {
    scores[k].id = static_cast<std::int32_t>(k);
    Describe(recording, clusters, clusters.globals[k], scores[k]);
    Score(recording, config, clusters.globals[k], scores[k]);
  }
  std::stable_sort(scores.begin(), scores.end(), [](const ClusterScore& a, const ClusterScore& b) {
    return a.eligible != b.eligible ? a.eligible : a.psi > b.psi;
  });
  for (std::size_t i = 0; i < scores.size(); ++i) scores[i].rank = static_cast<int>(i) + 1;
  return scores;
}

// Scatter within frames is pooled over the whole target: single frames of a distant drone hold one
// or two returns, too few for a covariance of their own.
Target MakeTarget(const Recording& recording, const PaperConfig& config, const Clusters& clusters,
                  const GlobalCluster& cluster) {
  Target target;
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();
  for (const LocalCluster& local : cluster.locals) {
    target.returns.insert(target.returns.end(), local.returns.begin(), local.returns.end());
    VisitFrames(
        local.returns, clusters.frame_of, [&](std::uint32_t frame, const IndexView& returns) {
          Measurement measurement;
          measurement.support = static_cast<int>(returns.size());
          measurement.position_m = MeanOf(recording, returns);
          const TimeNs reference_ns = recording.frames[frame].stamp_ns;
          double offset_ns = 0.0;
          for (const std::uint32_t i : returns) {
            offset_ns += static_cast<double>(recording.times_ns[i] - reference_ns);
            const Eigen::Vector3d residual_m =
                recording.points_m[i].cast<double>() - measurement.position_m;
            scatter_m2 += residual_m * residual_m.transpose();
          }
          measurement.time_ns = reference_ns + std::llround(offset_ns / measurement.support);
          target.measurements.push_back(measurement);
        });
  }
  const auto freedom =
      static_cast<double>(target.returns.size()) - static_cast<double>(target.measurements.size());
  if (freedom > 0.0) scatter_m2 /= freedom;
  const Eigen::Matrix3d of_one_return_m2 =
      scatter_m2 + config.return_sigma_m * config.return_sigma_m * Eigen::Matrix3d::Identity();
  for (Measurement& measurement : target.measurements) {
    measurement.covariance_m2 = of_one_return_m2 / measurement.support;
  }
  // Point times may overlap between the frames of several sensors.
  std::stable_sort(target.measurements.begin(), target.measurements.end(),
                   By(&Measurement::time_ns));
  return target;
}

}  // namespace

double RelativeDensity(double local_per_m3, double merged_per_m3, DensityReading reading) {
  if (reading == DensityReading::kFrameOverMerged) return local_per_m3 / merged_per_m3;
  if (reading == DensityReading::kMergedOverFrame) return merged_per_m3 / local_per_m3;
  return std::abs(local_per_m3 - merged_per_m3) / merged_per_m3;
}

double DensitySummand(double relative_density, DensityTerm term) {
  constexpr double kLargestExponent = 600.0;
  return term == DensityTerm::kLinear ? relative_density
                                      : std::exp(std::min(relative_density, kLargestExponent));
}

double IouSummand(double iou, IouTerm term, double min_iou) {
  if (term == IouTerm::kComplement) return 1.0 - iou;
  const double floored = std::max(iou, min_iou);
  return term == IouTerm::kLogarithm ? -std::log(floored) : 1.0 / floored;
}

double Accumulate(const std::vector<double>& summands, Accumulation accumulation) {
  if (summands.empty()) return 0.0;
  double sum = 0.0;
  for (const double summand : summands) sum += summand;
  return accumulation == Accumulation::kSum ? sum : sum / static_cast<double>(summands.size());
}

double Psi(double psi_rho, double psi_iou, double lambda) { return psi_rho + lambda * psi_iou; }

double VonNeumannRatio(const std::vector<Eigen::Vector3d>& centroids_m) {
  constexpr double kOfWhiteJitter = 2.0;
  if (centroids_m.size() < 2) return kOfWhiteJitter;
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& c : centroids_m) mean_m += c;
  mean_m /= static_cast<double>(centroids_m.size());
  double steps_m2 = 0.0;
  double spread_m2 = (centroids_m[0] - mean_m).squaredNorm();
  for (std::size_t i = 1; i < centroids_m.size(); ++i) {
    steps_m2 += (centroids_m[i] - centroids_m[i - 1]).squaredNorm();
    spread_m2 += (centroids_m[i] - mean_m).squaredNorm();
  }
  // Both are means over n - 1. A spread below a nanometre is rounding error.
  return spread_m2 > 1e-18 ? steps_m2 / spread_m2 : kOfWhiteJitter;
}

std::vector<ClusterScore> ScoreClusters(const Recording& recording, const PaperConfig& config) {
  return ScoreAll(recording, config, FindClusters(recording, config));
}

std::vector<Target> FindTargetsPaper(const Recording& recording, const PaperConfig& config,
                                     std::vector<ClusterScore>* scores) {
  const Clusters clusters = FindClusters(recording, config);
  const std::vector<ClusterScore> ranked = ScoreAll(recording, config, clusters);
  if (scores != nullptr) *scores = ranked;
  if (ranked.empty() || !ranked.front().eligible) return {};
  const auto winner = static_cast<std::size_t>(ranked.front().id);
  Target target = MakeTarget(recording, config, clusters, clusters.globals[winner]);
  target.score = ranked.front().psi;
  return {target};
}

}  // namespace unlidar
