// Recent number of points about each place.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "scene/shell_table.hpp"

namespace unlidar {

// Counts of points per voxel that fade by a factor of e in `fade_s`.
class FadingGrid {
 public:
  FadingGrid(RangeRadius radius, double fade_s) : counts_(radius), fade_s_(fade_s) {}

  // Times may come in any order; a slightly late point counts in full.
  void Add(const Eigen::Vector3f& point_m, double time_s, double count = 1.0) {
    counts_.VisitOverlappingShells(point_m, {0.0, time_s}, [&](std::uint32_t, Count& seen, bool) {
      seen.count = seen.count * Fade(time_s - seen.time_s) + count;
      seen.time_s = std::max(seen.time_s, time_s);
    });
  }

  // Returns the count in the neighbourhood of a point.
  double CountAt(const Eigen::Vector3f& point_m, double time_s) const {
    double sum = 0.0;
    counts_.VisitNeighbourhood(
        point_m, [&](const Count& seen) { sum += seen.count * Fade(time_s - seen.time_s); });
    return sum;
  }

  double VolumeM3(const Eigen::Vector3f& point_m) const { return counts_.VolumeM3(point_m); }

  // Erases counts that have faded. To be called periodically.
  void Sweep(double time_s) {
    constexpr double kForgotten = 0.02;
    counts_.EraseIf(
        [&](const Count& seen) { return seen.count * Fade(time_s - seen.time_s) < kForgotten; });
  }

 private:
  struct Count {
    double count = 0.0;
    double time_s = 0.0;
  };

  double Fade(double passed_s) const {
    return passed_s > 0.0 ? std::exp(-passed_s / fade_s_) : 1.0;
  }

  ShellTable<Count> counts_;
  double fade_s_;
};

}  // namespace unlidar
