// Rejects flying targets that are no drones by their size: clouds of steam, smoke and dust;
// insects.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/maths.hpp"
#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/stations.hpp"
#include "tracking/rejection.hpp"
#include "trajectory/trajectory.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// By then a part of a cloud that was as small as a drone has grown or is gone.
constexpr double kGrowsWithinS = 3.0;

// A cluster of returns of one frame, or a single return.
struct ReturnCluster {
  TimeNs time_ns = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // their mean
  bool is_own = false;                                   // of the target under test
  double num_returns = 1.0;
  // Scatter of its returns about their mean: sums of products, if its own less what the target
  // moves meanwhile.
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();
};

// Extent of a target and of the returns about it along its trajectory.
class Shape {
 public:
  explicit Shape(const RobustConfig& config)
      : uses_growth_(config.Uses(Rule::kGrowth)),
        uses_volume_(config.Uses(Rule::kVolumeScattering)) {}

  // Adds a frame. `at`: the target at its middle; `clusters`: the returns of the frame in the air;
  // `streak_m2`: of the frame, see StreakM2().
  void Add(const TrajectoryRow& at, const Eigen::Vector3d& viewpoint_m,
           const Eigen::Matrix3d& streak_m2, const std::vector<ReturnCluster>& clusters);

  // True if it is wider than any drone, scatters as a volume, grows, or is a piece of one of these
  // clouds.
  bool IsCloud(const std::vector<const Shape*>& clouds) const;

  // True if its returns lie closer together than those of any drone.
  bool IsInsect() const;

  // True if it is wide enough to be a piece of a cloud that is still small, or seems to grow or to
  // scatter as a volume.
  bool MayBeCloud() const;

  // True if it is certainly narrow, and nothing hints at a cloud.
  bool IsCertainlyNoCloud() const { return StaysNarrow() && !MayBeCloud(); }

  // Removes all frames.
  void Clear();

 private:
  // Number of returns, and the sum of their squared distances from the target across its motion,
  // per axis.
  struct Tally {
    double count = 0.0;
    double sum_m2 = 0.0;

    void Add(const Tally& more, double weight = 1.0) {
      count += weight * more.count;
      sum_m2 += weight * more.sum_m2;
    }
    double MeanM2() const { return count > 0.0 ? sum_m2 / count : 0.0; }
  };

  // Position and velocity at one time.
  struct MotionState {
    Eigen::Vector3d position_m;
    Eigen::Vector3d velocity_mps;
  };

  // Own returns of one frame.
  struct OwnFrame {
    TimeNs time_ns;
    Tally tally;
    double freedom;  // that it adds to Volume
  };

  // Spread of the own returns of each frame about their mean, summed over the frames.
  struct Volume {
    // Along the ray, horizontally and upwards across it: what regression on the other two leaves.
    Eigen::Array3d residual_m2 = Eigen::Array3d::Zero();
    double residual_freedom = 0.0;
    double squared_freedom = 0.0;  // by the squares of the weights
    double scatter_m2 = 0.0;       // all axes together
    double scatter_freedom = 0.0;

    // `frame_m2`: scatter of the `count` returns of a frame, in ray axes. Returns what it adds to
    // residual_freedom.
    double Add(const Eigen::Matrix3d& frame_m2, const Eigen::Array3d& noise_m2, double count,
               double weight);
  };

  // Own returns in each third of the time in which there were any.
  struct Thirds {
    Tally first;
    Tally middle;
    Tally last;
    double observed_s = 0.0;
  };

  Thirds ThirdsOfOwn() const;

  // True if the squared width has grown steadily: in the last third it is, by two standard errors,
  // more than `ratio` times that in the first, and in the middle third it is on the way.
  bool HasGrown(double ratio) const;

  // True if the frames that add to Volume are spread over the time of the target.
  bool IsToldThroughout() const;

  // True if its returns fill a volume, whichever way it is looked at, by this number of standard
  // errors: it is seen into. Those of a body lie on its skin.
  bool ScattersAsVolume(double sigmas) const;

  // True if it was watched for as long as a cloud takes to grow, and is certainly still narrow.
  bool StaysNarrow() const;

  // Standard deviation per axis, across the motion, of all returns about the target, corrected for
  // strays.
  double SpreadM() const;

  // True if most of its path lies near returns of a cloud, at any time, with a similar velocity.
  bool IsPartOf(const std::vector<const Shape*>& clouds) const;

  bool uses_growth_;
  bool uses_volume_;
  std::vector<OwnFrame> own_;
  Volume volume_;
  Tally near_;                     // other returns near it
  Tally within_;                   // own returns less one per frame, about the means of the frames
  double strays_ = 0.0;            // all about it
  double strays_before_ = 0.0;     // of these, on the rays to what is near
  std::vector<MotionState> path_;  // in the frames with returns about it
  std::vector<MotionState> returns_;  // own returns and those near it
};

// Returns kCloud, kInsect or kNone (targets). Cloud: the returns about the target at the same time,
// less the strays expected from farther about it, are wider than any drone. A cloud comes in many
// pieces, one after another on nearly the same path, which look like drones while they are small; a
// target that stays where a cloud is at any time is therefore a piece of it, unless it stays narrow
// for longer than they do. A cloud is also what grows, or scatters throughout its volume, as a body
// does not. Insect: the returns of a frame are closer together than those of any drone. `plots`: in
// order of time; `station_models`: (sensors).
std::vector<Rejection> ShapeRejections(const Recording& recording,
                                       const std::vector<StationModel>& station_models,
                                       const std::vector<Plot>& plots,
                                       const std::vector<Target>& targets,
                                       const RobustConfig& config);

// True if a target of a recording is certainly no cloud, nor a part of one; the others are as in
// ShapeRejections(). Never true without the rule on growth, which tells how small a cloud can stay.
bool IsCertainlyNoCloud(const Recording& recording, const std::vector<StationModel>& station_models,
                        const std::vector<Plot>& plots, const Target& target,
                        const RobustConfig& config);

}  // namespace unlidar
