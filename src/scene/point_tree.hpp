// Points in a tree of boxes.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace unlidar {

// Halves the points along the longest side of the box about them, down to a few points or to one
// place. Node 0 holds all, if there are any; children come after their parent.
//
// Rounding is monotone: a distance from or between boxes that is calculated as one of points is, as
// the nearest, at most, and as the farthest, at least the calculated distance of any points in
// them. No tolerance is needed.
template <class Scalar>
class PointTree {
 public:
  using Point = Eigen::Matrix<Scalar, 3, 1>;

  struct Node {
    Point low_m;  // corners of its box
    Point high_m;
    std::uint32_t begin = 0;  // its points are [begin, end) of points_m()
    std::uint32_t end = 0;
    std::uint32_t left = 0;  // its children, 0 for a leaf
    std::uint32_t right = 0;

    bool IsLeaf() const { return left == 0; }
  };

  PointTree() = default;
  explicit PointTree(const std::vector<Point>& points_m) { Reset(points_m); }

  // Begins anew, in the memory that it has.
  void Reset(const std::vector<Point>& points_m) {
    nodes_.clear();
    indices_.resize(points_m.size());
    std::iota(indices_.begin(), indices_.end(), 0U);
    if (!points_m.empty()) Build(points_m, 0, static_cast<std::uint32_t>(points_m.size()));
    points_m_.clear();
    points_m_.reserve(points_m.size());
    for (const std::uint32_t i : indices_) points_m_.push_back(points_m[i]);
  }

  const std::vector<Node>& nodes() const { return nodes_; }
  const std::vector<Point>& points_m() const { return points_m_; }  // leaf by leaf
  // Of points_m() as they were given; ascending within a leaf.
  const std::vector<std::uint32_t>& indices() const { return indices_; }

 private:
  static constexpr std::uint32_t kMaxLeafSize = 8;

  std::uint32_t Build(const std::vector<Point>& points_m, std::uint32_t begin, std::uint32_t end) {
    Node node;
    node.begin = begin;
    node.end = end;
    node.low_m = node.high_m = points_m[indices_[begin]];
    for (std::uint32_t i = begin; i < end; ++i) {
      node.low_m = node.low_m.cwiseMin(points_m[indices_[i]]);
      node.high_m = node.high_m.cwiseMax(points_m[indices_[i]]);
    }
    const auto id = static_cast<std::uint32_t>(nodes_.size());
    nodes_.push_back(node);
    if (end - begin <= kMaxLeafSize || node.low_m == node.high_m) {
      std::sort(indices_.begin() + begin, indices_.begin() + end);
    } else {
      Eigen::Index axis = 0;
      (node.high_m - node.low_m).maxCoeff(&axis);
      const std::uint32_t middle = begin + (end - begin) / 2;
      std::nth_element(
          indices_.begin() + begin, indices_.begin() + middle, indices_.begin() + end,
          [&](std::uint32_t a, std::uint32_t b) { return points_m[a][axis] < points_m[b][axis]; });
      const std::uint32_t left = Build(points_m, begin, middle);
      const std::uint32_t right = Build(points_m, middle, end);
      nodes_[id].left = left;
      nodes_[id].right = right;
    }
    return id;
  }

  std::vector<Node> nodes_;
  std::vector<Point> points_m_;
  std::vector<std::uint32_t> indices_;
};

}  // namespace unlidar
