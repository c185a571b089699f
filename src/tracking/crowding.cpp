#include "tracking/crowding.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {

double CrowdingPenalty(const std::vector<std::uint32_t>& path, const std::vector<Plot>& plots,
                       const std::vector<char>& are_free,
                       const std::function<std::uint32_t(const Plot&)>& num_frames_about) {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  double penalty = 0.0;
  auto first = plots.begin();
  for (const std::uint32_t i : path) {
    const Plot& plot = plots[i];
    const double radius_m = kClutterNarrow.At(plot.ray_m.norm());
    while (first->frame_time_ns < plot.frame_time_ns - reach_ns) ++first;
    double others = 0.0;
    for (auto other = first;
         other != plots.end() && other->frame_time_ns <= plot.frame_time_ns + reach_ns; ++other) {
      const auto k = static_cast<std::uint32_t>(other - plots.begin());
      if (other->sensor != plot.sensor || are_free[k] == 0) continue;
      if ((other->position_m - plot.position_m).squaredNorm() > radius_m * radius_m) continue;
      if (!std::binary_search(path.begin(), path.end(), k)) others += 1.0;
    }
    if (others == 0.0) continue;
    const double exposure =
        num_frames_about(plot) * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
    const double log_rate = std::log(ClutterRate(others, exposure, std::exp(plot.log_clutter)));
    penalty += std::max(0.0, log_rate - plot.log_clutter);
  }
  return penalty;
}

}  // namespace unlidar
