// What the very places of a target's returns show at other times.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/range_grid.hpp"
#include "scene/station_model.hpp"

namespace unlidar {

// Things that stand are hit at the same place to within the noise of a return, and surfaces are
// thin: in a neighbourhood of half a metre a lamp or the ground fills a hundredth of the room, and
// has a hundred times its rate.
class Spots {
 public:
  // `station_models`: (sensors). `candidates`: the returns that may be the target's, as indices
  // into the recording, ascending. Their places may be asked for; they do not count, as a target
  // may come back to where it was.
  Spots(const Recording& recording, const std::vector<StationModel>& station_models,
        const std::vector<std::uint32_t>& candidates);

  // Returns per m^3 and frame at the place of a candidate, as its station sees it in the bins that
  // do not touch [from, to], given the rate of its surroundings.
  double RateOutside(std::uint32_t sensor, const Eigen::Vector3f& point_m, TimeNs from_ns,
                     TimeNs to_ns, double surroundings_rate) const;

 private:
  const std::vector<StationModel>& station_models_;
  std::vector<std::size_t> stations_;  // (sensors)
  std::vector<RangeGrid> grids_;       // (stations)
};

}  // namespace unlidar
