// Single-linkage clustering of returns with a radius that grows with range.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/disjoint_sets.hpp"
#include "base/point_tree.hpp"
#include "base/recording.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Joins points along a tree of boxes. A pair of boxes is descended only if points of both may be
// near each other and the boxes are not one group already. A box smaller than the radius is one
// group, so the work depends on the number of such boxes, not of the points in them: the time is
// nearly proportional to the number of returns, however dense.
//
// Memory is reused: a frame no larger than an earlier one allocates none.
class Linker {
 public:
  // Finds the groups of `returns` (ascending indices of points), in the order of their first
  // members, each ascending. Two returns are joined if they are nearer to each other than the
  // radius at the one with the lower x or, for equal x, at the first of them. (Distances and radii
  // are floats; their rounding at the boundary is part of the definition.)
  void Link(const std::vector<Eigen::Vector3f>& points_m, const std::vector<std::uint32_t>& returns,
            const RangeRadius& radius);

  // Groups of the last Link().
  std::size_t size() const { return begins_.size() - 1; }
  IndexView operator[](std::size_t group) const {
    const std::uint32_t* const members = members_.data();
    return {members + begins_[group], members + begins_[group + 1]};
  }

 private:
  // Bounds over the points of a node.
  struct Box {
    float min_reach_m;
    float max_reach_m;
    bool is_connected;  // all points are in one group
  };

  void SetBounds(std::size_t id);
  bool AreNear(std::uint32_t a, std::uint32_t b) const;
  bool MayBeNear(std::uint32_t a, std::uint32_t b) const;
  void Join(std::uint32_t a, std::uint32_t b);
  std::size_t SetOf(std::uint32_t one);
  bool AreConnected(std::uint32_t a, std::uint32_t b);
  void Connect(std::uint32_t id);
  void Connect(std::uint32_t a, std::uint32_t b);

  std::vector<Eigen::Vector3f> positions_m_;
  PointTree<float> tree_;
  std::vector<float> reaches_m_;  // radius at each point, in the order of the tree
  DisjointSets sets_;
  std::vector<Box> boxes_;                   // by node
  std::vector<std::uint32_t> group_of_;      // (returns)
  std::vector<std::uint32_t> begins_ = {0};  // (groups + 1) in `members_`
  std::vector<std::uint32_t> members_;       // by group
};

}  // namespace unlidar
