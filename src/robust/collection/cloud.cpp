#include "robust/collection/cloud.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <utility>

#include "robust/collection/collect.hpp"
#include "robust/scene/range_grid.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {
namespace {

// Standard deviation per axis across the motion: a quarter of its width for a flat disc from above.
// Drones of 0.8 m have 0.18 m, puffs of steam mostly 0.3 to 0.6 m.
constexpr double kWidestDroneM = 0.35;
// What is as near to a target may be part of it. Strays are counted between the other two.
constexpr double kNearM = 1.6;
constexpr double kStraysFromM = 3.0;
constexpr double kStraysToM = 6.0;
// What is lower may stand on the ground.
constexpr double kInTheAirM = 2.0;
// The returns of a frame count as so many at most: what is beside a target in a single frame is no
// part of it, however much that is.
constexpr double kMostOfFrame = 5.0;
// A piece of a cloud is as near as this to what some cloud returns at some time, for so much of its
// own time, and goes the same way: with the wind, give or take the whirls in it.
constexpr RangeRadius kReach{2.0, 0.02};
constexpr double kPieceShare = 0.5;
constexpr double kWhirlMps = 0.8;
constexpr double kWhirlShare = 0.7;

// Returns, and the sum of their squared distances from a target across its motion, per axis.
struct Tally {
  double count = 0.0;
  double sum_m2 = 0.0;

  void Add(const Tally& more, double weight = 1.0) {
    count += weight * more.count;
    sum_m2 += weight * more.sum_m2;
  }
};

// Something in motion.
struct Mover {
  Eigen::Vector3d position_m;
  Eigen::Vector3d velocity_mps;
};

// What a target looks like along its way.
class Shape {
 public:
  Shape(const Recording& recording, const std::vector<SensorView>& views,
        const std::vector<Plot>& plots, const Target& target, const TrajectoryConfig& config)
      : recording_(recording), views_(views), target_(target) {
    const Trajectory trajectory = FitTrajectory(target.measurements, config);
    auto own = target.returns.begin();
    for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
      const FrameInfo& frame = recording.frames[f];
      const TimeNs time_ns = frame.middle_ns();
      if (time_ns < trajectory.begin_ns() || time_ns > trajectory.end_ns()) continue;
      own = std::lower_bound(own, target.returns.end(), frame.first_return);
      const auto end = std::lower_bound(own, target.returns.end(), frame.last_return);
      std::vector<std::uint32_t> returns(own, end);
      auto plot = std::lower_bound(plots.begin(), plots.end(), time_ns, IsEarlier);
      for (; plot != plots.end() && plot->frame_time_ns == time_ns; ++plot) {
        if (plot->frame != f || plot->lowest_m < kInTheAirM) continue;
        std::set_difference(plot->returns.begin(), plot->returns.end(), own, end,
                            std::back_inserter(returns));
      }
      if (!returns.empty()) Add(frame, trajectory.At(time_ns), returns);
    }
  }

  // Standard deviation per axis, across the motion, of all that is about the target but for strays.
  double SpreadM() const {
    constexpr double kMeanSquareInBall = 0.2;  // per axis across the motion, of its radius squared
    const double strays = strays_ * Cube(kNearM) / (Cube(kStraysToM) - Cube(kStraysFromM));
    Tally body = near_;
    body.Add({1.0, kMeanSquareInBall * kNearM * kNearM}, -strays);
    body = {std::max(body.count, 0.0), std::max(body.sum_m2, 0.0)};
    body.Add(own_);
    return body.count > 0.0 ? std::sqrt(body.sum_m2 / body.count) : 0.0;
  }

  // Whether it is where another one is at some time, and goes the same way, for most of its own.
  bool IsPieceOf(const std::vector<const Shape*>& clouds) const {
    const auto is_in_cloud = [&](const Mover& at) {
      const double reach_m = kReach.At(at.position_m.norm());
      return std::any_of(clouds.begin(), clouds.end(), [&](const Shape* cloud) {
        return std::any_of(cloud->returns_.begin(), cloud->returns_.end(), [&](const Mover& part) {
          return (part.position_m - at.position_m).squaredNorm() < reach_m * reach_m &&
                 (part.velocity_mps - at.velocity_mps).norm() <
                     kWhirlMps + kWhirlShare * part.velocity_mps.norm();
        });
      });
    };
    const auto num_in = std::count_if(way_.begin(), way_.end(), is_in_cloud);
    return static_cast<double>(num_in) > kPieceShare * static_cast<double>(way_.size());
  }

 private:
  static double Cube(double x) { return x * x * x; }
  static bool IsEarlier(const Plot& plot, TimeNs time_ns) { return plot.frame_time_ns < time_ns; }

  void Add(const FrameInfo& frame, const TrajectoryRow& at,
           const std::vector<std::uint32_t>& returns) {
    const Eigen::Vector3d along = at.velocity_mps.stableNormalized();
    const Eigen::Vector3d ray_m = at.position_m - views_[frame.sensor].viewpoint_m.cast<double>();
    const double beam_m2 = kBeamSigmaRad * kBeamSigmaRad * ray_m.squaredNorm();
    Tally own;
    Tally near;
    double strays = 0.0;
    for (const std::uint32_t i : returns) {
      const Eigen::Vector3d return_m = recording_.points_m[i].cast<double>();
      const double later_s =
          static_cast<double>(recording_.times_ns[i] - at.time_ns) * kSecondsPerNs;
      const Eigen::Vector3d off_m = return_m - at.position_m - later_s * at.velocity_mps;
      const double distance_m = off_m.norm();
      const bool is_own = std::binary_search(target_.returns.begin(), target_.returns.end(), i);
      if (is_own || distance_m < kNearM) {
        const double across_m2 = 0.5 * (off_m - off_m.dot(along) * along).squaredNorm();
        (is_own ? own : near).Add({1.0, std::max(across_m2 - beam_m2, 0.0)});
        returns_.push_back({return_m, at.velocity_mps});
      } else if (distance_m > kStraysFromM && distance_m < kStraysToM) {
        strays += 1.0;
      }
    }
    const double weight = kMostOfFrame / std::max(kMostOfFrame, own.count + near.count);
    own_.Add(own, weight);
    near_.Add(near, weight);
    strays_ += weight * strays;
    way_.push_back({at.position_m, at.velocity_mps});
  }

  const Recording& recording_;
  const std::vector<SensorView>& views_;
  const Target& target_;
  Tally own_;
  Tally near_;  // of others
  double strays_ = 0.0;
  std::vector<Mover> way_;      // in the frames that show something about it
  std::vector<Mover> returns_;  // its own and those near it
};

}  // namespace

std::vector<Target> WithoutClouds(const Recording& recording, const std::vector<SensorView>& views,
                                  const std::vector<Plot>& plots, std::vector<Target> targets,
                                  const TrajectoryConfig& config) {
  std::vector<Shape> shapes;
  shapes.reserve(targets.size());
  for (const Target& target : targets) {
    shapes.emplace_back(recording, views, plots, target, config);
  }
  std::vector<const Shape*> clouds;
  std::vector<char> are_clouds(targets.size(), 0);
  const auto is_cloud = [&](const Shape& shape) {
    return shape.SpreadM() > kWidestDroneM || shape.IsPieceOf(clouds);
  };
  for (std::size_t before = targets.size() + 1; before != clouds.size();) {
    before = clouds.size();
    for (std::size_t t = 0; t < targets.size(); ++t) {
      if (are_clouds[t] != 0 || !is_cloud(shapes[t])) continue;
      are_clouds[t] = 1;
      clouds.push_back(&shapes[t]);
    }
  }
  std::vector<Target> kept;
  for (std::size_t t = 0; t < targets.size(); ++t) {
    if (are_clouds[t] == 0) kept.push_back(std::move(targets[t]));
  }
  return kept;
}

}  // namespace unlidar
