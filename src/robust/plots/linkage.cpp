#include "robust/plots/linkage.hpp"

#include <algorithm>
#include <cstddef>

#include "base/disjoint_sets.hpp"
#include "robust/plots/point_tree.hpp"

namespace unlidar {
namespace {

using Tree = PointTree<float>;

float Square(float x) { return x * x; }

// Joins points along a tree of boxes. Two boxes are looked into only if a pair between them may be
// near and they are not one group already. A box whose points are all near each other is one group,
// so that the work follows the boxes of the size of a radius, not the points in them.
class Linker {
 public:
  // `reaches_m`: radius at each point.
  Linker(const std::vector<Eigen::Vector3f>& points_m, const std::vector<float>& reaches_m)
      : tree_(points_m), sets_(points_m.size()), groups_(tree_.nodes().size()) {
    for (const std::uint32_t i : tree_.indices()) reaches_m_.push_back(reaches_m[i]);
    for (std::size_t id = groups_.size(); id-- > 0;) Describe(id);  // children before their parent
    if (!groups_.empty()) Connect(0);
  }

  DisjointSets& sets() { return sets_; }

 private:
  // What is known of the points of a node.
  struct Group {
    float least_reach_m;
    float greatest_reach_m;
    bool is_one;  // they belong together
  };

  void Describe(std::size_t id) {
    const Tree::Node& node = tree_.nodes()[id];
    Group& group = groups_[id];
    if (node.IsLeaf()) {
      const auto [least, greatest] =
          std::minmax_element(reaches_m_.begin() + node.begin, reaches_m_.begin() + node.end);
      group = {*least, *greatest, false};
    } else {
      const Group& left = groups_[node.left];
      const Group& right = groups_[node.right];
      group = {std::min(left.least_reach_m, right.least_reach_m),
               std::max(left.greatest_reach_m, right.greatest_reach_m), false};
    }
    group.is_one = (node.high_m - node.low_m).squaredNorm() < Square(group.least_reach_m);
  }

  bool AreNear(std::uint32_t a, std::uint32_t b) const {
    const Eigen::Vector3f& point_a_m = tree_.points_m()[a];
    const Eigen::Vector3f& point_b_m = tree_.points_m()[b];
    const bool is_a_first =
        point_a_m.x() < point_b_m.x() ||
        (point_a_m.x() == point_b_m.x() && tree_.indices()[a] < tree_.indices()[b]);
    return (point_a_m - point_b_m).squaredNorm() < Square(reaches_m_[is_a_first ? a : b]);
  }

  bool MayBeNear(std::uint32_t a, std::uint32_t b) const {
    const Tree::Node& node_a = tree_.nodes()[a];
    const Tree::Node& node_b = tree_.nodes()[b];
    const Eigen::Vector3f gap_m = (node_b.low_m - node_a.high_m)
                                      .cwiseMax(node_a.low_m - node_b.high_m)
                                      .cwiseMax(Eigen::Vector3f::Zero());
    return gap_m.squaredNorm() <
           Square(std::max(groups_[a].greatest_reach_m, groups_[b].greatest_reach_m));
  }

  void Join(std::uint32_t a, std::uint32_t b) {
    sets_.Join(tree_.indices()[a], tree_.indices()[b]);
  }

  std::size_t SetOf(std::uint32_t one) {
    return sets_.Find(tree_.indices()[tree_.nodes()[one].begin]);
  }

  // Points of a leaf with one place differ in their pairs with another one only by whether they
  // come before or after it: the first and the last stand for all.
  static std::uint32_t StepOf(const Tree::Node& leaf) {
    const std::uint32_t size = leaf.end - leaf.begin;
    return leaf.low_m == leaf.high_m && size > 1 ? size - 1 : 1;
  }

  // Joins the near points of a node.
  void Connect(std::uint32_t id) {
    const Tree::Node& node = tree_.nodes()[id];
    if (groups_[id].is_one) {
      for (std::uint32_t i = node.begin + 1; i < node.end; ++i) Join(node.begin, i);
    } else if (node.IsLeaf()) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        for (std::uint32_t k = node.begin; k < i; ++k) {
          if (AreNear(k, i)) Join(k, i);
        }
      }
    } else {
      Connect(node.left);
      Connect(node.right);
      Connect(node.left, node.right);
      groups_[id].is_one = AreOne(node.left, node.right);
    }
  }

  bool AreOne(std::uint32_t a, std::uint32_t b) {
    return groups_[a].is_one && groups_[b].is_one && SetOf(a) == SetOf(b);
  }

  // Joins the near points of two nodes.
  void Connect(std::uint32_t a, std::uint32_t b) {
    if (!MayBeNear(a, b) || AreOne(a, b)) return;
    const Tree::Node& node_a = tree_.nodes()[a];
    const Tree::Node& node_b = tree_.nodes()[b];
    if (node_a.IsLeaf() && node_b.IsLeaf()) {
      const bool are_ones = groups_[a].is_one && groups_[b].is_one;
      for (std::uint32_t i = node_a.begin; i < node_a.end; i += StepOf(node_a)) {
        for (std::uint32_t k = node_b.begin; k < node_b.end; k += StepOf(node_b)) {
          if (!AreNear(i, k)) continue;
          Join(i, k);
          if (are_ones) return;
        }
      }
      return;
    }
    const bool is_a_larger = (node_a.high_m - node_a.low_m).squaredNorm() >=
                             (node_b.high_m - node_b.low_m).squaredNorm();
    if (node_b.IsLeaf() || (is_a_larger && !node_a.IsLeaf())) {
      Connect(node_a.left, b);
      Connect(node_a.right, b);
    } else {
      Connect(a, node_b.left);
      Connect(a, node_b.right);
    }
  }

  Tree tree_;
  std::vector<float> reaches_m_;  // by leaf
  DisjointSets sets_;
  std::vector<Group> groups_;  // by node
};

}  // namespace

std::vector<std::vector<std::uint32_t>> Link(const std::vector<Eigen::Vector3f>& points_m,
                                             const std::vector<std::uint32_t>& returns,
                                             const RangeRadius& radius) {
  std::vector<Eigen::Vector3f> sites_m;
  std::vector<float> reaches_m;
  sites_m.reserve(returns.size());
  reaches_m.reserve(returns.size());
  for (const std::uint32_t i : returns) {
    sites_m.push_back(points_m[i]);
    const auto range_m = static_cast<double>(points_m[i].norm());
    reaches_m.push_back(static_cast<float>(radius.At(range_m)));
  }
  Linker linker(sites_m, reaches_m);
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
