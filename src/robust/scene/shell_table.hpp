// Tables of voxels whose size grows with range.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/voxel_grid.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Values by voxel. A neighbourhood is the block of 3 x 3 x 3 voxels about a point; voxels have an
// edge of 2/3 of the radius, so that the block reaches from 2/3 to 4/3 of it. Radii are stepped by
// sqrt(2) in shells of range. A point near a shell's border has a voxel in both shells, so that no
// neighbourhood ends there.
template <class Value>
class ShellTable {
 public:
  explicit ShellTable(RangeRadius radius) : radius_(radius) {
    constexpr double kMaxRange_m = 1e6;  // voxels grow no more beyond
    const double most = std::log2(radius.At(kMaxRange_m) / radius.constant_m);
    for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
      shells_.push_back({(std::exp2(0.5 * (shell - 0.5)) - 1.0) * radius.constant_m / radius.slope,
                         2.0 / 3.0 * radius.constant_m * std::exp2(0.5 * shell),
                         {}});
    }
  }

  // Calls visit(value, is_own) for the voxel of a point in each shell whose neighbourhoods may
  // reach it; `is_own` where neighbourhoods of the point itself lie. New voxels hold `initial`.
  template <class Visit>
  void VisitHomes(const Eigen::Vector3f& point_m, const Value& initial, const Visit& visit) {
    // The shells with a place near enough: a block reaches two edges along each axis.
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
      const VoxelKey key = VoxelOf(point_m, shells_[shell].edge_m);
      visit(shells_[shell].values.try_emplace(key, initial).first->second, shell == own);
    }
  }

  // Of the point's own voxel; null where there is none.
  Value* Find(const Eigen::Vector3f& point_m) {
    Shell& shell = ShellOf(point_m);
    const auto at = shell.values.find(VoxelOf(point_m, shell.edge_m));
    return at == shell.values.end() ? nullptr : &at->second;
  }

  // Calls visit(value) for the voxels in the neighbourhood of a point.
  template <class Visit>
  void VisitBlock(const Eigen::Vector3f& point_m, const Visit& visit) const {
    const Shell& shell = ShellOf(point_m);
    const Voxel home = VoxelAt(point_m, shell.edge_m);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const auto at = shell.values.find(KeyOf({home.x + dx, home.y + dy, home.z + dz}));
          if (at != shell.values.end()) visit(at->second);
        }
      }
    }
  }

  template <class Visit>
  void VisitBlock(const Eigen::Vector3f& point_m, const Visit& visit) {
    std::as_const(*this).VisitBlock(point_m,
                                    [&](const Value& value) { visit(const_cast<Value&>(value)); });
  }

  // Volume of the neighbourhood of a point.
  double VolumeM3(const Eigen::Vector3f& point_m) const {
    return std::pow(3.0 * ShellOf(point_m).edge_m, 3);
  }

  // Drops the voxels for which is_gone(value), which may change it.
  template <class IsGone>
  void EraseIf(const IsGone& is_gone) {
    for (Shell& shell : shells_) {
      for (auto at = shell.values.begin(); at != shell.values.end();) {
        at = is_gone(at->second) ? shell.values.erase(at) : std::next(at);
      }
    }
  }

  // Calls visit(value) for all voxels, in no order.
  template <class Visit>
  void VisitAll(const Visit& visit) const {
    for (const Shell& shell : shells_) {
      for (const auto& [key, value] : shell.values) visit(value);
    }
  }

 private:
  // Spreads the bits of a key: neighbours have neighbouring keys.
  struct Hash {
    std::size_t operator()(VoxelKey key) const {
      key ^= key >> 31U;
      key *= 0x9E3779B97F4A7C15ULL;
      return key ^ (key >> 29U);
    }
  };

  struct Shell {
    double begin_m;  // its least range,
    double edge_m;   // and the edge of its voxels
    std::unordered_map<VoxelKey, Value, Hash> values;
  };

  std::size_t ShellAt(double range_m) const {
    const double growth = std::log2(radius_.At(range_m) / radius_.constant_m);
    return std::min(static_cast<std::size_t>(std::floor(2.0 * growth + 0.5)), shells_.size() - 1);
  }
  const Shell& ShellOf(const Eigen::Vector3f& point_m) const {
    return shells_[ShellAt(static_cast<double>(point_m.norm()))];
  }
  Shell& ShellOf(const Eigen::Vector3f& point_m) {
    return shells_[ShellAt(static_cast<double>(point_m.norm()))];
  }

  RangeRadius radius_;
  std::vector<Shell> shells_;
};

}  // namespace unlidar
