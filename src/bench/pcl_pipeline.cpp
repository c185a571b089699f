// What one would put together from PCL's parts to follow drones, to compare with: its reader,
// octree change detection, Euclidean clusters, and a Kalman filter of constant velocity with the
// nearest neighbour for each track.
//   pcl_pipeline OUT FRAMES_DIR...
// Frames are files STAMP.pcd, their stamps in seconds. Writes timestamp,track_id,x,y,z.
#include <pcl/common/centroid.h>
#include <pcl/io/pcd_io.h>
#include <pcl/octree/octree_pointcloud_occupancy.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

// Hand-tuned on the simulated scenes `near`, `mid` and `two`, seed 1.
constexpr double kVoxel_m = 1.0;  // of the change detection
constexpr double kDelay_s = 2.0;  // older returns make the background
constexpr double kWarmUp_s = 3.0;
constexpr double kMinRange_m = 0.5;   // nearer is the station itself
constexpr double kMinHeight_m = 0.5;  // above the sensor: no people, no cars
constexpr double kTolerance_m = 0.6;  // of the clusters
constexpr int kMaxClusterSize = 300;
constexpr double kGate_m2 = 16.0;  // squared Mahalanobis distance
constexpr double kMeasurementSigma_m = 0.2;
constexpr double kAccelerationSigma_mps2 = 4.0;
constexpr double kBirthSpeed_mps = 5.0;
constexpr int kHitsToConfirm = 8;
constexpr double kMaxMiss_s = 1.0;

struct FrameFile {
  double time_s = 0.0;
  std::size_t sensor = 0;
  std::string path;
};

std::vector<FrameFile> ListFrames(const std::vector<std::string>& folders) {
  std::vector<FrameFile> frames;
  for (std::size_t sensor = 0; sensor < folders.size(); ++sensor) {
    for (const auto& entry : std::filesystem::directory_iterator(folders[sensor])) {
      if (entry.path().extension() != ".pcd") continue;
      frames.push_back({std::stod(entry.path().stem().string()), sensor, entry.path().string()});
    }
  }
  std::sort(frames.begin(), frames.end(), [](const FrameFile& a, const FrameFile& b) {
    return std::make_pair(a.time_s, a.sensor) < std::make_pair(b.time_s, b.sensor);
  });
  return frames;
}

Cloud::Ptr ReadReturns(const std::string& path) {
  Cloud read;
  pcl::io::loadPCDFile(path, read);
  Cloud::Ptr cloud(new Cloud);
  for (const pcl::PointXYZ& p : read) {
    const float range_m = p.getVector3fMap().norm();
    if (std::isfinite(range_m) && range_m > kMinRange_m) cloud->push_back(p);
  }
  return cloud;
}

// Which returns of a frame lie in voxels that were empty until a second ago. By an octree of the
// background, in which they are looked up: PCL's change detector would have to be filled with the
// background anew for each frame (of its two buffers none can be emptied and filled again: returns
// of earlier frames come back as new).
class ChangeDetection {
 public:
  // Nothing at the beginning, while all is new.
  Cloud::Ptr Changed(double time_s, const Cloud::Ptr& cloud) {
    recent_.emplace_back(time_s, cloud);
    while (recent_.front().first < time_s - kDelay_s) {
      background_.setOccupiedVoxelsAtPointsFromCloud(recent_.front().second);
      recent_.pop_front();
    }
    Cloud::Ptr changed(new Cloud);
    if (!begin_s_) begin_s_ = time_s;
    if (time_s - *begin_s_ < kWarmUp_s) return changed;
    for (const pcl::PointXYZ& p : *cloud) {
      if (p.z > kMinHeight_m && !background_.isVoxelOccupiedAtPoint(p)) changed->push_back(p);
    }
    return changed;
  }

 private:
  pcl::octree::OctreePointCloudOccupancy<pcl::PointXYZ> background_{kVoxel_m};
  std::deque<std::pair<double, Cloud::Ptr>> recent_;
  std::optional<double> begin_s_;
};

std::vector<Eigen::Vector3d> ClusterCentres(const Cloud::Ptr& cloud) {
  std::vector<Eigen::Vector3d> centres_m;
  if (cloud->empty()) return centres_m;
  pcl::search::KdTree<pcl::PointXYZ>::Ptr tree(new pcl::search::KdTree<pcl::PointXYZ>);
  tree->setInputCloud(cloud);
  pcl::EuclideanClusterExtraction<pcl::PointXYZ> extraction;
  extraction.setClusterTolerance(kTolerance_m);
  extraction.setMaxClusterSize(kMaxClusterSize);
  extraction.setSearchMethod(tree);
  extraction.setInputCloud(cloud);
  std::vector<pcl::PointIndices> clusters;
  extraction.extract(clusters);
  for (const pcl::PointIndices& cluster : clusters) {
    Eigen::Vector4d centre_m;
    pcl::compute3DCentroid(*cloud, cluster, centre_m);
    centres_m.emplace_back(centre_m.head<3>());
  }
  return centres_m;
}

// The filter of one target: position and velocity, the same covariance on every axis.
struct Track {
  int id = -1;  // until it is confirmed
  int hits = 1;
  double time_s = 0.0;
  double seen_s = 0.0;
  Eigen::Matrix<double, 2, 3> state = Eigen::Matrix<double, 2, 3>::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();

  void Predict(double to_s) {
    const double dt_s = to_s - time_s;
    Eigen::Matrix2d step;
    step << 1.0, dt_s, 0.0, 1.0;
    const Eigen::Vector2d push(0.5 * dt_s * dt_s, dt_s);
    state = step * state;
    covariance = step * covariance * step.transpose() +
                 kAccelerationSigma_mps2 * kAccelerationSigma_mps2 * push * push.transpose();
    time_s = to_s;
  }
  double InnovationVariance() const {
    return covariance(0, 0) + kMeasurementSigma_m * kMeasurementSigma_m;
  }
  double SquaredDistance(const Eigen::Vector3d& p_m) const {
    return (p_m.transpose() - state.row(0)).squaredNorm() / InnovationVariance();
  }
  void Update(const Eigen::Vector3d& p_m) {
    const Eigen::Vector2d gain = covariance.col(0) / InnovationVariance();
    state += gain * (p_m.transpose() - state.row(0));
    covariance -= gain * covariance.row(0).eval();
    seen_s = time_s;
    ++hits;
  }
};

class Tracks {
 public:
  void Take(double time_s, std::vector<Eigen::Vector3d> centres_m) {
    for (Track& track : tracks_) track.Predict(time_s);
    // The oldest track chooses first.
    for (Track& track : tracks_) {
      const auto nearest =
          std::min_element(centres_m.begin(), centres_m.end(), [&](const auto& a, const auto& b) {
            return track.SquaredDistance(a) < track.SquaredDistance(b);
          });
      if (nearest == centres_m.end() || track.SquaredDistance(*nearest) > kGate_m2) continue;
      track.Update(*nearest);
      centres_m.erase(nearest);
      if (track.id < 0 && track.hits >= kHitsToConfirm) track.id = next_id_++;
    }
    tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                                 [&](const Track& track) {
                                   const double limit_s = track.id < 0 ? 0.3 : 1.0;
                                   return time_s - track.seen_s > limit_s * kMaxMiss_s;
                                 }),
                  tracks_.end());
    for (const Eigen::Vector3d& centre_m : centres_m) Begin(time_s, centre_m);
  }

  void Write(std::ostream& out) const {
    for (const Track& track : tracks_) {
      if (track.id < 0) continue;
      out << std::fixed << std::setprecision(9) << track.time_s << "," << track.id
          << std::setprecision(6) << "," << track.state(0, 0) << "," << track.state(0, 1) << ","
          << track.state(0, 2) << "\n";
    }
  }

 private:
  void Begin(double time_s, const Eigen::Vector3d& centre_m) {
    Track track;
    track.time_s = track.seen_s = time_s;
    track.state.row(0) = centre_m.transpose();
    track.covariance.diagonal() << kMeasurementSigma_m * kMeasurementSigma_m,
        kBirthSpeed_mps * kBirthSpeed_mps;
    tracks_.push_back(track);
  }

  std::vector<Track> tracks_;
  int next_id_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::cerr << "usage: pcl_pipeline OUT FRAMES_DIR...\n";
    return 2;
  }
  std::ofstream out(argv[1]);
  out << "timestamp,track_id,x,y,z\n";
  ChangeDetection change;
  Tracks tracks;
  for (const FrameFile& frame : ListFrames({argv + 2, argv + argc})) {
    const Cloud::Ptr changed = change.Changed(frame.time_s, ReadReturns(frame.path));
    tracks.Take(frame.time_s, ClusterCentres(changed));
    if (frame.sensor == 0) tracks.Write(out);
  }
  return out.flush() ? 0 : 5;
}
