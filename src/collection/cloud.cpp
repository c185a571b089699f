#include "collection/cloud.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>

#include "collection/body.hpp"
#include "scene/range_grid.hpp"

namespace unlidar {
namespace {

// Standard deviation per axis across the motion: a quarter of the width for a flat disc seen from
// above. Drones of 0.8 m have 0.18 m, puffs of steam mostly 0.3 to 0.6 m.
constexpr double kWidestDroneM = 0.35;
// Half way between drones and puffs of steam: no narrower target has been a piece of one.
constexpr double kCertainDroneM = 0.25;
// A cloud spreads, a body does not. Dust that is watched for some seconds has 0.2 m and more in its
// last third. Drones of 0.6 m and less have 0.1 m at most, of which noise and the fit, that may
// grow as well, are a part.
constexpr double kGrownM = 0.15;
// Flat drones of 1.6 m grow by this ratio of squared widths as they turn and are seen from other
// sides. A few of them, in streams, grow by up to 3 within seconds; with 3 half of the dust that
// this finds would be missed.
constexpr double kGrowthOfViews = 2.0;
constexpr double kGrowthSigmas = 2.0;
// Part of the growth, of the logarithm, that the middle third has: more than half of it if the
// width grows linearly. A drone that enters a cloud at the end, or whose path does, has nothing of
// it.
constexpr double kMiddleShare = 1.0 / 3.0;
// The smallest drones are 8 cm wide: 0.023 m. An insect of 3 cm has 0.01 m and the angular noise
// near the sensor, drones of 0.2 m and more have 0.05 to 0.15 m. With this number of returns, not
// counting the first of each frame, a drone of 0.05 m passes for an insect less often than 1 in
// 10,000.
constexpr double kNarrowestDroneM = 0.02;
constexpr double kEnoughReturns = 8.0;
// Least spread along any axis, given those along the others, and its square over the mean square of
// all axes. What scatters throughout its volume has a ratio of 1, the skin of a ball 0.3. Of 70
// flights none has more than 0.07 m, most of it noise of ranges; a multicopter of 0.8 m filled
// with returns would have 0.12 to 0.14 m. Dust has 0.1 to 0.3 m and ratios of 0.4 to 0.7.
constexpr double kVolumeM = 0.13;
constexpr double kVolumeRatio = 0.3;
constexpr double kVolumeSigmas = 2.0;
// A path may go on from a drone of a few returns to dust: the frames that tell must be spread over
// this share of the time of all, as standard deviations.
constexpr double kVolumeTimeShare = 0.5;
// Returns within kNearM of a target may be part of it. Strays are counted between the other two:
// all about it, and before it on the rays that go on to what is near. The edge of the view, ground
// and trees take some of the former, but at most as many as to leave this share of them.
constexpr double kNearM = 1.6;
constexpr double kStraysFromM = 3.0;
constexpr double kStraysToM = 6.0;
constexpr double kLeastShareInView = 1.0 / 3.0;
// Cap on the weight of a frame: returns beside a target in a single frame are no part of it,
// however many there are.
constexpr double kMaxReturnsOfFrame = 5.0;
// A piece of a cloud is within kReach of a return of some cloud, at any time, for at least this
// share of its path, and moves with the same velocity: the wind, up to the turbulence in it.
constexpr RangeRadius kReach{2.0, 0.02};
constexpr double kPieceShare = 0.5;
constexpr double kTurbulenceMps = 0.8;
constexpr double kTurbulenceShare = 0.7;

double Cube(double x) { return x * x * x; }

// Shape of a target of a recording, from its own returns and those about it.
Shape ShapeOf(const Recording& recording, const std::vector<StationModel>& station_models,
              const std::vector<Plot>& plots, const Target& target, const RobustConfig& config) {
  const Trajectory& trajectory = target.trajectory;
  Shape shape(config);
  std::vector<std::uint32_t> returns;
  std::vector<ReturnCluster> clusters;
  auto own = target.returns.begin();
  for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    const TimeNs time_ns = frame.middle_ns();
    if (time_ns < trajectory.begin_ns() || time_ns > trajectory.end_ns()) continue;
    own = std::lower_bound(own, target.returns.end(), frame.first_return);
    const auto end = std::lower_bound(own, target.returns.end(), frame.last_return);
    returns.assign(own, end);
    auto plot = FirstFrom(plots, &Plot::frame_time_ns, time_ns);
    for (; plot != plots.end() && plot->frame_time_ns == time_ns; ++plot) {
      if (plot->frame != f || plot->lowest_m < kPersonHeightM) continue;
      std::set_difference(plot->returns.begin(), plot->returns.end(), own, end,
                          std::back_inserter(returns));
    }
    if (returns.empty()) continue;
    clusters.clear();
    for (const std::uint32_t i : returns) {
      clusters.push_back({recording.times_ns[i], recording.points_m[i].cast<double>(),
                          std::binary_search(target.returns.begin(), target.returns.end(), i)});
    }
    const TrajectoryRow at = trajectory.At(time_ns);
    shape.Add(at, ViewpointM(station_models[frame.sensor], frame), StreakM2(frame, at.velocity_mps),
              clusters);
  }
  return shape;
}

}  // namespace

void Shape::Add(const TrajectoryRow& at, const Eigen::Vector3d& viewpoint_m,
                const Eigen::Matrix3d& streak_m2, const std::vector<ReturnCluster>& clusters) {
  const Eigen::Vector3d along = at.velocity_mps.stableNormalized();
  const Eigen::Vector3d ray_m = at.position_m - viewpoint_m;
  const double range_m = ray_m.norm();
  const Eigen::Vector3d ray = ray_m.stableNormalized();
  const double beam_m2 = kBeamSigmaRad * kBeamSigmaRad * range_m * range_m;
  Tally own;
  Tally near;
  double strays = 0.0;
  double strays_before = 0.0;
  Eigen::Vector3d own_sum_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d own_scatter_m2 = Eigen::Matrix3d::Zero();
  for (const ReturnCluster& cluster : clusters) {
    const double later_s = SecondsOf(cluster.time_ns - at.time_ns);
    const Eigen::Vector3d offset_m = cluster.position_m - at.position_m - later_s * at.velocity_mps;
    const double distance_m = offset_m.norm();
    if (cluster.is_own || distance_m < kNearM) {
      const Eigen::Vector3d offset_across_m = offset_m - offset_m.dot(along) * along;
      const double across_m2 =
          0.5 * (cluster.num_returns * offset_across_m.squaredNorm() + cluster.scatter_m2.trace() -
                 along.dot(cluster.scatter_m2 * along));
      if (cluster.is_own) {
        own_sum_m += cluster.num_returns * offset_m;
        own_scatter_m2 +=
            cluster.scatter_m2 + cluster.num_returns * offset_m * offset_m.transpose();
      }
      (cluster.is_own ? own : near)
          .Add({cluster.num_returns, std::max(across_m2 - cluster.num_returns * beam_m2, 0.0)});
      returns_.push_back({cluster.position_m, at.velocity_mps});
    } else if (distance_m > kStraysFromM && distance_m < kStraysToM) {
      strays += cluster.num_returns;
      const double depth_m = offset_m.dot(ray);
      const double beside_m = (offset_m - depth_m * ray).norm();
      // Rays spread: nearer to the viewpoint they are closer together.
      if (depth_m < -kStraysFromM && beside_m < kNearM * (1.0 + depth_m / range_m)) {
        strays_before += cluster.num_returns;
      }
    }
  }
  const double weight = kMaxReturnsOfFrame / std::max(kMaxReturnsOfFrame, own.count + near.count);
  if (own.count > 0.0) {
    own_scatter_m2 -= own_sum_m * own_sum_m.transpose() / own.count;
    const double across_m2 = own_scatter_m2.trace() - along.dot(own_scatter_m2 * along);
    within_.Add({own.count - 1.0, std::max(0.5 * across_m2, 0.0)});
    const Eigen::Matrix3d axes = RayAxes(ray_m);
    const double freedom = volume_.Add(
        axes.transpose() * own_scatter_m2 * axes,
        beam_m2 + (axes.transpose() * streak_m2 * axes).diagonal().array(), own.count, weight);
    own_.push_back({at.time_ns, Tally(), freedom});
    own_.back().tally.Add(own, weight);
  }
  near_.Add(near, weight);
  strays_ += weight * strays;
  strays_before_ += weight * strays_before;
  path_.push_back({at.position_m, at.velocity_mps});
}

double Shape::Volume::Add(const Eigen::Matrix3d& frame_m2, const Eigen::Array3d& noise_m2,
                          double count, double weight) {
  constexpr double kLeastM2 = 1e-9;  // returns of one beam lie in a plane
  const double freedom = count - 3.0;
  if (freedom <= 0.0) return 0.0;
  const Eigen::Matrix3d precision = (frame_m2 + kLeastM2 * Eigen::Matrix3d::Identity()).inverse();
  // Scatters of streams are rounded to floats; what is left along an axis is some share of it.
  const Eigen::Array3d left_m2 = precision.diagonal().array().inverse();
  residual_m2 += weight * (left_m2.max(0.0).min(frame_m2.diagonal().array()) - freedom * noise_m2);
  residual_freedom += weight * freedom;
  squared_freedom += weight * weight * freedom;
  scatter_m2 += weight * frame_m2.trace();
  scatter_freedom += weight * 3.0 * (count - 1.0);
  return weight * freedom;
}

double Shape::SpreadM() const {
  constexpr double kMeanSquareInBall = 0.2;  // per axis across the motion, over radius^2
  // Strays near the target, as those farther about it tell.
  const double all_about = strays_ * Cube(kNearM) / (Cube(kStraysToM) - Cube(kStraysFromM));
  // As many on each metre of a ray, of which the mean chord of the ball has 4/3 of its radius.
  const double on_rays = strays_before_ * 4.0 / 3.0 * kNearM / (kStraysToM - kStraysFromM);
  const double num_strays = std::clamp(on_rays, all_about, all_about / kLeastShareInView);
  Tally body = near_;
  body.Add({1.0, kMeanSquareInBall * kNearM * kNearM}, -num_strays);
  body = {std::max(body.count, 0.0), std::max(body.sum_m2, 0.0)};
  for (const OwnFrame& frame : own_) body.Add(frame.tally);
  return body.count > 0.0 ? std::sqrt(body.sum_m2 / body.count) : 0.0;
}

Shape::Thirds Shape::ThirdsOfOwn() const {
  Thirds thirds;
  if (own_.empty()) return thirds;
  const auto [first, last] = std::minmax_element(own_.begin(), own_.end(), By(&OwnFrame::time_ns));
  const TimeNs third_ns = (last->time_ns - first->time_ns) / 3;
  thirds.observed_s = SecondsOf(last->time_ns - first->time_ns);
  for (const OwnFrame& frame : own_) {
    const bool is_early = frame.time_ns - first->time_ns <= third_ns;
    const bool is_late = last->time_ns - frame.time_ns <= third_ns;
    (is_early ? thirds.first : is_late ? thirds.last : thirds.middle).Add(frame.tally);
  }
  return thirds;
}

bool Shape::HasGrown(double ratio) const {
  if (!uses_growth_) return false;
  const Thirds thirds = ThirdsOfOwn();
  if (thirds.last.MeanM2() < kGrownM * kGrownM) return false;
  const double first_m2 = std::max(thirds.first.MeanM2(), kNarrowestDroneM * kNarrowestDroneM);
  const double growth = std::log(thirds.last.MeanM2() / first_m2);
  // The mean of n squares on two axes has a relative standard error of n^(-1/2).
  const double error = std::sqrt(1.0 / thirds.first.count + 1.0 / thirds.last.count);
  return growth > std::log(ratio) + kGrowthSigmas * error &&
         thirds.middle.MeanM2() > first_m2 * std::exp(kMiddleShare * growth);
}

bool Shape::IsToldThroughout() const {
  const auto variance_s2 = [&](const auto& weight_of) {
    Eigen::Array3d sums = Eigen::Array3d::Zero();
    for (const OwnFrame& frame : own_) {
      const double at_s = SecondsOf(frame.time_ns - own_.front().time_ns);
      sums += weight_of(frame) * Eigen::Array3d(1.0, at_s, at_s * at_s);
    }
    return sums[2] / sums[0] - Square(sums[1] / sums[0]);
  };
  const double told_s2 = variance_s2([](const OwnFrame& frame) { return frame.freedom; });
  const double all_s2 = variance_s2([](const OwnFrame&) { return 1.0; });
  return told_s2 >= Square(kVolumeTimeShare) * all_s2;
}

bool Shape::ScattersAsVolume(double sigmas) const {
  if (!uses_volume_ || volume_.residual_freedom <= 0.0) return false;
  if (!IsToldThroughout()) return false;
  // The mean of n squares has a relative variance of 2 / n.
  const double error = std::sqrt(2.0 * volume_.squared_freedom) / volume_.residual_freedom;
  const double least_m2 =
      volume_.residual_m2.minCoeff() / volume_.residual_freedom * std::exp(-sigmas * error);
  return least_m2 > kVolumeM * kVolumeM &&
         least_m2 > kVolumeRatio * volume_.scatter_m2 / volume_.scatter_freedom;
}

bool Shape::StaysNarrow() const {
  if (!uses_growth_) return false;
  const Thirds thirds = ThirdsOfOwn();
  const double error = 1.0 / std::sqrt(thirds.last.count);
  const double most_m2 = thirds.last.MeanM2() * std::exp(kGrowthSigmas * error);
  return thirds.observed_s > kGrowsWithinS && most_m2 < kGrownM * kGrownM;
}

bool Shape::IsPartOf(const std::vector<const Shape*>& clouds) const {
  const auto is_in_cloud = [&](const MotionState& at) {
    const double reach_m = kReach.At(at.position_m.norm());
    return std::any_of(clouds.begin(), clouds.end(), [&](const Shape* cloud) {
      return std::any_of(
          cloud->returns_.begin(), cloud->returns_.end(), [&](const MotionState& part) {
            return (part.position_m - at.position_m).squaredNorm() < reach_m * reach_m &&
                   (part.velocity_mps - at.velocity_mps).norm() <
                       kTurbulenceMps + kTurbulenceShare * part.velocity_mps.norm();
          });
    });
  };
  const auto num_in = std::count_if(path_.begin(), path_.end(), is_in_cloud);
  return static_cast<double>(num_in) > kPieceShare * static_cast<double>(path_.size());
}

bool Shape::IsInsect() const {
  return within_.count >= kEnoughReturns &&
         within_.sum_m2 < kNarrowestDroneM * kNarrowestDroneM * within_.count;
}

bool Shape::MayBeCloud() const {
  return SpreadM() > kCertainDroneM || HasGrown(1.0) || ScattersAsVolume(0.0);
}

void Shape::Clear() {
  near_ = within_ = Tally();
  strays_ = strays_before_ = 0.0;
  volume_ = Volume();
  own_.clear();
  path_.clear();
  returns_.clear();
}

bool Shape::IsCloud(const std::vector<const Shape*>& clouds) const {
  return SpreadM() > kWidestDroneM || ScattersAsVolume(kVolumeSigmas) || HasGrown(kGrowthOfViews) ||
         (!StaysNarrow() && IsPartOf(clouds));
}

std::vector<Rejection> ShapeRejections(const Recording& recording,
                                       const std::vector<StationModel>& station_models,
                                       const std::vector<Plot>& plots,
                                       const std::vector<Target>& targets,
                                       const RobustConfig& config) {
  std::vector<Shape> shapes;
  shapes.reserve(targets.size());
  for (const Target& target : targets) {
    shapes.push_back(ShapeOf(recording, station_models, plots, target, config));
  }
  std::vector<Rejection> rejections(targets.size(), Rejection::kNone);
  for (std::size_t t = 0; t < targets.size(); ++t) {
    if (config.Uses(Rule::kInsect) && shapes[t].IsInsect()) rejections[t] = Rejection::kInsect;
  }
  if (!config.Uses(Rule::kCloud)) return rejections;
  std::vector<const Shape*> clouds;
  for (std::size_t before = targets.size() + 1; before != clouds.size();) {
    before = clouds.size();
    for (std::size_t t = 0; t < targets.size(); ++t) {
      if (rejections[t] == Rejection::kCloud || !shapes[t].IsCloud(clouds)) continue;
      rejections[t] = Rejection::kCloud;
      clouds.push_back(&shapes[t]);
    }
  }
  return rejections;
}

bool IsCertainlyNoCloud(const Recording& recording, const std::vector<StationModel>& station_models,
                        const std::vector<Plot>& plots, const Target& target,
                        const RobustConfig& config) {
  return ShapeOf(recording, station_models, plots, target, config).IsCertainlyNoCloud();
}

}  // namespace unlidar
