#include "tracking/crowding.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

// Plots near a path that are neither its own nor those of targets, in the order of `plots`.
std::vector<const Plot*> OthersNear(const std::vector<std::uint32_t>& path,
                                    const std::vector<Plot>& plots,
                                    const std::vector<char>& are_free) {
  Eigen::AlignedBox3d box;
  double widest_m = 0.0;
  for (const std::uint32_t i : path) {
    box.extend(plots[i].position_m);
    widest_m = std::max(widest_m, kClutterNarrow.At(plots[i].ray_m.norm()));
  }
  const Eigen::AlignedBox3d near(box.min().array() - widest_m, box.max().array() + widest_m);
  std::vector<const Plot*> others;
  for (std::uint32_t k = 0; k < plots.size(); ++k) {
    if (are_free[k] == 0 || !near.contains(plots[k].position_m)) continue;
    if (!std::binary_search(path.begin(), path.end(), k)) others.push_back(&plots[k]);
  }
  return others;
}

// Returns the number of others within kCrowdingReachS of each of these times, in all. They ascend.
double NumWithinReach(const std::vector<TimeNs>& times_ns) {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  std::size_t count = 0;
  auto first = times_ns.begin();
  auto last = times_ns.begin();
  for (const TimeNs time_ns : times_ns) {
    while (*first < time_ns - reach_ns) ++first;
    while (last != times_ns.end() && *last <= time_ns + reach_ns) ++last;
    count += static_cast<std::size_t>(last - first) - 1;
  }
  return static_cast<double>(count);
}

}  // namespace

double CrowdingPenalty(const std::vector<std::uint32_t>& path, const std::vector<Plot>& plots,
                       const std::vector<char>& are_free,
                       const std::function<std::uint32_t(const Plot&)>& num_frames_about) {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  const std::vector<const Plot*> others = OthersNear(path, plots, are_free);
  std::vector<TimeNs> spot_times_ns;
  double penalty = 0.0;
  for (const std::uint32_t i : path) {
    const Plot& plot = plots[i];
    const double radius_m = kClutterNarrow.At(plot.ray_m.norm());
    const double spot_m = kSpotRadius.At(plot.ray_m.norm());
    double num_about = 0.0;
    spot_times_ns.clear();
    for (const Plot* const other : others) {
      if (other->sensor != plot.sensor) continue;
      const double distance_m = (other->position_m - plot.position_m).norm();
      if (std::abs(other->frame_time_ns - plot.frame_time_ns) <= reach_ns) {
        num_about += distance_m <= radius_m ? 1.0 : 0.0;
      } else if (distance_m <= spot_m && !plot.is_floating) {
        spot_times_ns.push_back(other->frame_time_ns);
      }
    }
    const double rate = std::exp(plot.log_clutter);
    const double num_frames = num_frames_about(plot);
    const double exposure = num_frames * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
    const double spot_exposure =
        static_cast<double>(spot_times_ns.size()) * num_frames * PlotVolumeM3(plot);
    const double crowded_rate =
        std::max(ClutterRate(num_about, exposure, rate),
                 ClutterRate(NumWithinReach(spot_times_ns), spot_exposure, rate));
    penalty += std::max(0.0, std::log(crowded_rate) - plot.log_clutter);
  }
  return penalty;
}

}  // namespace unlidar
