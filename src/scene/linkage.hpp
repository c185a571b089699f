// Returns that hang together: single linkage with a radius that grows with range.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/disjoint_sets.hpp"
#include "base/recording.hpp"
#include "scene/point_tree.hpp"
#include "scene/range_grid.hpp"

namespace unlidar {

// Joins points along a tree of boxes. Two boxes are looked into only if a pair between them may be
// near and they are not one group already. A box whose points are all near each other is one group,
// so that the work follows the boxes of the size of a radius, not the points in them: the time is
// nearly in proportion to the number of returns, however dense they lie.
//
// Its memory is used again: none is taken for a frame that shows no more than one before.
class Linker {
 public:
  // Finds the groups of `returns` (ascending indices of points), in the order of their first
  // members, each ascending. Two returns are joined that are nearer to each other than the radius
  // at the one with the lower x, or, where both have the same x, at the first of them. (Distances
  // and radii are floats: which pairs lie on the boundary is part of the definition.)
  void Link(const std::vector<Eigen::Vector3f>& points_m, const std::vector<std::uint32_t>& returns,
            const RangeRadius& radius);

  // The groups that were found last.
  std::size_t size() const { return ends_.size(); }
  IndexView operator[](std::size_t group) const {
    const std::uint32_t* const members = members_.data();
    return {members + (group == 0 ? 0 : ends_[group - 1]), members + ends_[group]};
  }

 private:
  // What is known of the points of a node.
  struct Box {
    float min_reach_m;
    float max_reach_m;
    bool is_connected;  // they belong together
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
  std::vector<float> reaches_m_;  // radius at each point, by leaf
  DisjointSets sets_;
  std::vector<Box> boxes_;              // by node
  std::vector<std::size_t> group_of_;   // (returns)
  std::vector<std::size_t> ends_;       // of the groups in `members_`
  std::vector<std::uint32_t> members_;  // by group
};

}  // namespace unlidar
