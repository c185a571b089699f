// How often something was seen about a place lately.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <unordered_map>

#include "live/voxel_shells.hpp"

namespace unlidar {

// Counts of points per voxel that fade by a factor of e in `fade_s`.
class FadingGrid {
 public:
  FadingGrid(RangeRadius radius, double fade_s) : shells_(radius), fade_s_(fade_s) {}

  // Times may come in any order; what is late by little is counted as if it were not.
  void Add(const Eigen::Vector3f& point_m, double time_s, double count = 1.0) {
    shells_.ForEachHome(point_m, [&](std::uint64_t key) {
      const auto [at, is_new] = counts_.try_emplace(key, Count{0.0, time_s});
      Count& seen = at->second;
      seen.count = seen.count * Fade(time_s - seen.time_s) + count;
      seen.time_s = std::max(seen.time_s, time_s);
    });
  }

  // In the neighbourhood of a point.
  double CountAt(const Eigen::Vector3f& point_m, double time_s) const {
    double sum = 0.0;
    for (const std::uint64_t key : shells_.NeighboursOf(point_m)) {
      const auto at = counts_.find(key);
      if (at != counts_.end()) sum += at->second.count * Fade(time_s - at->second.time_s);
    }
    return sum;
  }

  double VolumeM3(const Eigen::Vector3f& point_m) const { return shells_.VolumeM3(point_m); }

  // Forgets what has faded away. Call it now and then.
  void Sweep(double time_s) {
    constexpr double kForgotten = 0.02;
    for (auto at = counts_.begin(); at != counts_.end();) {
      const bool is_gone = at->second.count * Fade(time_s - at->second.time_s) < kForgotten;
      at = is_gone ? counts_.erase(at) : std::next(at);
    }
  }

  std::size_t size() const { return counts_.size(); }

 private:
  struct Count {
    double count = 0.0;
    double time_s = 0.0;
  };

  double Fade(double passed_s) const {
    return passed_s > 0.0 ? std::exp(-passed_s / fade_s_) : 1.0;
  }

  VoxelShells shells_;
  double fade_s_;
  std::unordered_map<std::uint64_t, Count, VoxelHash> counts_;
};

}  // namespace unlidar
