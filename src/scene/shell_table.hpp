// Tables of voxels whose size grows with range.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/block_queue.hpp"
#include "base/recording.hpp"
#include "base/voxel_grid.hpp"
#include "base/voxel_numbers.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Numbers of the voxels of some points, each in its own shell: valid until voxels are erased.
struct OwnVoxels {
  std::vector<std::uint32_t> numbers;  // (points)
  std::uint32_t num_erasures = 0;      // of the table until then
};

// One value per voxel. A neighbourhood is the block of 3 x 3 x 3 voxels around a point; the voxel
// edge is 2/3 of the radius, so that the block extends 2/3 to 4/3 of the radius from the point.
// Radii grow by sqrt(2) from one range shell to the next. A point near the border of two shells has
// a voxel in both, so that neighbourhoods are not cut off there.
template <class Value>
class ShellTable {
 public:
  static constexpr int kNumNeighbourhoodVoxels = 27;

  explicit ShellTable(RangeRadius radius) {
    constexpr double kFarthestM = 1e6;  // voxels stop growing beyond
    const double most = std::log2(radius.At(kFarthestM) / radius.constant_m);
    for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
      const double edge_m = 2.0 / 3.0 * radius.constant_m * std::pow(2.0, 0.5 * shell);
      // A block extends at most two edges along each axis.
      shells_.push_back(
          {(std::pow(2.0, 0.5 * (shell - 0.5)) - 1.0) * radius.constant_m / radius.slope, edge_m,
           2.0 * std::sqrt(3.0) * edge_m});
    }
  }

  // Number of voxels. They are numbered from 0 and renumbered when some are erased.
  std::uint32_t size() const { return numbers_.size(); }

  // Calls visit(i, value, is_own) for the voxel of each point i in each shell whose neighbourhoods
  // may reach it; `is_own` is true for the point's own shell. New voxels are set to `initial`.
  // Voxels are prefetched. Sets `own`, if any, to those in the own shells.
  template <class Visit>
  void VisitOverlappingShells(PointsView points_m, const Value& initial, const Visit& visit,
                              OwnVoxels* own = nullptr) {
    if (own != nullptr) {
      own->numbers.resize(points_m.size());
      own->num_erasures = num_erasures_;
    }
    for (std::size_t begin = 0; begin < points_m.size(); begin += kPartSize) {
      const std::size_t end = std::min(begin + kPartSize, points_m.size());
      touched_.clear();
      for (std::size_t i = begin; i < end; ++i) TouchVoxelsOf(i, points_m[i]);
      for (Touched& touched : touched_) {
        touched.number = numbers_.FindOrAdd(touched.shell, touched.key, touched.hash);
        if (touched.number == values_.size()) {
          values_.push_back(initial);
          blocks_.Add(touched.shell, touched.key);
        }
        if (touched.is_own && own != nullptr) own->numbers[touched.point] = touched.number;
        PrefetchValue(touched.number);
      }
      for (const Touched& touched : touched_) {
        visit(touched.point, values_[touched.number], touched.is_own);
      }
    }
  }

  // Calls visit(i, value) for each point i whose own voxel is known; voxels are prefetched. Those
  // of `own`, if it is still valid, need not be looked up.
  template <class Visit>
  void VisitOwn(PointsView points_m, const OwnVoxels& own, const Visit& visit) {
    const bool are_known =
        own.numbers.size() == points_m.size() && own.num_erasures == num_erasures_;
    const auto find = [&](const Touched& touched) {
      return numbers_.Find(touched.shell, touched.key, touched.hash);
    };
    std::array<std::uint32_t, kPartSize> numbers{};
    for (std::size_t begin = 0; begin < points_m.size(); begin += kPartSize) {
      const std::size_t size = std::min(kPartSize, points_m.size() - begin);
      touched_.clear();
      for (std::size_t i = 0; i < size && !are_known; ++i) {
        const Home home = HomeOf(points_m[begin + i]);
        Touch(begin + i, home.shell, home.key, true);
      }
      for (std::size_t i = 0; i < size; ++i) {
        numbers[i] = are_known ? own.numbers[begin + i] : find(touched_[i]);
        if (numbers[i] != VoxelNumbers::kNone) PrefetchValue(numbers[i]);
      }
      for (std::size_t i = 0; i < size; ++i) {
        if (numbers[i] != VoxelNumbers::kNone) visit(begin + i, values_[numbers[i]]);
      }
    }
  }

  // Returns the number of the voxel of a point in its own shell; VoxelNumbers::kNone if it is not
  // known.
  std::uint32_t NumberOf(const Eigen::Vector3f& point_m) const {
    const Home home = HomeOf(point_m);
    return numbers_.Find(home.shell, home.key);
  }

  // Calls visit(value) for the voxels in the neighbourhood of a point.
  template <class Visit>
  void VisitNeighbourhood(const Eigen::Vector3f& point_m, const Visit& visit) const {
    const std::size_t shell_index = ShellAt(static_cast<double>(point_m.norm()));
    const Voxel home = VoxelAt(point_m, shells_[shell_index].edge_m);
    const auto shell = static_cast<std::uint32_t>(shell_index);
    if (!blocks_.MayHaveAround(shell, home)) return;  // as in the air
    // The table exceeds the cache: all slots are prefetched before the first one is read.
    struct Slot {
      VoxelKey key;
      std::uint32_t hash;
    };
    std::array<Slot, kNumNeighbourhoodVoxels> slots;
    auto next = slots.begin();
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          const VoxelKey key = KeyOf({home.x + dx, home.y + dy, home.z + dz});
          *next = {key, VoxelNumbers::HashOf(shell, key)};
          numbers_.Prefetch((next++)->hash);
        }
      }
    }
    std::array<std::uint32_t, kNumNeighbourhoodVoxels> numbers{};
    auto end = numbers.begin();
    for (const Slot& slot : slots) {
      const std::uint32_t number = numbers_.Find(shell, slot.key, slot.hash);
      if (number == VoxelNumbers::kNone) continue;
      PrefetchValue(number);
      *end++ = number;
    }
    std::for_each(numbers.begin(), end, [&](std::uint32_t number) { visit(values_[number]); });
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
    values_.Truncate(kept);
    ++num_erasures_;
    numbers_.Renumber(moved_, kept);
    blocks_.Clear();
    numbers_.VisitAll([&](std::uint32_t shell, VoxelKey key) { blocks_.Add(shell, key); });
  }

  // Calls visit(value) for all voxels, in order of creation.
  template <class Visit>
  void VisitAll(const Visit& visit) const {
    for (std::size_t i = 0; i < values_.size(); ++i) visit(values_[i]);
  }

  template <class Visit>
  void VisitAll(const Visit& visit) {
    for (std::size_t i = 0; i < values_.size(); ++i) visit(values_[i]);
  }

 private:
  // Voxels exceed the cache. They are prefetched for so many points at a time, which fit into it.
  static constexpr std::size_t kPartSize = 64;
  static constexpr std::size_t kCacheLineBytes = 64;

  // A voxel of a point, of its own shell or another.
  struct Touched {
    VoxelKey key;
    std::uint32_t point;
    std::uint32_t shell;
    std::uint32_t hash;
    bool is_own;
    std::uint32_t number = VoxelNumbers::kNone;
  };

  // The voxel of a point in its own shell.
  struct Home {
    double range_m;
    std::uint32_t shell;
    VoxelKey key;
  };

  struct Shell {
    double begin_m;  // smallest range
    double edge_m;   // voxel edge
    double reach_m;  // from a point to the farthest of its neighbourhood
  };

  std::size_t ShellAt(double range_m) const {
    const auto next =
        std::upper_bound(shells_.begin() + 1, shells_.end(), range_m,
                         [](double range, const Shell& shell) { return range < shell.begin_m; });
    return static_cast<std::size_t>(next - shells_.begin()) - 1;
  }

  Home HomeOf(const Eigen::Vector3f& point_m) const {
    const double range_m = static_cast<double>(point_m.norm());
    const std::size_t shell = ShellAt(range_m);
    return {range_m, static_cast<std::uint32_t>(shell), VoxelOf(point_m, shells_[shell].edge_m)};
  }

  void Touch(std::size_t point, std::uint32_t shell, VoxelKey key, bool is_own) {
    const std::uint32_t hash = VoxelNumbers::HashOf(shell, key);
    numbers_.Prefetch(hash);
    touched_.push_back({key, static_cast<std::uint32_t>(point), shell, hash, is_own});
  }

  // Touches the voxel of a point in each shell with a place near enough.
  void TouchVoxelsOf(std::size_t point, const Eigen::Vector3f& point_m) {
    const Home home = HomeOf(point_m);
    std::uint32_t first = home.shell;
    std::uint32_t last = home.shell;
    while (first > 0 && home.range_m - shells_[first].begin_m <= shells_[first - 1].reach_m) {
      --first;
    }
    while (last + 1 < shells_.size() &&
           shells_[last + 1].begin_m - home.range_m <= shells_[last + 1].reach_m) {
      ++last;
    }
    for (std::uint32_t shell = first; shell <= last; ++shell) {
      const bool is_own = shell == home.shell;
      Touch(point, shell, is_own ? home.key : VoxelOf(point_m, shells_[shell].edge_m), is_own);
    }
  }

  void PrefetchValue(std::uint32_t number) const {
    const char* const begin = reinterpret_cast<const char*>(&values_[number]);
    __builtin_prefetch(begin);
    if constexpr (sizeof(Value) > kCacheLineBytes) __builtin_prefetch(begin + kCacheLineBytes);
  }

  std::vector<Shell> shells_;
  VoxelNumbers numbers_;
  VoxelBlocks blocks_;
  BlockQueue<Value> values_;          // by number
  std::vector<std::uint32_t> moved_;  // new number of each voxel, during EraseIf()
  std::vector<Touched> touched_;      // by a part of the points
  std::uint32_t num_erasures_ = 0;    // so far
};

}  // namespace unlidar
