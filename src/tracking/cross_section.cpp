#include "tracking/cross_section.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "base/maths.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {
namespace {

// Sums of values at times, both in the order of which they were added.
class SumsOverTime {
 public:
  void Add(TimeNs time_ns, double value) {
    times_ns_.push_back(time_ns);
    sums_.push_back(sums_.back() + value);
  }

  double Within(TimeNs begin_ns, TimeNs end_ns) const {
    const auto first = std::lower_bound(times_ns_.begin(), times_ns_.end(), begin_ns);
    const auto last = std::upper_bound(first, times_ns_.end(), end_ns);
    return *(sums_.begin() + (last - times_ns_.begin())) -
           *(sums_.begin() + (first - times_ns_.begin()));
  }

 private:
  std::vector<TimeNs> times_ns_;
  std::vector<double> sums_{0.0};
};

}  // namespace

std::vector<double> CrossSectionsM2(const Recording& recording, const std::vector<Plot>& path) {
  // LiDARs have at least this many lines of sight per steradian: before a clear sky too few return
  // to count them.
  constexpr double kLeastSightsPerSrS = 25'000.0;
  constexpr TimeNs kReachNs = 3'000'000'000;
  struct Sight {
    SumsOverTime returns;
    SumsOverTime per_m2;
    Eigen::Vector3d station_m = Eigen::Vector3d::Zero();
    double per_sr = 0.0;  // of a frame
  };
  std::vector<Sight> sights(recording.sensors.size());
  for (const Plot& plot : path) {
    Sight& sight = sights[plot.sensor];
    sight.returns.Add(plot.time_ns, static_cast<double>(plot.num_returns));
    sight.station_m = plot.ViewpointM() - plot.shift_m.cast<double>();
    sight.per_sr = std::max(sight.per_sr, static_cast<double>(plot.sights_per_sr));
  }
  auto next = path.begin();
  for (const FrameInfo& frame : recording.frames) {
    const TimeNs time_ns = (frame.begin_ns + frame.end_ns) / 2;
    while (next + 1 != path.end() &&
           std::abs((next + 1)->time_ns - time_ns) <= std::abs(next->time_ns - time_ns)) {
      ++next;
    }
    if (std::abs(next->time_ns - time_ns) > kBinNs) continue;
    Sight& sight = sights[frame.sensor];
    const Eigen::Vector3d ray_m =
        next->position_m - sight.station_m - frame.carrier.shift_m.cast<double>();
    const double least_per_sr = kLeastSightsPerSrS * SecondsOf(frame.end_ns - frame.begin_ns);
    sight.per_m2.Add(time_ns, std::max(sight.per_sr, least_per_sr) / ray_m.squaredNorm());
  }
  std::vector<double> largest_m2;
  for (const Plot& plot : path) {
    double& largest = largest_m2.emplace_back(0.0);
    for (const Sight& sight : sights) {
      const TimeNs begin_ns = plot.time_ns - kReachNs;
      const TimeNs end_ns = plot.time_ns + kReachNs;
      const double num_returns = sight.returns.Within(begin_ns, end_ns);
      if (num_returns == 0.0) continue;
      largest = std::max(largest, num_returns / sight.per_m2.Within(begin_ns, end_ns));
    }
  }
  return largest_m2;
}

}  // namespace unlidar
