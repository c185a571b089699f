// Tables of voxels whose size grows with range.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "base/voxel_grid.hpp"
#include "base/voxel_numbers.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// One value per voxel. A neighbourhood is the block of 3 x 3 x 3 voxels around a point; the voxel
// edge is 2/3 of the radius, so that the block extends 2/3 to 4/3 of the radius from the point.
// Radii grow by sqrt(2) from one range shell to the next. A point near the border of two shells has
// a voxel in both, so that neighbourhoods are not cut off there.
template <class Value>
class ShellTable {
 public:
  explicit ShellTable(RangeRadius radius) {
    constexpr double kMaxRange_m = 1e6;  // voxels stop growing beyond
    const double most = std::log2(radius.At(kMaxRange_m) / radius.constant_m);
    for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
      shells_.push_back(
          {(std::pow(2.0, 0.5 * (shell - 0.5)) - 1.0) * radius.constant_m / radius.slope,
           2.0 / 3.0 * radius.constant_m * std::pow(2.0, 0.5 * shell)});
    }
  }

  // Number of voxels. They are numbered from 0 and renumbered when some are erased.
  std::uint32_t size() const { return numbers_.size(); }

  // Calls visit(number, value, is_own) for the voxel of a point in each shell whose neighbourhoods
  // may reach it; `is_own` is true for the point's own shell. New voxels are set to `initial`.
  template <class Visit>
  void VisitOverlappingShells(const Eigen::Vector3f& point_m, const Value& initial,
                              const Visit& visit) {
    // Shells with a place near enough: a block extends at most two edges along each axis.
    const double range_m = static_cast<double>(point_m.norm());
    const auto reach_m = [&](std::size_t shell) {
      return 2.0 * std::sqrt(3.0) * shells_[shell].edge_m;
    };
    const std::size_t own = ShellAt(range_m);
    std::size_t first = own;
    std::size_t last = own;
    while (first > 0 && range_m - shells_[first].begin_m <= reach_m(first - 1)) --first;
    while (last + 1 < shells_.size() && shells_[last + 1].begin_m - range_m <= reach_m(last + 1)) {
      ++last;
    }
    for (std::size_t shell = first; shell <= last; ++shell) {
      const std::uint32_t number = numbers_.FindOrAdd(static_cast<std::uint32_t>(shell),
                                                      VoxelOf(point_m, shells_[shell].edge_m));
      if (number == values_.size()) values_.push_back(initial);
      visit(number, values_[number], shell == own);
    }
  }

  // Calls visit(i, value, is_own) in the same way for each point i, ahead of which its voxels are
  // prefetched.
  template <class Visit>
  void VisitOverlappingShells(PointsView points_m, const Value& initial, const Visit& visit) {
    for (std::size_t begin = 0; begin < points_m.size(); begin += kPartSize) {
      const std::size_t end = std::min(begin + kPartSize, points_m.size());
      touched_.clear();
      for (std::size_t i = begin; i < end; ++i) {
        PrefetchNumberAhead(points_m, i);
        VisitOverlappingShells(points_m[i], initial,
                               [&](std::uint32_t number, const Value&, bool is_own) {
                                 PrefetchValue(number);
                                 touched_.push_back({i, number, is_own});
                               });
      }
      for (const Touched& touched : touched_) {
        visit(touched.point, values_[touched.number], touched.is_own);
      }
    }
  }

  // Calls visit(i, value) for each point i whose own voxel is known, ahead of which it is
  // prefetched.
  template <class Visit>
  void VisitOwn(PointsView points_m, const Visit& visit) {
    found_.clear();
    for (std::size_t i = 0; i < points_m.size(); ++i) {
      PrefetchNumberAhead(points_m, i);
      const auto [shell, key] = OwnVoxelOf(points_m[i]);
      found_.push_back(numbers_.Find(shell, key));
    }
    for (std::size_t i = 0; i < points_m.size(); ++i) {
      const std::size_t ahead = i + kPrefetchDistance;
      if (ahead < found_.size() && found_[ahead] != VoxelNumbers::kNone) {
        PrefetchValue(found_[ahead]);
      }
      if (found_[i] != VoxelNumbers::kNone) visit(i, values_[found_[i]]);
    }
  }

  // Calls visit(value) for the voxels in the neighbourhood of a point.
  template <class Visit>
  void VisitNeighbourhood(const Eigen::Vector3f& point_m, const Visit& visit) const {
    VisitNumbers(point_m, [&](std::uint32_t number) { visit(values_[number]); });
  }

  template <class Visit>
  void VisitNeighbourhood(const Eigen::Vector3f& point_m, const Visit& visit) {
    VisitNumbers(point_m, [&](std::uint32_t number) { visit(values_[number]); });
  }

  // Volume of the neighbourhood of a point, m^3.
  double VolumeM3(const Eigen::Vector3f& point_m) const {
    return std::pow(3.0 * shells_[ShellAt(static_cast<double>(point_m.norm()))].edge_m, 3);
  }

  // Erases the voxels for which is_gone(value) returns true; it may modify the value. The others
  // are renumbered.
  template <class IsGone>
  void EraseIf(const IsGone& is_gone) {
    moved_.reserve(values_.capacity());
    moved_.assign(values_.size(), VoxelNumbers::kNone);
    std::uint32_t kept = 0;
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (is_gone(values_[i])) continue;
      moved_[i] = kept;
      if (kept != i) values_[kept] = std::move(values_[i]);
      ++kept;
    }
    if (kept == values_.size()) return;
    values_.erase(values_.begin() + kept, values_.end());
    numbers_.Renumber(moved_, kept);
  }

  // Calls visit(value) for all voxels, in order of creation.
  template <class Visit>
  void VisitAll(const Visit& visit) const {
    for (const Value& value : values_) visit(value);
  }

  template <class Visit>
  void VisitAll(const Visit& visit) {
    for (Value& value : values_) visit(value);
  }

 private:
  // Voxels are prefetched this many points ahead: they exceed the cache.
  static constexpr std::size_t kPrefetchDistance = 16;
  static constexpr std::size_t kPartSize = 64;  // points whose voxels fit into the cache
  static constexpr std::size_t kCacheLineBytes = 64;

  // A voxel of a point, of its own shell or another.
  struct Touched {
    std::size_t point;
    std::uint32_t number;
    bool is_own;
  };

  struct Shell {
    double begin_m;  // smallest range
    double edge_m;   // voxel edge
  };

  std::size_t ShellAt(double range_m) const {
    const auto next =
        std::upper_bound(shells_.begin() + 1, shells_.end(), range_m,
                         [](double range, const Shell& shell) { return range < shell.begin_m; });
    return static_cast<std::size_t>(next - shells_.begin()) - 1;
  }

  std::pair<std::uint32_t, VoxelKey> OwnVoxelOf(const Eigen::Vector3f& point_m) const {
    const std::size_t shell = ShellAt(static_cast<double>(point_m.norm()));
    return {static_cast<std::uint32_t>(shell), VoxelOf(point_m, shells_[shell].edge_m)};
  }

  void PrefetchNumberAhead(PointsView points_m, std::size_t i) const {
    if (i + kPrefetchDistance >= points_m.size()) return;
    const auto [shell, key] = OwnVoxelOf(points_m[i + kPrefetchDistance]);
    numbers_.Prefetch(shell, key);
  }

  void PrefetchValue(std::uint32_t number) const {
    const char* const begin = reinterpret_cast<const char*>(&values_[number]);
    __builtin_prefetch(begin);
    if constexpr (sizeof(Value) > kCacheLineBytes) __builtin_prefetch(begin + kCacheLineBytes);
  }

  template <class Visit>
  void VisitNumbers(const Eigen::Vector3f& point_m, const Visit& visit) const {
    const std::size_t shell = ShellAt(static_cast<double>(point_m.norm()));
    const Voxel home = VoxelAt(point_m, shells_[shell].edge_m);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const std::uint32_t number = numbers_.Find(
              static_cast<std::uint32_t>(shell), KeyOf({home.x + dx, home.y + dy, home.z + dz}));
          if (number != VoxelNumbers::kNone) visit(number);
        }
      }
    }
  }

  std::vector<Shell> shells_;
  VoxelNumbers numbers_;
  std::vector<Value> values_;         // by number
  std::vector<std::uint32_t> moved_;  // new number of each voxel, during EraseIf()
  std::vector<Touched> touched_;      // of a part of the points, during VisitOverlappingShells()
  std::vector<std::uint32_t> found_;  // (points) during VisitOwn()
};

}  // namespace unlidar
