// Whether coordinates are metres about the sensor, by how far the returns lie.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "unlidar/types.hpp"

namespace unlidar {

// How far the returns of some frames lie, before any is dropped for its range.
class RangeStatistics {
 public:
  // `range_m`: the norm of the point, finite.
  void Add(const Eigen::Vector3d& point_m, double range_m);
  void Add(const RangeStatistics& frame);

  std::uint64_t returns() const { return returns_; }

  // How many statistics with a return were added.
  std::uint64_t frames() const { return frames_; }

  // The share of the returns beyond this range and an eighth of its octave.
  double ShareBeyond(double range_m) const;

  // A range that this share of the returns do not reach, an eighth of an octave or less too short.
  double Quantile(double share) const;

  // Distance of the mean from the origin, and of the returns from their mean (root mean square).
  double mean_m() const;
  double spread_m() const;

 private:
  // Eighths of octaves, by the first bits of the number itself: from 2^-10 to 2^54.
  static constexpr std::size_t kSteps = std::size_t{64} * 8;
  static std::size_t StepOf(double range_m);
  static double BeginOf(std::size_t step);

  std::array<std::uint64_t, kSteps> steps_{};
  std::uint64_t returns_ = 0;
  std::uint64_t frames_ = 0;
  Eigen::Vector3d sum_m_ = Eigen::Vector3d::Zero();
  double sum_of_squares_m2_ = 0.0;
};

// Whether the coordinates of a sensor can be metres: half of the returns lie within 500 m, or
// within a quarter of input.max_range_m where that is more. `max_range_m`: that. Empty if so, or if
// there are too few returns to tell, or if they are of a map and not dropped for their range; else
// what is wrong and what helps, without the name.
std::optional<std::string> WhyNotMetres(const RangeStatistics& ranges, double max_range_m);

// Why the coordinates of a sensor look like centimetres though they are within reach: nearly
// nothing is near, but much over a wide span of ranges, as a station sees its own surroundings.
// Empty if they do not, or if there is too little to tell. A doubt: a LiDAR may look afar alone.
std::optional<std::string> WhyCentimetres(const RangeStatistics& ranges);

// Whether there are so many returns, of so many frames, that WhyNotMetres() is an error: the few
// that an empty sky gives may all be noise from afar.
bool SufficeToRefuse(const RangeStatistics& ranges);

// A warning where all returns are about one place far from the origin, or nearly all are nearer
// than any drone.
std::optional<Warning> WarningOfRanges(const std::string& sensor, const RangeStatistics& ranges,
                                       double max_range_m);

}  // namespace unlidar
