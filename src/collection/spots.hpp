// Clutter rate at the exact positions of a target's returns.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/range_grid.hpp"
#include "scene/stations.hpp"

namespace unlidar {

// Static objects are hit at the same position to within the noise of a return, and surfaces are
// thin: a lamp or the ground fills a hundredth of a neighbourhood of half a metre with a hundred
// times its rate.
class Spots {
 public:
  // `station_models`: (sensors). `candidates`: returns that may be the target's, as ascending
  // indices into the recording. Rates are available at their positions; the candidates do not
  // count, as a target may return to a place.
  Spots(const Recording& recording, const std::vector<StationModel>& station_models,
        const std::vector<std::uint32_t>& candidates);

  // Clutter rate in returns per m^3 and frame at the position of a candidate, as its station sees
  // it in the bins that do not touch [from_ns, to_ns]. The rate of the surroundings is the prior.
  double RateOutside(std::uint32_t sensor, const Eigen::Vector3f& point_m, TimeNs from_ns,
                     TimeNs to_ns, double surroundings_rate) const;

 private:
  const std::vector<StationModel>& station_models_;
  std::vector<std::size_t> stations_;  // (sensors)
  std::vector<RangeGrid> grids_;       // (stations)
};

}  // namespace unlidar
