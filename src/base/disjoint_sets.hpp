// Union-find: disjoint sets of items that are merged repeatedly.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace unlidar {

// Initially each of the items 0 ... size - 1 is a set of its own.
class DisjointSets {
 public:
  DisjointSets() = default;
  explicit DisjointSets(std::size_t size) { Reset(size); }

  // Resets to `size` single-item sets; reuses the memory.
  void Reset(std::size_t size) {
    parents_.resize(size);
    std::iota(parents_.begin(), parents_.end(), std::size_t{0});
  }

  // Returns the lowest item of the set that contains `item`.
  std::size_t Find(std::size_t item) {
    while (parents_[item] != item) {
      parents_[item] = parents_[parents_[item]];
      item = parents_[item];
    }
    return item;
  }

  // Merges the sets of two items.
  void Join(std::size_t a, std::size_t b) {
    const std::size_t root_a = Find(a);
    const std::size_t root_b = Find(b);
    parents_[std::max(root_a, root_b)] = std::min(root_a, root_b);
  }

 private:
  std::vector<std::size_t> parents_;
};

}  // namespace unlidar
