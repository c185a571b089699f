// What flies, but is no drone by its size: clouds of steam, smoke, dust; insects.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/station_model.hpp"
#include "tracking/rejection.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// What is lower may stand on the ground, and tells nothing of what is about a target in the air.
constexpr double kInTheAirM = 2.0;

// Returns of one frame that lie together, or a single one.
struct ReturnCluster {
  TimeNs time_ns = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // their mean
  bool is_own = false;                                   // of the target that is judged
  double num_returns = 1.0;
  const Eigen::Matrix3d* scatter_m2 = nullptr;  // sum over them, about the mean; none for one
};

// What a target looks like along its way, and whether that is a cloud or an insect.
class Shape {
 public:
  // A frame: the target at its middle, seen from a viewpoint, and what the frame shows in the air.
  void Add(const TrajectoryRow& at, const Eigen::Vector3d& viewpoint_m,
           const std::vector<ReturnCluster>& clusters);

  // Whether it lies wider than a drone, or is a piece of one of these clouds.
  bool IsCloud(const std::vector<const Shape*>& clouds) const;

  // Whether the returns of a frame lie closer together than those of any drone do.
  bool IsInsect() const;

  // Whether it lies so wide that it may be a piece of a cloud that is still small.
  bool MayBeCloud() const;

  // Of nothing yet.
  void Clear();

 private:
  // Returns, and the sum of their squared distances from the target across its motion, per axis.
  struct Tally {
    double count = 0.0;
    double sum_m2 = 0.0;

    void Add(const Tally& more, double weight = 1.0) {
      count += weight * more.count;
      sum_m2 += weight * more.sum_m2;
    }
  };

  // Something in motion.
  struct MotionState {
    Eigen::Vector3d position_m;
    Eigen::Vector3d velocity_mps;
  };

  // Standard deviation per axis, across the motion, of all that is about the target but for strays.
  double SpreadM() const;

  // Whether it is where another one is at some time, and goes the same way, for most of its own.
  bool IsPieceOf(const std::vector<const Shape*>& clouds) const;

  Tally own_;
  Tally near_;    // of others
  Tally within_;  // its own beside the first of each frame, about the means of the frames
  double strays_ = 0.0;
  std::vector<MotionState> path_;     // in the frames that show something about it
  std::vector<MotionState> returns_;  // its own and those near it
};

// (targets) Which are clouds: what is about them at the same time, beyond what strays farther about
// them explain, lies wider than any drone. A cloud comes in many pieces, one after
// another on nearly the same way, and while they are small they look like drones: so what stays
// where a cloud is at some time is a piece of it. And the insects: their returns of a frame lie
// closer together than those of any drone. `plots` in order of time; `station_models`: (sensors).
std::vector<Rejection> ShapeRejections(const Recording& recording,
                                       const std::vector<StationModel>& station_models,
                                       const std::vector<Plot>& plots,
                                       const std::vector<Target>& targets,
                                       const RobustConfig& config,
                                       const TrajectoryConfig& trajectory_config);

}  // namespace unlidar
