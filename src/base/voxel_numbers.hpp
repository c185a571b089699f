// Hash tables of voxels.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

#include "base/voxel_grid.hpp"

namespace unlidar {

// Numbers voxels from 0 in order of first use. Open addressing with linear probing, since nearly
// every return is looked up here. A voxel is identified by its key and by its grid, one of kGrids.
// Dense strays occupy hundreds of thousands: slots are small, and tables grow in small steps.
class VoxelNumbers {
 public:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  static constexpr std::uint32_t kGrids = 64;

  std::uint32_t size() const { return size_; }

  // Returns the hash of a voxel, which those who prefetch keep until they look it up. Adjacent
  // voxels have adjacent keys, so the bits are mixed.
  static std::uint32_t HashOf(std::uint32_t grid, VoxelKey key) {
    std::uint64_t hash = (key ^ (static_cast<std::uint64_t>(grid) << 58U)) * 0x9E3779B97F4A7C15ULL;
    hash ^= hash >> 32U;
    hash *= 0xD6E8FEB86659FD93ULL;
    return static_cast<std::uint32_t>(hash >> 32U);
  }

  // Returns the number of a voxel; kNone if it was never added.
  std::uint32_t Find(std::uint32_t grid, VoxelKey key) const {
    return Find(grid, key, HashOf(grid, key));
  }

  std::uint32_t Find(std::uint32_t grid, VoxelKey key, std::uint32_t hash) const {
    if (slots_.empty()) return kNone;
    const Slot& slot = slots_[SlotOf(grid, key, hash)];
    return slot.IsFree() ? kNone : slot.number;
  }

  std::uint32_t FindOrAdd(std::uint32_t grid, VoxelKey key) {
    return FindOrAdd(grid, key, HashOf(grid, key));
  }

  std::uint32_t FindOrAdd(std::uint32_t grid, VoxelKey key, std::uint32_t hash) {
    if (3 * (static_cast<std::size_t>(size_) + 1) > 2 * slots_.size()) {
      MoveTo(std::max(kMinSlots, 5 * slots_.size() / 4));
    }
    Slot& slot = slots_[SlotOf(grid, key, hash)];
    if (!slot.IsFree()) return slot.number;
    if (size_ == Slot::kFree) throw std::bad_alloc();
    slot = Slot(grid, key, size_);
    return size_++;
  }

  // Calls visit(grid, key) for all voxels.
  template <class Visit>
  void VisitAll(const Visit& visit) const {
    for (const Slot& slot : slots_) {
      if (!slot.IsFree()) visit(slot.grid, slot.Key());
    }
  }

  // Removes all voxels; keeps the memory.
  void Clear() {
    std::fill(slots_.begin(), slots_.end(), Slot());
    size_ = 0;
  }

  // Prefetches the slot of a voxel that will be looked up soon.
  void Prefetch(std::uint32_t hash) const {
    if (!slots_.empty()) __builtin_prefetch(&slots_[FirstSlotOf(hash)]);
  }

  // Replaces each number n by numbers[n]; kNone removes the voxel. `size`: number of voxels that
  // remain. Keeps the memory unless the table is far too large by then.
  void Renumber(const std::vector<std::uint32_t>& numbers, std::uint32_t size) {
    if (slots_.empty()) return;
    size_ = size;
    // Reinserts each voxel, starting behind a free slot, which no probe sequence crosses. Voxels
    // reinserted earlier can be found, and each voxel finds its old slot free at the latest.
    const auto is_free = [](const Slot& slot) { return slot.IsFree(); };
    const auto first = static_cast<std::size_t>(
        std::find_if(slots_.begin(), slots_.end(), is_free) - slots_.begin());
    std::size_t at = first;
    for (std::size_t i = 1; i < slots_.size(); ++i) {
      at = Next(at);
      Slot& slot = slots_[at];
      if (slot.IsFree()) continue;
      const Slot old = slot;
      slot = Slot();
      const std::uint32_t number = numbers[old.number];
      if (number == kNone) continue;
      slots_[SlotOf(old)] = Slot(old.grid, old.Key(), number);
    }
    // A table that is nearly as full as it may be.
    const std::size_t enough = std::max(kMinSlots, 7 * (std::size_t{size_} + 1) / 4);
    if (kShrinkFactor * enough <= slots_.size()) MoveTo(enough);
  }

 private:
  static constexpr std::size_t kMinSlots = 64;
  static constexpr std::size_t kShrinkFactor = 3;

  // 12 bytes, as a voxel has 63 bits.
  struct Slot {
    static constexpr std::uint32_t kFree = (1U << 26U) - 1;

    Slot() : grid(0), number(kFree) {}
    Slot(std::uint32_t its_grid, VoxelKey key, std::uint32_t its_number)
        : low(static_cast<std::uint32_t>(key)),
          high(static_cast<std::uint32_t>(key >> 32U)),
          grid(its_grid % kGrids),
          number(its_number & kFree) {}

    VoxelKey Key() const { return (VoxelKey{high} << 32U) | low; }
    bool IsFree() const { return number == kFree; }

    std::uint32_t low = 0;
    std::uint32_t high = 0;
    std::uint32_t grid : 6;
    std::uint32_t number : 26;
  };

  // Rehashes into a table of another size.
  void MoveTo(std::size_t num_slots) {
    std::vector<Slot> old(num_slots);
    old.swap(slots_);
    for (const Slot& slot : old) {
      if (!slot.IsFree()) slots_[SlotOf(slot)] = slot;
    }
  }

  // Returns the first slot of the probe sequence.
  std::size_t FirstSlotOf(std::uint32_t hash) const {
    return (static_cast<std::uint64_t>(hash) * slots_.size()) >> 32U;
  }

  std::size_t Next(std::size_t at) const { return at + 1 == slots_.size() ? 0 : at + 1; }

  // Returns the slot of a voxel, or the free slot for it.
  std::size_t SlotOf(std::uint32_t grid, VoxelKey key, std::uint32_t hash) const {
    std::size_t at = FirstSlotOf(hash);
    while (!slots_[at].IsFree() && (slots_[at].Key() != key || slots_[at].grid != grid)) {
      at = Next(at);
    }
    return at;
  }

  std::size_t SlotOf(const Slot& slot) const {
    const VoxelKey key = slot.Key();
    return SlotOf(slot.grid, key, HashOf(slot.grid, key));
  }

  std::vector<Slot> slots_;  // at most two thirds occupied
  std::uint32_t size_ = 0;
};

// Tells quickly that no voxel is about a place. Blocks of 4 x 4 x 4 voxels that have some: one bit
// for all blocks of the same hash. They fit into the cache, which the voxels exceed.
class VoxelBlocks {
 public:
  void Add(std::uint32_t grid, VoxelKey key) {
    const std::size_t bit = BitOf(grid, key);
    words_[bit / kWordBits] |= WordOf(bit);
  }

  // Returns false if no voxel was added that is at most one away along each axis.
  bool MayHaveAround(std::uint32_t grid, const Voxel& voxel) const {
    for (const int dx : {-1, 1}) {
      for (const int dy : {-1, 1}) {
        for (const int dz : {-1, 1}) {
          const std::size_t bit = BitOf(grid, KeyOf({voxel.x + dx, voxel.y + dy, voxel.z + dz}));
          if ((words_[bit / kWordBits] & WordOf(bit)) != 0) return true;
        }
      }
    }
    return false;
  }

  void Clear() { std::fill(words_.begin(), words_.end(), 0); }

 private:
  static constexpr std::size_t kWordBits = 64;
  static constexpr std::size_t kNumBits = std::size_t{1} << 18U;
  // Of each index the bits within a block.
  static constexpr VoxelKey kWithinBlock = (VoxelKey{3} << 42U) | (VoxelKey{3} << 21U) | 3U;

  static std::size_t BitOf(std::uint32_t grid, VoxelKey key) {
    return VoxelNumbers::HashOf(grid, key & ~kWithinBlock) % kNumBits;
  }
  static std::uint64_t WordOf(std::size_t bit) { return std::uint64_t{1} << (bit % kWordBits); }

  std::vector<std::uint64_t> words_ = std::vector<std::uint64_t>(kNumBits / kWordBits);
};

}  // namespace unlidar
