#include "collection/collect.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>

#include "collection/body.hpp"
#include "collection/dwells.hpp"
#include "collection/frame_timing.hpp"
#include "collection/sensor_biases.hpp"
#include "collection/spots.hpp"
#include "trajectory/sampling.hpp"
#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {
namespace {

// Limit of the rounds of fit and collection, which end once the returns settle.
constexpr int kMaxRounds = 3;
// Gate in standard deviations, exceeded by about 1 in 1,000 returns of a target.
constexpr double kGate = 4.0;
// Where the trajectory is less certain, all returns in the surroundings would be collected.
constexpr double kMaxSearchSigmaM = 1.0;
// Each round searches this far beyond the ends.
constexpr TimeNs kMaxExtensionNs = 2'000'000'000;
// A dwell of the target within this radius is left out of the clutter rate there: body size and
// noise.
constexpr RangeRadius kDwellRadius{1.5, 0.03};

Measurement Measure(const Recording& recording, const FrameInfo& frame, const StationModel& station,
                    const IndexView& returns, const Eigen::Vector3d& velocity_mps,
                    const BodySigmas& body) {
  Measurement m;
  const auto n = static_cast<double>(returns.size());
  double offset_ns = 0.0;
  for (const std::uint32_t i : returns) {
    m.position_m += recording.points_m[i].cast<double>() / n;
    offset_ns += static_cast<double>(recording.times_ns[i] - frame.begin_ns) / n;
  }
  m.time_ns = frame.begin_ns + std::llround(offset_ns);
  m.support = static_cast<int>(returns.size());
  m.viewpoint_m = ViewpointM(station, frame);
  m.covariance_m2 =
      MeasurementCovarianceM2(body, m.position_m - m.viewpoint_m, StreakM2(frame, velocity_mps), n);
  return m;
}

// Expected returns of a target per frame of a sensor, which fall with the square of range.
// Estimated from the frames near the time, with the mean of the whole flight as the prior.
class Visibility {
 public:
  // `returns`: the target's, ascending.
  Visibility(const Recording& recording, const std::vector<StationModel>& station_models,
             const Trajectory& trajectory, const std::vector<std::uint32_t>& returns)
      : sensors_(station_models.size()) {
    for (const FrameInfo& frame : recording.frames) {
      const auto first = std::lower_bound(returns.begin(), returns.end(), frame.first_return);
      const auto num_returns =
          static_cast<double>(std::lower_bound(first, returns.end(), frame.last_return) - first);
      const TimeNs time_ns = frame.middle_ns();
      const bool is_within = trajectory.begin_ns() <= time_ns && time_ns <= trajectory.end_ns();
      if (!is_within && num_returns == 0.0) continue;
      const double per_m2 =
          PerM2(RayM(station_models[frame.sensor], frame, trajectory.At(time_ns).position_m));
      Sensor& sensor = sensors_[frame.sensor];
      sensor.exposures.push_back({time_ns, num_returns, per_m2});
      sensor.num_returns += num_returns;
      sensor.per_m2 += per_m2;
    }
    for (Sensor& sensor : sensors_) {
      std::sort(sensor.exposures.begin(), sensor.exposures.end(), By(&FrameExposure::time_ns));
    }
  }

  // Constant beyond the ends of the trajectory but for range.
  double ReturnsPerFrame(std::uint32_t sensor_index, TimeNs time_ns,
                         const Eigen::Vector3d& ray_m) const {
    constexpr TimeNs kReachNs = 1'000'000'000;
    const Sensor& sensor = sensors_[sensor_index];
    if (sensor.exposures.empty()) return kJeffreysCount;
    double num_returns = kJeffreysCount;
    double per_m2 = kJeffreysCount * sensor.per_m2 / (sensor.num_returns + kJeffreysCount);
    const TimeNs near_ns =
        std::clamp(time_ns, sensor.exposures.front().time_ns, sensor.exposures.back().time_ns);
    auto exposure = FirstFrom(sensor.exposures, &FrameExposure::time_ns, near_ns - kReachNs);
    for (; exposure != sensor.exposures.end() && exposure->time_ns <= near_ns + kReachNs;
         ++exposure) {
      num_returns += exposure->num_returns;
      per_m2 += exposure->per_m2;
    }
    return num_returns / per_m2 * PerM2(ray_m);
  }

 private:
  struct FrameExposure {
    TimeNs time_ns;
    double num_returns;
    double per_m2;
  };
  struct Sensor {
    std::vector<FrameExposure> exposures;  // in order of time
    double num_returns = 0.0;
    double per_m2 = 0.0;
  };

  std::vector<Sensor> sensors_;
};

// A return that is likelier to be the target's than clutter of its surroundings.
struct Candidate {
  std::uint32_t index = 0;
  double log_density = 0.0;        // log intensity of the target's returns there
  double surroundings_rate = 0.0;  // while the target is elsewhere; negative: unknown
  TimeNs from_ns = 0;              // dwell of the target there, certain or possible
  TimeNs to_ns = 0;
};

// Returns of one frame that pass the gate.
struct GatedFrame {
  const FrameInfo* frame = nullptr;
  TrajectoryRow expected;
  Eigen::Vector3d facing_m = Eigen::Vector3d::Zero();
  std::vector<Candidate> candidates;
};

std::vector<Candidate> GateReturns(const Recording& recording, const FrameInfo& frame,
                                   const StationModel& station, const std::vector<char>& excluded,
                                   const Trajectory& trajectory, const TrajectoryRow& expected,
                                   double returns_per_frame, const BodySigmas& body,
                                   TimeNs max_gap_ns) {
  const TimeNs middle_ns = expected.time_ns;
  const Eigen::Matrix3d s = trajectory.CovarianceAt(middle_ns) +
                            StreakM2(frame, expected.velocity_mps) +
                            ReturnCovarianceM2(body, RayM(station, frame, expected.position_m));
  const Eigen::Matrix3d information = s.inverse();
  const double log_peak =
      std::log(returns_per_frame) - 0.5 * std::log((2.0 * M_PI * s).determinant());
  const double half_frame_s = 0.5 * SecondsOf(frame.end_ns - frame.begin_ns);
  const auto reach_m = static_cast<float>(kGate * std::sqrt(s.trace()) +
                                          expected.velocity_mps.norm() * half_frame_s);
  const Eigen::Vector3f centre = expected.position_m.cast<float>();
  std::vector<Candidate> candidates;
  for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
    const Eigen::Vector3f d = recording.points_m[i] - centre;
    if (d.squaredNorm() > reach_m * reach_m || excluded[i]) continue;
    // With point times the return belongs to another point of the trajectory.
    const TimeNs time_ns = recording.times_ns[i];
    const Eigen::Vector3d e =
        d.cast<double>() - expected.velocity_mps * SecondsOf(time_ns - middle_ns);
    const double distance2 = e.dot(information * e);
    if (distance2 > kGate * kGate) continue;
    const Eigen::Vector3d place_m = recording.points_m[i].cast<double>();
    // The target's own dwell is left out of the clutter rate there.
    auto [from_ns, to_ns] = DwellAround(trajectory, time_ns, place_m,
                                        kDwellRadius.At(RayM(station, frame, place_m).norm()));
    const BinRange dwell = station.bins->BinsTouching(from_ns, to_ns);
    const double rate = station.occupancy->RateOutside(recording.points_m[i] - station.viewpoint_m,
                                                       dwell.first, dwell.last);
    const double log_density = log_peak - 0.5 * distance2;
    if (rate >= 0.0 && log_density < std::log(rate)) continue;
    // The target may have dwelt here for as long as it can be missed before its first measurement
    // and after its last one. Such a dwell is left out of the rate at the spot: its few
    // returns hardly change the rate of the surroundings, but are all there is at the spot.
    if (from_ns <= trajectory.begin_ns()) from_ns -= max_gap_ns;
    if (to_ns >= trajectory.end_ns()) to_ns += max_gap_ns;
    candidates.push_back({i, log_density, rate, from_ns, to_ns});
  }
  return candidates;
}

struct AssignedReturns {
  std::vector<std::uint32_t> returns;
  double log_ratio = 0.0;  // over all returns whose clutter rate is known
};

// Assigns the candidates that are likelier to be the target's than clutter of their spots as well.
AssignedReturns AssignReturns(const Recording& recording, const GatedFrame& gated,
                              const std::optional<Spots>& spots) {
  AssignedReturns members;
  for (const Candidate& candidate : gated.candidates) {
    double log_ratio = 0.0;
    if (candidate.surroundings_rate >= 0.0) {
      double rate = candidate.surroundings_rate;
      if (spots) {
        rate = std::max(rate,
                        spots->RateOutside(gated.frame->sensor, recording.points_m[candidate.index],
                                           candidate.from_ns, candidate.to_ns, rate));
      }
      log_ratio = candidate.log_density - std::log(rate);
      if (log_ratio < 0.0) continue;
    }
    members.returns.push_back(candidate.index);
    members.log_ratio += log_ratio;
  }
  return members;
}

}  // namespace

Target CollectTarget(const Recording& recording, const std::vector<StationModel>& station_models,
                     const std::vector<Plot>& path, const std::vector<char>& excluded,
                     const RobustConfig& robust, const TrajectoryConfig& trajectory_config) {
  const CollectConfig& config = robust.collect;
  Target target;
  BodySigmas body{config.extent_sigma_m, config.extent_sigma_m, config.extent_sigma_m};
  FacingShare facing = FacingSide().Share(body.width_m, config.centroid_offset);
  std::vector<int> returns(recording.sensors.size(), 0);
  for (const Plot& plot : path) {
    returns[recording.frames[plot.frame].sensor] += static_cast<int>(plot.returns.size());
  }
  const auto main_sensor =
      static_cast<std::size_t>(std::max_element(returns.begin(), returns.end()) - returns.begin());
  std::vector<TimedViewpoint> main_viewpoints;
  for (const FrameInfo& frame : recording.frames) {
    if (frame.sensor != main_sensor) continue;
    main_viewpoints.push_back({frame.middle_ns(), ViewpointM(station_models[main_sensor], frame)});
  }
  std::sort(main_viewpoints.begin(), main_viewpoints.end(), By(&TimedViewpoint::time_ns));
  // Only the side of a body that faces the sensor is seen, so the centre lies behind the mean of
  // the returns. Measurements of stations with different viewpoints are compared, and fitted, as
  // seen from the main sensor.
  const auto depth_m = [&](TimeNs time_ns, const Eigen::Vector3d& place_m) {
    return FacingSideOffsetM(body.width_m, place_m - NearestViewpointM(main_viewpoints, time_ns),
                             facing.mean);
  };
  // Offset from the mean that is seen in a frame to that of the main sensor; zero in its own.
  const auto facing_offset_m = [&](const FrameInfo& frame, const Eigen::Vector3d& place_m) {
    const Eigen::Vector3d ray_m = RayM(station_models[frame.sensor], frame, place_m);
    return Eigen::Vector3d(FacingSideOffsetM(body.width_m, ray_m, facing.mean) -
                           depth_m(frame.middle_ns(), place_m));
  };
  for (const Plot& plot : path) {
    const FrameInfo& frame = recording.frames[plot.frame];
    target.measurements.push_back(Measure(recording, frame, station_models[frame.sensor],
                                          plot.returns, Eigen::Vector3d::Zero(), body));
    Eigen::Vector3d& position_m = target.measurements.back().position_m;
    position_m += facing_offset_m(frame, position_m);
    target.returns.insert(target.returns.end(), plot.returns.begin(), plot.returns.end());
  }
  std::stable_sort(target.measurements.begin(), target.measurements.end(),
                   By(&Measurement::time_ns));
  std::sort(target.returns.begin(), target.returns.end());

  std::vector<SensorBias> sensor_biases(recording.sensors.size());
  std::vector<FrameTiming> timings(recording.sensors.size());
  const int num_rounds = robust.Uses(Rule::kCollection) ? kMaxRounds : 0;
  TrajectoryFitter fitter(trajectory_config);
  Trajectory trajectory;
  for (int round = 0; round < num_rounds; ++round) {
    // The scales of the path hold for its collected returns, too.
    if (round == 0) {
      fitter.Fit(target.measurements, trajectory);
    } else {
      fitter.Refit(target.measurements, trajectory.scales, trajectory);
    }
    const Visibility visibility(recording, station_models, trajectory, target.returns);
    std::vector<SensorMeasurement> sensor_measurements;
    BodySpread spread(config.extent_sigma_m);
    timings.assign(recording.sensors.size(), FrameTiming());
    std::vector<GatedFrame> gated_frames;
    for (const FrameInfo& frame : recording.frames) {
      const TimeNs middle_ns = (frame.begin_ns + frame.end_ns) / 2;
      if (middle_ns < trajectory.begin_ns() - kMaxExtensionNs) continue;
      if (middle_ns > trajectory.end_ns() + kMaxExtensionNs) continue;
      const StationModel& station = station_models[frame.sensor];
      const SensorBias& sensor_bias = sensor_biases[frame.sensor];
      TrajectoryRow expected = trajectory.At(middle_ns - NsOf(sensor_bias.delay_s));
      if (expected.sigma_m.maxCoeff() > kMaxSearchSigmaM) continue;
      expected.time_ns = middle_ns;  // on the sensor's clock
      expected.position_m += sensor_bias.bias_m;
      const Eigen::Vector3d facing_m = facing_offset_m(frame, expected.position_m);
      expected.position_m -= facing_m;
      const double returns_per_frame = visibility.ReturnsPerFrame(
          frame.sensor, middle_ns, RayM(station, frame, expected.position_m));
      gated_frames.push_back(
          {&frame, expected, facing_m,
           GateReturns(recording, frame, station, excluded, trajectory, expected, returns_per_frame,
                       body, NsOf(robust.tracker.max_gap_s))});
    }
    std::optional<Spots> spots;
    if (robust.Uses(Rule::kSpots)) {
      std::vector<std::uint32_t> gated_returns;
      for (const GatedFrame& gated : gated_frames) {
        for (const Candidate& one : gated.candidates) gated_returns.push_back(one.index);
      }
      spots.emplace(recording, station_models, gated_returns);
    }
    Target next;
    for (const GatedFrame& gated : gated_frames) {
      const auto [members, log_ratio] = AssignReturns(recording, gated, spots);
      if (members.empty()) continue;
      const FrameInfo& frame = *gated.frame;
      const StationModel& station = station_models[frame.sensor];
      const Eigen::Vector3d& velocity_mps = gated.expected.velocity_mps;
      const Eigen::Vector3d viewpoint_m = ViewpointM(station, frame);
      spread.Add(recording, frame, viewpoint_m, members, gated.expected);
      FrameTiming& timing = timings[frame.sensor];
      if (frame.is_timed) {
        timing.AddTimed(frame.time_sigma_s);
      } else {
        timing.Add(StreakOf(recording, frame, viewpoint_m, members, velocity_mps), body);
      }
      sensor_measurements.push_back(
          {Measure(recording, frame, station, members, velocity_mps, body), frame.sensor,
           station.viewpoint_m.cast<double>(), velocity_mps});
      sensor_measurements.back().measurement.position_m += gated.facing_m;
      sensor_measurements.back().measurement.log_ratio = log_ratio;
      next.returns.insert(next.returns.end(), members.begin(), members.end());
    }
    if (sensor_measurements.empty()) return next;
    std::stable_sort(sensor_measurements.begin(), sensor_measurements.end(), IsEarlier);
    SensorComparison comparison(config);
    comparison.Add(sensor_measurements, 0, sensor_measurements.size());
    comparison.GetBiases(comparison.Origins(), &sensor_biases);
    RemoveBiases(sensor_biases, &sensor_measurements);
    for (const SensorMeasurement& sensor_measurement : sensor_measurements) {
      next.measurements.push_back(sensor_measurement.measurement);
    }
    std::stable_sort(next.measurements.begin(), next.measurements.end(), By(&Measurement::time_ns));
    std::sort(next.returns.begin(), next.returns.end());
    body = spread.Sigmas();
    if (robust.Uses(Rule::kRoundBodies)) {
      facing = spread.facing_side().Share(body.width_m, config.centroid_offset);
    }
    const bool is_settled = next.returns == target.returns;
    target = std::move(next);
    if (is_settled && round > 0) break;
  }
  // Measurements are moved from the facing side to the centre of the body.
  for (Measurement& m : target.measurements) {
    m.position_m += depth_m(m.time_ns, m.position_m);
  }
  target.common_errors.depth_sigma_m = facing.sigma * body.width_m;
  double elevation_m2 = 0.0;
  for (const Plot& plot : path) {
    elevation_m2 += ElevationVarianceM2(plot.beam_step_m, body.width_m);
  }
  target.common_errors.elevation_sigma_m =
      std::sqrt(elevation_m2 / static_cast<double>(path.size()));
  // All delays are relative to the main sensor.
  target.time_bias_ns = NsOf(timings[main_sensor].TimeBiasS());
  target.common_errors.time_sigma_s = std::sqrt(timings[main_sensor].VarianceS2());
  return target;
}

}  // namespace unlidar
