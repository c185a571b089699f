// Tables of voxels whose size grows with range.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/voxel_grid.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Numbers of voxels in shells, from 0 in the order in which they were first met: open addressing
// with linear probing, for nearly every return is looked up here.
class VoxelNumbers {
 public:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  std::uint32_t size() const { return size_; }

  // kNone for a voxel that was never added.
  std::uint32_t Find(std::uint32_t shell, VoxelKey key) const {
    return slots_.empty() ? kNone : slots_[SlotOf(shell, key)].number;
  }

  std::uint32_t FindOrAdd(std::uint32_t shell, VoxelKey key) {
    if (2 * (static_cast<std::size_t>(size_) + 1) > slots_.size()) Grow();
    Slot& slot = slots_[SlotOf(shell, key)];
    if (slot.number == kNone) slot = {key, shell, size_++};
    return slot.number;
  }

  // Takes on new numbers, by the old ones: kNone for voxels that are gone.
  void Renumber(const std::vector<std::uint32_t>& numbers, std::uint32_t size) {
    std::vector<Slot> old(std::max(kFewest, PowerAbove(size)));
    old.swap(slots_);
    size_ = size;
    for (const Slot& slot : old) {
      if (slot.number == kNone || numbers[slot.number] == kNone) continue;
      slots_[SlotOf(slot.shell, slot.key)] = {slot.key, slot.shell, numbers[slot.number]};
    }
  }

 private:
  static constexpr std::size_t kFewest = 64;

  struct Slot {
    VoxelKey key = 0;
    std::uint32_t shell = 0;
    std::uint32_t number = kNone;
  };

  // A table of this size is between a quarter and half full.
  static std::size_t PowerAbove(std::size_t size) {
    std::size_t power = kFewest;
    while (power < 2 * (size + 1)) power *= 2;
    return power;
  }

  void Grow() {
    std::vector<Slot> old(std::max(kFewest, 2 * slots_.size()));
    old.swap(slots_);
    for (const Slot& slot : old) {
      if (slot.number != kNone) slots_[SlotOf(slot.shell, slot.key)] = slot;
    }
  }

  // The slot of a voxel, or the free one that it would take. Neighbours have neighbouring keys: the
  // bits are spread.
  std::size_t SlotOf(std::uint32_t shell, VoxelKey key) const {
    std::uint64_t hash = (key ^ (static_cast<std::uint64_t>(shell) << 58U)) * 0x9E3779B97F4A7C15ULL;
    hash ^= hash >> 32U;
    hash *= 0xD6E8FEB86659FD93ULL;
    hash ^= hash >> 32U;
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = hash & mask;
    while (slots_[at].number != kNone && (slots_[at].key != key || slots_[at].shell != shell)) {
      at = (at + 1) & mask;
    }
    return at;
  }

  std::vector<Slot> slots_;  // a power of two, at most half of them taken
  std::uint32_t size_ = 0;
};

// Values by voxel. A neighbourhood is the block of 3 x 3 x 3 voxels about a point; voxels have an
// edge of 2/3 of the radius, so that the block reaches from 2/3 to 4/3 of it. Radii are stepped by
// sqrt(2) in shells of range. A point near a shell's border has a voxel in both shells, so that no
// neighbourhood ends there.
template <class Value>
class ShellTable {
 public:
  explicit ShellTable(RangeRadius radius) {
    constexpr double kMaxRange_m = 1e6;  // voxels grow no more beyond
    const double most = std::log2(radius.At(kMaxRange_m) / radius.constant_m);
    for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
      shells_.push_back({(std::exp2(0.5 * (shell - 0.5)) - 1.0) * radius.constant_m / radius.slope,
                         2.0 / 3.0 * radius.constant_m * std::exp2(0.5 * shell)});
    }
  }

  // How many voxels there are; they are numbered from 0 until some are erased.
  std::uint32_t size() const { return numbers_.size(); }

  // Calls visit(number, value, is_own) for the voxel of a point in each shell whose neighbourhoods
  // may reach it; `is_own` where neighbourhoods of the point itself lie. New voxels hold `initial`.
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
      const std::uint32_t number = numbers_.FindOrAdd(static_cast<std::uint32_t>(shell),
                                                      VoxelOf(point_m, shells_[shell].edge_m));
      if (number == values_.size()) values_.push_back(initial);
      visit(number, values_[number], shell == own);
    }
  }

  // Of the point's own voxel; null where there is none.
  Value* Find(const Eigen::Vector3f& point_m) {
    const std::size_t shell = ShellAt(static_cast<double>(point_m.norm()));
    const std::uint32_t number =
        numbers_.Find(static_cast<std::uint32_t>(shell), VoxelOf(point_m, shells_[shell].edge_m));
    return number == VoxelNumbers::kNone ? nullptr : &values_[number];
  }

  // Calls visit(value) for the voxels in the neighbourhood of a point.
  template <class Visit>
  void VisitBlock(const Eigen::Vector3f& point_m, const Visit& visit) const {
    VisitNumbers(point_m, [&](std::uint32_t number) { visit(values_[number]); });
  }

  template <class Visit>
  void VisitBlock(const Eigen::Vector3f& point_m, const Visit& visit) {
    VisitNumbers(point_m, [&](std::uint32_t number) { visit(values_[number]); });
  }

  // Volume of the neighbourhood of a point.
  double VolumeM3(const Eigen::Vector3f& point_m) const {
    return std::pow(3.0 * shells_[ShellAt(static_cast<double>(point_m.norm()))].edge_m, 3);
  }

  // Drops the voxels for which is_gone(value), which may change it. The others are renumbered.
  template <class IsGone>
  void EraseIf(const IsGone& is_gone) {
    std::vector<std::uint32_t> numbers(values_.size(), VoxelNumbers::kNone);
    std::uint32_t kept = 0;
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (is_gone(values_[i])) continue;
      numbers[i] = kept;
      if (kept != i) values_[kept] = std::move(values_[i]);
      ++kept;
    }
    if (kept == values_.size()) return;
    values_.erase(values_.begin() + kept, values_.end());
    numbers_.Renumber(numbers, kept);
  }

  // Calls visit(value) for all voxels, in the order in which they were first met.
  template <class Visit>
  void VisitAll(const Visit& visit) const {
    for (const Value& value : values_) visit(value);
  }

 private:
  struct Shell {
    double begin_m;  // its least range,
    double edge_m;   // and the edge of its voxels
  };

  std::size_t ShellAt(double range_m) const {
    const auto next =
        std::upper_bound(shells_.begin() + 1, shells_.end(), range_m,
                         [](double range, const Shell& shell) { return range < shell.begin_m; });
    return static_cast<std::size_t>(next - shells_.begin()) - 1;
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
  std::vector<Value> values_;  // by number
};

}  // namespace unlidar
