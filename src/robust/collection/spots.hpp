// What the very places of a target's returns show at other times.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "robust/scene/range_grid.hpp"
#include "robust/scene/sensor_view.hpp"

namespace unlidar {

// Things that stand are hit at the same place to within the noise of a return, and surfaces are
// thin: in a neighbourhood of half a metre a lamp or the ground fills a hundredth of the room, and
// has a hundred times its rate.
class Spots {
 public:
  // `views`: (sensors). `returns`: those that will be asked for, as indices into the recording.
  Spots(const Recording& recording, const std::vector<SensorView>& views,
        const std::vector<std::uint32_t>& returns);

  // Returns per m^3 and frame at the place of one of the returns, as its station sees it in the
  // bins that do not touch [from, to], given the rate of its surroundings.
  double RateOutside(std::uint32_t sensor, const Eigen::Vector3f& point_m, TimeNs from_ns,
                     TimeNs to_ns, double surroundings) const;

 private:
  const std::vector<SensorView>& views_;
  std::vector<std::size_t> stations_;  // (sensors)
  std::vector<RangeGrid> grids_;       // (stations)
};

}  // namespace unlidar
