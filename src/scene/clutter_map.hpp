// Plots around each place by time bin, from which clutter intensities are estimated.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/range_grid.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// The narrowest neighbourhood, of a branch.
constexpr RangeRadius kClutterNarrow{1.5, 0.04};

// Counts the plots of each sensor of a station in neighbourhoods of three sizes and at the spot of
// a static object. Bins within kExclusionBins of a plot's own do not count towards its
// clutter: a target takes about that long to leave its place.
class ClutterMap {
 public:
  static constexpr std::size_t kNumLevels = 3;
  // Levels of a map in the axes of a carrier that travels: clutter of the same kind comes by again
  // along its way, but no spot does.
  static constexpr std::size_t kNumAlongLevels = 2;
  static constexpr std::uint32_t kExclusionBins = 2;

  using LevelCounts = std::array<std::uint32_t, kNumLevels>;

  // The plots of other times in a neighbourhood, and its volume.
  struct Level {
    std::uint32_t count = 0;
    double volume_m3 = 0.0;
  };

  // Adds a plot, or removes it again if `count` is -1. `place_m`: in the scene of its station.
  void Add(std::uint32_t sensor, const Eigen::Vector3f& place_m, std::uint32_t bin,
           std::int32_t count = 1);

  // Returns the plots of the bins excluded for a plot of this bin, from the widest neighbourhood to
  // the narrowest. Faster, the fewer later bins there are.
  LevelCounts ExcludedAt(std::uint32_t sensor, const Eigen::Vector3f& place_m,
                         std::uint32_t bin) const;

  using Levels = std::array<Level, kNumLevels>;

  // Returns the levels from the widest to the narrowest. `excluded`: result of ExcludedAt().
  Levels LevelsAt(std::uint32_t sensor, const Eigen::Vector3f& place_m,
                  const LevelCounts& excluded) const;

  // Returns the plots at a spot in the bins excluded for a plot of this bin, or in all bins.
  std::uint32_t ExcludedAtSpot(std::uint32_t sensor, const Eigen::Vector3f& place_m,
                               std::uint32_t bin) const;
  std::uint32_t AllAtSpot(std::uint32_t sensor, const Eigen::Vector3f& place_m) const;

  // Returns the volume in which plots count to a spot.
  double SpotVolumeM3(std::uint32_t sensor, const Eigen::Vector3f& place_m) const;

  // Forgets the plots of earlier bins.
  void Forget(std::uint32_t before_bin);

  // Returns the bins excluded for a plot.
  static BinRange Excluded(std::uint32_t bin) {
    return {bin - std::min(bin, kExclusionBins), bin + kExclusionBins + 1};
  }

 private:
  struct Sensor {
    Sensor();

    std::array<RangeGrid, kNumLevels> levels;
    RangeGrid spots;
  };

  const Sensor& SensorAt(std::uint32_t sensor) const;

  std::vector<Sensor> sensors_;
};

// Returns the clutter intensity (plots per m^3 and frame) at a place, method.md (2), given the
// plots of other times around it and the number of frames that could have shown them. Each level is
// the prior of the next, so that an empty neighbourhood takes the rate of its surroundings, and a
// level is weighted by its exposure. `num_excluded`: of the plots in every level. `num_levels`: of
// the widest.
double RateAtOtherTimes(const ClutterMap::Levels& levels, double num_frames,
                        std::uint32_t num_excluded, std::size_t num_levels);

}  // namespace unlidar
