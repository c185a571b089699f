// Hash table that numbers voxels.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/voxel_grid.hpp"

namespace unlidar {

// Numbers voxels from 0 in order of first use. Open addressing with linear probing, since nearly
// every return is looked up here. A voxel is identified by its key and by its grid, one of several.
class VoxelNumbers {
 public:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  std::uint32_t size() const { return size_; }

  // Returns the number of a voxel; kNone if it was never added.
  std::uint32_t Find(std::uint32_t grid, VoxelKey key) const {
    return slots_.empty() ? kNone : slots_[SlotOf(grid, key)].number;
  }

  std::uint32_t FindOrAdd(std::uint32_t grid, VoxelKey key) {
    if (2 * (static_cast<std::size_t>(size_) + 1) > slots_.size()) Grow();
    Slot& slot = slots_[SlotOf(grid, key)];
    if (slot.number == kNone) slot = {key, grid, size_++};
    return slot.number;
  }

  // Removes all voxels; keeps the memory.
  void Clear() {
    std::fill(slots_.begin(), slots_.end(), Slot());
    size_ = 0;
  }

  // Prefetches the slot of a voxel that will be looked up soon.
  void Prefetch(std::uint32_t grid, VoxelKey key) const {
    if (!slots_.empty()) __builtin_prefetch(&slots_[FirstSlotOf(grid, key)]);
  }

  // Replaces each number n by numbers[n]; kNone removes the voxel. `size`: number of voxels that
  // remain. Keeps the memory unless the table is far too large by then.
  void Renumber(const std::vector<std::uint32_t>& numbers, std::uint32_t size) {
    if (slots_.empty()) return;
    size_ = size;
    // Reinserts each voxel, starting behind a free slot, which no probe sequence crosses. Voxels
    // reinserted earlier can be found, and each voxel finds its old slot free at the latest.
    const auto is_free = [](const Slot& slot) { return slot.number == kNone; };
    const auto first = static_cast<std::size_t>(
        std::find_if(slots_.begin(), slots_.end(), is_free) - slots_.begin());
    for (std::size_t i = 1; i < slots_.size(); ++i) {
      Slot& slot = slots_[(first + i) & (slots_.size() - 1)];
      if (is_free(slot)) continue;
      Slot moved = slot;
      moved.number = numbers[slot.number];
      slot.number = kNone;
      if (!is_free(moved)) slots_[SlotOf(moved.grid, moved.key)] = moved;
    }
    if (const std::size_t enough = PowerAbove(size_); kShrinkFactor * enough <= slots_.size()) {
      MoveTo(enough);
    }
  }

 private:
  static constexpr std::size_t kMinSlots = 64;
  static constexpr std::size_t kShrinkFactor = 4;

  struct Slot {
    VoxelKey key = 0;
    std::uint32_t grid = 0;
    std::uint32_t number = kNone;
  };

  // Returns a table size that is between a quarter and half full.
  static std::size_t PowerAbove(std::size_t size) {
    std::size_t power = kMinSlots;
    while (power < 2 * (size + 1)) power *= 2;
    return power;
  }

  void Grow() { MoveTo(std::max(kMinSlots, 2 * slots_.size())); }

  // Rehashes into a table of another size.
  void MoveTo(std::size_t num_slots) {
    std::vector<Slot> old(num_slots);
    old.swap(slots_);
    for (const Slot& slot : old) {
      if (slot.number != kNone) slots_[SlotOf(slot.grid, slot.key)] = slot;
    }
  }

  // Returns the first slot of the probe sequence. Adjacent voxels have adjacent keys, so the bits
  // are mixed.
  std::size_t FirstSlotOf(std::uint32_t grid, VoxelKey key) const {
    std::uint64_t hash = (key ^ (static_cast<std::uint64_t>(grid) << 58U)) * 0x9E3779B97F4A7C15ULL;
    hash ^= hash >> 32U;
    hash *= 0xD6E8FEB86659FD93ULL;
    hash ^= hash >> 32U;
    return hash & (slots_.size() - 1);
  }

  // Returns the slot of a voxel, or the free slot for it.
  std::size_t SlotOf(std::uint32_t grid, VoxelKey key) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = FirstSlotOf(grid, key);
    while (slots_[at].number != kNone && (slots_[at].key != key || slots_[at].grid != grid)) {
      at = (at + 1) & mask;
    }
    return at;
  }

  std::vector<Slot> slots_;  // size is a power of two, at most half occupied
  std::uint32_t size_ = 0;
};

}  // namespace unlidar
