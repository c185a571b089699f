// Single-linkage clustering of returns with a radius that grows with range, and the groups of
// strays that it joins by chance.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
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

// Returns the rate of groups of `count` strays, per m^3 and frame, of a Poisson process of `rate`
// returns per m^3 and frame that are joined within `radius_m`: with mu others within reach of each,
// the group of one of them is as large as the progeny of a branching process (Borel 1942),
//
//     rate / n exp(-mu n) (mu n)^(n - 1) / n!
//
// Infinite from mu = 1 on, where chains need not end.
inline double StrayGroupRate(double rate, double radius_m, double count) {
  const double mu = rate * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
  if (mu >= 1.0) return std::numeric_limits<double>::infinity();
  if (mu <= 0.0) return 0.0;
  return rate / count *
         std::exp(-mu * count + (count - 1.0) * std::log(mu * count) - std::lgamma(count + 1.0));
}

// Returns the rate of all groups that are each rarer than `max_rate`, per m^3 and frame. The rate
// of groups of any size is rate (1 - mu / 2), and the larger, the rarer they are.
inline double RareStrayGroupRate(double rate, double radius_m, double max_rate) {
  const double mu = rate * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
  if (mu >= 1.0) return 0.0;
  double rare = rate * (1.0 - 0.5 * mu);
  for (double count = 1.0;; count += 1.0) {
    const double of_count = StrayGroupRate(rate, radius_m, count);
    if (of_count < max_rate) return std::max(rare, 0.0);
    rare -= of_count;
  }
}

}  // namespace unlidar
