// Checks by the ranges of returns whether coordinates are metres relative to the sensor.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "unlidar/types.hpp"

namespace unlidar {

// Statistics of the ranges of returns, before any is dropped by range.
class RangeStatistics {
 public:
  // `range_m`: the norm of the point, finite.
  void Add(const Eigen::Vector3d& point_m, double range_m);

  // The returns added since the last call are those of a frame. Returns true if there are any.
  bool EndFrame();

  std::uint64_t returns() const { return returns_; }

  // Number of frames with returns.
  std::uint64_t frames() const { return frames_; }

  // Returns the share of returns beyond this range, rounded up by at most an eighth of an octave.
  double ShareBeyond(double range_m) const;

  // Returns the range below which this share of the returns lies, rounded down by as much.
  double Quantile(double share) const;

  // Distance of the mean from the origin, and of the returns from their mean (root mean square).
  double mean_m() const {
    return returns_ == 0 ? 0.0 : sum_m_.norm() / static_cast<double>(returns_);
  }
  double spread_m() const;

 private:
  // Histogram in eighths of octaves from 2^-10 to 2^54 m, by the leading bits of the number.
  static constexpr std::size_t kSteps = std::size_t{64} * 8;
  static std::size_t StepOf(double range_m);
  static double BeginOf(std::size_t step);

  std::array<std::uint64_t, kSteps> steps_{};
  std::uint64_t returns_ = 0;
  std::uint64_t frames_ = 0;
  std::uint64_t returns_before_ = 0;  // of the frames that have ended
  Eigen::Vector3d sum_m_ = Eigen::Vector3d::Zero();
  double sum_of_squares_m2_ = 0.0;
};

// Returns why the coordinates of a sensor cannot be metres and how to fix it, without its name.
// Metres: half of the returns lie within 500 m, or within a quarter of `max_range_m`
// (input.max_range_m) if that is more. Empty if so, if there are too few returns to judge, or if
// they are map coordinates that are not dropped by range.
std::optional<std::string> WhyNotMetres(const RangeStatistics& ranges, double max_range_m);

// Returns why the coordinates of a sensor look like centimetres though they are within reach:
// almost nothing is near, but returns span a wide range, like the surroundings of a station. Empty
// if not, or if there is too little data. Not certain: a LiDAR may see only distant objects.
std::optional<std::string> WhyCentimetres(const RangeStatistics& ranges);

// True if returns and frames are enough to make WhyNotMetres() an error: the few returns of an
// empty sky may all be distant noise.
bool SufficeToRefuse(const RangeStatistics& ranges);

// Returns a warning if all returns are about one far place, or nearly all nearer than any drone.
std::optional<Warning> WarningOfRanges(const std::string& sensor, const RangeStatistics& ranges,
                                       double max_range_m);

}  // namespace unlidar
