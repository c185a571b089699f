#include "linkage.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <utility>

#include "disjoint_sets.hpp"

namespace unlidar {
namespace {

struct Site {
  Eigen::Vector3f point_m;
  float reach_m;
  std::uint32_t index;
};

bool AreNear(const Site& a, const Site& b) {
  const bool is_a_first =
      a.point_m.x() < b.point_m.x() || (a.point_m.x() == b.point_m.x() && a.index < b.index);
  const float reach_m = is_a_first ? a.reach_m : b.reach_m;
  return (a.point_m - b.point_m).squaredNorm() < reach_m * reach_m;
}

// Joins sites along a tree of boxes. Two boxes are looked into only if a pair between them may be
// near and they are not one group already. A box whose sites are all near each other is one group,
// so that the work follows the boxes of the size of a radius, not the sites in them.
//
// Rounding is monotone, so a distance between boxes, calculated as that of two sites, bounds the
// calculated distances of all sites in them: no tolerance is needed.
class Linker {
 public:
  explicit Linker(std::vector<Site> sites) : sites_(std::move(sites)), sets_(sites_.size()) {
    if (sites_.empty()) return;
    Connect(Build(0, static_cast<std::uint32_t>(sites_.size())));
  }

  DisjointSets& sets() { return sets_; }

 private:
  static constexpr std::uint32_t kMinSplit = 8;  // fewer sites are compared one by one
  static constexpr std::uint32_t kNone = 0;      // no node's child is the root

  struct Node {
    Eigen::AlignedBox3f box_m;
    float least_reach_m;
    float greatest_reach_m;
    std::uint32_t begin;  // its sites are [begin, end)
    std::uint32_t end;
    std::uint32_t left = kNone;
    std::uint32_t right = kNone;
    bool is_one = false;  // its sites are known to be of one group
  };

  static float Square(float x) { return x * x; }

  static bool MayBeNear(const Node& a, const Node& b) {
    const Eigen::Vector3f gap_m = (b.box_m.min() - a.box_m.max())
                                      .cwiseMax(a.box_m.min() - b.box_m.max())
                                      .cwiseMax(Eigen::Vector3f::Zero());
    return gap_m.squaredNorm() < Square(std::max(a.greatest_reach_m, b.greatest_reach_m));
  }

  std::size_t GroupOf(const Node& one) { return sets_.Find(sites_[one.begin].index); }

  std::uint32_t Build(std::uint32_t begin, std::uint32_t end) {
    Node node;
    node.begin = begin;
    node.end = end;
    node.least_reach_m = node.greatest_reach_m = sites_[begin].reach_m;
    for (std::uint32_t i = begin; i < end; ++i) {
      node.box_m.extend(sites_[i].point_m);
      node.least_reach_m = std::min(node.least_reach_m, sites_[i].reach_m);
      node.greatest_reach_m = std::max(node.greatest_reach_m, sites_[i].reach_m);
    }
    const Eigen::Vector3f sizes_m = node.box_m.max() - node.box_m.min();
    node.is_one = sizes_m.squaredNorm() < Square(node.least_reach_m);
    const auto id = static_cast<std::uint32_t>(nodes_.size());
    nodes_.push_back(node);
    if (sizes_m.isZero(0.0F)) {
      nodes_[id].end = Coincide(begin, end);
    } else if (end - begin >= kMinSplit) {
      Eigen::Index axis = 0;
      sizes_m.maxCoeff(&axis);
      const std::uint32_t middle = begin + (end - begin) / 2;
      std::nth_element(
          sites_.begin() + begin, sites_.begin() + middle, sites_.begin() + end,
          [axis](const Site& a, const Site& b) { return a.point_m[axis] < b.point_m[axis]; });
      const std::uint32_t left = Build(begin, middle);
      const std::uint32_t right = Build(middle, end);
      nodes_[id].left = left;
      nodes_[id].right = right;
    }
    return id;
  }

  // Joins sites with the same coordinates. Their pairs with another site differ by whether they
  // come before or after it only: the first and the last stand for all. Returns the end of the two.
  std::uint32_t Coincide(std::uint32_t begin, std::uint32_t end) {
    std::sort(sites_.begin() + begin, sites_.begin() + end,
              [](const Site& a, const Site& b) { return a.index < b.index; });
    for (std::uint32_t i = begin + 1; i < end; ++i)
      sets_.Join(sites_[begin].index, sites_[i].index);
    if (end - begin > 2) std::swap(sites_[begin + 1], sites_[end - 1]);
    return std::min(begin + 2, end);
  }

  // Joins the near sites of a node.
  void Connect(std::uint32_t id) {
    const Node node = nodes_[id];
    if (node.is_one) {
      for (std::uint32_t i = node.begin + 1; i < node.end; ++i) {
        sets_.Join(sites_[node.begin].index, sites_[i].index);
      }
    } else if (node.left == kNone) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        for (std::uint32_t k = node.begin; k < i; ++k) {
          if (AreNear(sites_[k], sites_[i])) sets_.Join(sites_[k].index, sites_[i].index);
        }
      }
    } else {
      Connect(node.left);
      Connect(node.right);
      Connect(node.left, node.right);
      const Node& left = nodes_[node.left];
      const Node& right = nodes_[node.right];
      nodes_[id].is_one = left.is_one && right.is_one && GroupOf(left) == GroupOf(right);
    }
  }

  // Joins the near sites of two nodes.
  void Connect(std::uint32_t a, std::uint32_t b) {
    const Node& node_a = nodes_[a];
    const Node& node_b = nodes_[b];
    if (!MayBeNear(node_a, node_b)) return;
    const bool are_ones = node_a.is_one && node_b.is_one;
    if (are_ones && GroupOf(node_a) == GroupOf(node_b)) return;
    const bool splits_a =
        node_a.left != kNone && (node_b.left == kNone || node_a.box_m.sizes().squaredNorm() >=
                                                             node_b.box_m.sizes().squaredNorm());
    if (splits_a) {
      Connect(node_a.left, b);
      Connect(node_a.right, b);
      return;
    }
    if (node_b.left != kNone) {
      Connect(a, node_b.left);
      Connect(a, node_b.right);
      return;
    }
    for (std::uint32_t i = node_a.begin; i < node_a.end; ++i) {
      for (std::uint32_t k = node_b.begin; k < node_b.end; ++k) {
        if (!AreNear(sites_[i], sites_[k])) continue;
        sets_.Join(sites_[i].index, sites_[k].index);
        if (are_ones) return;
      }
    }
  }

  std::vector<Site> sites_;
  std::vector<Node> nodes_;
  DisjointSets sets_;
};

}  // namespace

std::vector<std::vector<std::uint32_t>> Link(const std::vector<Eigen::Vector3f>& points_m,
                                             const std::vector<std::uint32_t>& returns,
                                             const RangeRadius& radius) {
  std::vector<Site> sites;
  sites.reserve(returns.size());
  for (std::uint32_t i = 0; i < returns.size(); ++i) {
    const Eigen::Vector3f& point_m = points_m[returns[i]];
    const double range_m = static_cast<double>(point_m.norm());
    sites.push_back({point_m, static_cast<float>(radius.At(range_m)), i});
  }
  Linker linker(std::move(sites));
  std::vector<std::vector<std::uint32_t>> groups;
  std::vector<std::size_t> group_of(returns.size());
  for (std::size_t i = 0; i < returns.size(); ++i) {
    const std::size_t first = linker.sets().Find(i);
    if (first == i) {
      group_of[i] = groups.size();
      groups.emplace_back();
    }
    groups[group_of[first]].push_back(returns[i]);
  }
  return groups;
}

}  // namespace unlidar
