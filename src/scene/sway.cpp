#include "scene/sway.hpp"

#include <algorithm>
#include <cmath>

#include "base/angles.hpp"
#include "base/format.hpp"
#include "scene/sampled_returns.hpp"

namespace unlidar {
namespace {

// Returns of a frame that are matched, evenly drawn; more of a station that sways.
constexpr std::size_t kSampled = 800;
constexpr std::size_t kManySampled = 2048;
constexpr TimeNs kFirstNs = kNsPerSecond;  // of a look, in which a map only grows

// Duration of a look, and of the pause after it.
constexpr TimeNs kLookNs = 5 * kNsPerSecond;
constexpr TimeNs kShortLookNs = 3 * kNsPerSecond;  // without a sign of a sway by then
constexpr TimeNs kRestNs = 20 * kNsPerSecond;
constexpr TimeNs kMaxBreakNs = kNsPerSecond;  // of frames; a longer one ends the period

constexpr double kMinMatched = 60.0;  // returns on surfaces
constexpr double kMaxTurnRad = 3.0 * kRadPerDeg;
constexpr double kMaxShiftM = 0.5;
constexpr std::size_t kMeanFrames = 600;  // of which the attitude at rest is the mean
// Once a scene is learned, its attitude changes no faster: 5 cm/s at 30 m.
constexpr double kMaxRestRadPerS = 0.1 * kRadPerDeg;

constexpr double kMaxFrames = 50.0;  // over which means are taken
constexpr double kMinFrames = 20.0;
constexpr double kMinSwayRad = 0.05 * kRadPerDeg;  // rms; less costs no accuracy
constexpr double kCalmRad = 0.03 * kRadPerDeg;     // rms of a sway that has ended
// Share of the errors at rest that a motion must explain in returns that were not used for it.
constexpr double kMinExplained = 0.06;
// Where too little stands around, correction would shake the scene: a simulated mast with 0.11 has
// a pole as a drone in streams; where enough does it is 0.03 to 0.073.
constexpr double kMaxSigmaRad = 0.085 * kRadPerDeg;

// Returns the mean with the weights of a Hann window: that of a few oscillations is near the
// attitude at rest, wherever in a period they begin and end.
Vector6d MeanOf(const Queue<Vector6d>& poses) {
  Vector6d sum = Vector6d::Zero();
  double weights = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double sine =
        std::sin(M_PI * (static_cast<double>(i) + 0.5) / static_cast<double>(poses.size()));
    sum += sine * sine * poses[i];
    weights += sine * sine;
  }
  return sum / weights;
}

// Draws at most so many returns of a frame evenly.
void Sample(const SwayingFrame& frame, const Eigen::Vector3d& viewpoint_m, std::size_t most,
            std::vector<TimedReturn>* sampled) {
  sampled->clear();
  const std::size_t step = SampleStep(frame.size, most);
  for (std::size_t i = 0; i < frame.size; i += step) {
    const Eigen::Vector3d ray_m = frame.points_m[i].cast<double>() - viewpoint_m;
    if (ray_m.squaredNorm() < kOwnRangeM * kOwnRangeM) continue;
    sampled->push_back({ray_m, frame.time_ns(i)});
  }
}

}  // namespace

SwayEstimate Sway::Observe(const SensorInfo& sensor, const SwayingFrame& frame) {
  if (sensor.carrier != nullptr) return {};
  const std::uint32_t index = frame.info->sensor;
  const auto [known, is_new] = station_of_.try_emplace(index, 0);
  if (is_new) known->second = places_.Add(index, sensor);
  if (places_.size() > stations_.size()) stations_.emplace_back().first_sensor = index;
  Station& station = stations_[known->second];
  const TimeNs time_ns = frame.info->middle_ns();
  const bool is_pause = std::abs(time_ns - station.newest_ns) > kMaxBreakNs;
  station.newest_ns = is_pause ? time_ns : std::max(station.newest_ns, time_ns);
  if (is_pause) {
    station.following.reset();
    station.rest_until_ns = time_ns;
  }
  if (!station.following) {
    if (time_ns < station.rest_until_ns) return {};
    station.following.emplace(time_ns);
    station.filter.Begin(time_ns);
    station.refining.reset();
    // Frames that wait to be corrected share the period before.
    if (station.period.use_count() == 1) {
      *station.period = SwayPeriod();
    } else {
      station.period = std::make_shared<SwayPeriod>();
    }
    for (auto& [of_sensor, map] : station.maps) map.Clear();
    station.poses.clear();
  }
  Follow(index, places_.ViewpointM(known->second).cast<double>(), frame, &station);
  if (!station.following) return {};
  return {station.period, station.filter.motion()};
}

void Sway::Follow(std::uint32_t sensor, const Eigen::Vector3d& viewpoint_m,
                  const SwayingFrame& frame, Station* station) {
  Following& following = *station->following;
  const TimeNs time_ns = frame.info->middle_ns();
  Sample(frame, viewpoint_m, following.is_moving ? kManySampled : kSampled, &sampled_);
  SurfaceMap& map = station->maps[sensor];
  const bool is_first = time_ns < following.begin_ns + kFirstNs;
  SmallMotionFilter::Fit fit;
  if (!is_first) {
    station->filter.Predict(time_ns);
    station->filter.SetRest(station->period->mean);
    fit = station->filter.Update(sampled_, map);
  }
  for (const TimedReturn& one : sampled_) {
    map.Add(following.is_moving ? Moved(station->filter.motion().At(one.time_ns), one.position_m)
                                : one.position_m);
  }
  if (!is_first) Judge(fit, time_ns, station);
}

void Sway::Judge(const SmallMotionFilter::Fit& fit, TimeNs time_ns, Station* station) {
  Following& following = *station->following;
  SwayPeriod& period = *station->period;
  const auto end = [&](TimeNs rest_ns) {
    station->rest_until_ns = time_ns + rest_ns;
    station->following.reset();
  };
  if (static_cast<double>(fit.matched) < kMinMatched) {
    // One of the sensors may see nothing but sky.
    if (time_ns > following.matched_ns.value_or(following.begin_ns + kFirstNs) + kNsPerSecond)
      end(kRestNs);
    return;
  }
  following.matched_ns = time_ns;
  const Vector6d excursion = station->filter.motion().pose - period.mean;
  if (excursion.head<3>().norm() > kMaxTurnRad || excursion.tail<3>().norm() > kMaxShiftM) {
    period.is_swaying = false;
    return end(kRestNs);
  }
  const Eigen::Vector3d rest_rad = period.mean.head<3>();
  following.weight = std::min(following.weight + 1.0, kMaxFrames);
  const auto add = [&](const auto& value, auto* mean) {
    *mean += (value - *mean) / following.weight;
  };
  const Eigen::Vector3d half_rad[2] = {fit.half_rad[0] - rest_rad, fit.half_rad[1] - rest_rad};
  add(half_rad[0].dot(half_rad[1]), &following.product_rad2);
  add(Eigen::Vector3d((half_rad[0] + half_rad[1]) / 2.0), &following.turn_rad);
  add(fit.rest_error, &following.rest_error);
  add(fit.held_out_error, &following.held_out_error);
  station->poses.push_back(station->filter.motion().pose);
  if (station->poses.size() > kMeanFrames) station->poses.pop_front();
  if (following.is_moving) {
    const Vector6d step = MeanOf(station->poses) - period.mean;
    const double step_s = SecondsOf(time_ns - following.judged_ns);
    const double most_rad = kMaxRestRadPerS * std::max(step_s, 0.0);
    period.mean += step * std::min(1.0, most_rad / std::max(step.head<3>().norm(), 1e-9));
  }
  following.judged_ns = time_ns;
  if (following.weight < kMinFrames) return;
  const double explained = 1.0 - following.held_out_error / std::max(following.rest_error, 1.0);
  const bool is_real =
      explained > kMinExplained && following.product_rad2 > kMinSwayRad * kMinSwayRad;
  if (!following.is_moving) {
    if (is_real) {
      following.is_moving = true;
      following.weight = 0.0;
      period.mean = MeanOf(station->poses);
    } else if (time_ns >
               following.begin_ns + (explained < kMinExplained / 2.0 ? kShortLookNs : kLookNs)) {
      end(kRestNs);
    }
    return;
  }
  if (!period.is_swaying) {
    if (!is_real || station->filter.SigmaRad() > kMaxSigmaRad) return end(kRestNs);
    period.is_swaying = true;
  }
  // About its own mean, as the attitude at rest is hardly known at first.
  const double variance_rad2 = following.product_rad2 - following.turn_rad.squaredNorm();
  const double amplitude_rad = std::sqrt(2.0 * std::max(variance_rad2, 0.0));
  station->largest_rad = std::max(station->largest_rad, amplitude_rad);
  if (following.product_rad2 < kCalmRad * kCalmRad) end(kRestNs);
}

SwayEstimate Sway::Refine(const SwayEstimate& estimate, const SwayingFrame& frame) {
  if (estimate.period == nullptr || !estimate.period->is_swaying) return estimate;
  const std::uint32_t sensor = frame.info->sensor;
  const std::size_t index = station_of_.at(sensor);
  Station& station = stations_[index];
  if (station.period != estimate.period) return estimate;  // its maps are gone
  const TimeNs time_ns = frame.info->middle_ns();
  if (!station.refining) station.refining.emplace(time_ns);
  Sample(frame, places_.ViewpointM(index).cast<double>(), kManySampled, &sampled_);
  station.refining->Predict(time_ns);
  station.refining->SetRest(station.period->mean);
  station.refining->Update(sampled_, station.maps[sensor]);
  return {estimate.period, station.refining->motion()};
}

void Sway::Correct(const SwayEstimate& estimate, const SwayingFrame& frame) const {
  if (estimate.period == nullptr || !estimate.period->is_swaying) return;
  FrameInfo& info = *frame.info;
  const Eigen::Vector3d viewpoint_m =
      places_.ViewpointM(station_of_.at(info.sensor)).cast<double>();
  const Vector6d& mean = estimate.period->mean;
  for (std::size_t i = 0; i < frame.size; ++i) {
    const Vector6d pose = estimate.motion.At(frame.time_ns(i)) - mean;
    const Eigen::Vector3d ray_m = frame.points_m[i].cast<double>() - viewpoint_m;
    frame.points_m[i] = (viewpoint_m + Moved(pose, ray_m)).cast<float>();
  }
  const Eigen::Vector3d turn_rad = (estimate.motion.At(info.middle_ns()) - mean).head<3>();
  const double angle_rad = turn_rad.norm();
  if (angle_rad == 0.0) return;
  // The edges of the view sway; the shift is smaller than any place.
  info.carrier.rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, turn_rad / angle_rad)).cast<float>();
}

double Sway::LargestDeg(std::uint32_t sensor) const {
  const auto station = station_of_.find(sensor);
  return station == station_of_.end() ? 0.0 : stations_[station->second].largest_rad / kRadPerDeg;
}

std::optional<Warning> Sway::WarningOf(std::uint32_t sensor, const std::string& name) const {
  const double largest_deg = LargestDeg(sensor);
  if (largest_deg == 0.0 || stations_[station_of_.at(sensor)].first_sensor != sensor) return {};
  return Warning{"sensor_sways", name + ": the LiDAR sways (by " + FixedText(largest_deg, 1) +
                                     " degrees): its motion is estimated from what stands still "
                                     "and removed"};
}

}  // namespace unlidar
