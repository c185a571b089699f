#include "scene/linkage.hpp"

#include "base/algorithms.hpp"
#include "base/maths.hpp"

namespace unlidar {
namespace {

using Tree = PointTree<float>;

// Coincident points of a leaf differ in their pairs with another point only by whether they come
// before or after it, so the first and the last represent all.
std::uint32_t StepOf(const Tree::Node& leaf) {
  const std::uint32_t size = leaf.end - leaf.begin;
  return leaf.low_m == leaf.high_m && size > 1 ? size - 1 : 1;
}

}  // namespace

void Linker::Link(const std::vector<Eigen::Vector3f>& points_m,
                  const std::vector<std::uint32_t>& returns, const RangeRadius& radius) {
  positions_m_.clear();
  for (const std::uint32_t i : returns) positions_m_.push_back(points_m[i]);
  tree_.Reset(positions_m_);
  reaches_m_.clear();
  for (const Eigen::Vector3f& position_m : tree_.points_m()) {
    const auto range_m = static_cast<double>(position_m.norm());
    reaches_m_.push_back(static_cast<float>(radius.At(range_m)));
  }
  sets_.Reset(returns.size());
  boxes_.resize(tree_.nodes().size());
  for (std::size_t id = boxes_.size(); id-- > 0;) SetBounds(id);  // children before their parent
  if (!boxes_.empty()) Connect(0);
  std::uint32_t num_groups = 0;
  group_of_.resize(returns.size());
  for (std::size_t i = 0; i < returns.size(); ++i) {
    const std::size_t first = sets_.Find(i);
    group_of_[i] = first == i ? num_groups++ : group_of_[first];
  }
  members_.resize(returns.size());
  SortByGroup(group_of_, num_groups, &begins_,
              [&](std::size_t i, std::uint32_t at) { members_[at] = returns[i]; });
}

void Linker::SetBounds(std::size_t id) {
  const Tree::Node& node = tree_.nodes()[id];
  Box& box = boxes_[id];
  if (node.IsLeaf()) {
    const auto [least, greatest] =
        std::minmax_element(reaches_m_.begin() + node.begin, reaches_m_.begin() + node.end);
    box = {*least, *greatest, false};
  } else {
    const Box& left = boxes_[node.left];
    const Box& right = boxes_[node.right];
    box = {std::min(left.min_reach_m, right.min_reach_m),
           std::max(left.max_reach_m, right.max_reach_m), false};
  }
  box.is_connected = (node.high_m - node.low_m).squaredNorm() < Square(box.min_reach_m);
}

bool Linker::AreNear(std::uint32_t a, std::uint32_t b) const {
  const Eigen::Vector3f& point_a_m = tree_.points_m()[a];
  const Eigen::Vector3f& point_b_m = tree_.points_m()[b];
  const bool is_a_first =
      point_a_m.x() < point_b_m.x() ||
      (point_a_m.x() == point_b_m.x() && tree_.indices()[a] < tree_.indices()[b]);
  return (point_a_m - point_b_m).squaredNorm() < Square(reaches_m_[is_a_first ? a : b]);
}

bool Linker::MayBeNear(std::uint32_t a, std::uint32_t b) const {
  const Tree::Node& node_a = tree_.nodes()[a];
  const Tree::Node& node_b = tree_.nodes()[b];
  const Eigen::Vector3f gap_m = (node_b.low_m - node_a.high_m)
                                    .cwiseMax(node_a.low_m - node_b.high_m)
                                    .cwiseMax(Eigen::Vector3f::Zero());
  return gap_m.squaredNorm() < Square(std::max(boxes_[a].max_reach_m, boxes_[b].max_reach_m));
}

void Linker::Join(std::uint32_t a, std::uint32_t b) {
  sets_.Join(tree_.indices()[a], tree_.indices()[b]);
}

std::size_t Linker::SetOf(std::uint32_t one) {
  return sets_.Find(tree_.indices()[tree_.nodes()[one].begin]);
}

// Joins all near pairs of points within a node.
void Linker::Connect(std::uint32_t id) {
  const Tree::Node& node = tree_.nodes()[id];
  if (boxes_[id].is_connected) {
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
    boxes_[id].is_connected = AreConnected(node.left, node.right);
  }
}

bool Linker::AreConnected(std::uint32_t a, std::uint32_t b) {
  return boxes_[a].is_connected && boxes_[b].is_connected && SetOf(a) == SetOf(b);
}

// Joins all near pairs of points between two nodes.
void Linker::Connect(std::uint32_t a, std::uint32_t b) {
  if (!MayBeNear(a, b) || AreConnected(a, b)) return;
  const Tree::Node& node_a = tree_.nodes()[a];
  const Tree::Node& node_b = tree_.nodes()[b];
  if (node_a.IsLeaf() && node_b.IsLeaf()) {
    const bool are_connected = boxes_[a].is_connected && boxes_[b].is_connected;
    for (std::uint32_t i = node_a.begin; i < node_a.end; i += StepOf(node_a)) {
      for (std::uint32_t k = node_b.begin; k < node_b.end; k += StepOf(node_b)) {
        if (!AreNear(i, k)) continue;
        Join(i, k);
        if (are_connected) return;
      }
    }
    return;
  }
  const bool is_a_larger =
      (node_a.high_m - node_a.low_m).squaredNorm() >= (node_b.high_m - node_b.low_m).squaredNorm();
  if (node_b.IsLeaf() || (is_a_larger && !node_a.IsLeaf())) {
    Connect(node_a.left, b);
    Connect(node_a.right, b);
  } else {
    Connect(a, node_b.left);
    Connect(a, node_b.right);
  }
}

}  // namespace unlidar
