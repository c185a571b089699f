// Bounding-volume tree of points.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace unlidar {

// Splits the points at the median along the longest side of their bounding box, down to at most 8
// points or to coincident ones. Node 0 is the root, if there are any points; children follow their
// parent.
//
// Rounding is monotone: the smallest distance from or between boxes, if computed in the same way as
// the distance of two points, is never larger than the computed distance of any points in them, and
// the largest is never smaller. No tolerance is needed.
template <class Scalar>
class PointTree {
 public:
  using Point = Eigen::Matrix<Scalar, 3, 1>;

  struct Node {
    Point low_m;  // corners of the bounding box
    Point high_m;
    std::uint32_t begin = 0;  // range [begin, end) of points_m()
    std::uint32_t end = 0;
    std::uint32_t left = 0;  // children, 0 for a leaf
    std::uint32_t right = 0;
    std::uint32_t parent = 0;  // of the root itself
    std::uint32_t next = 0;    // past the node and all below it

    bool IsLeaf() const { return left == 0; }
  };

  PointTree() = default;
  explicit PointTree(const std::vector<Point>& points_m) { Reset(points_m); }

  // Rebuilds the tree; reuses the allocated memory.
  void Reset(const std::vector<Point>& points_m) {
    Reset(points_m.size(), [&](std::size_t i) -> const Point& { return points_m[i]; });
  }

  // The same of the points point_of(0) to point_of(num_points - 1).
  template <class PointOf>
  void Reset(std::size_t num_points, const PointOf& point_of) {
    nodes_.clear();
    indices_.resize(num_points);
    std::iota(indices_.begin(), indices_.end(), 0U);
    if (num_points > 0) Build(point_of, 0, static_cast<std::uint32_t>(num_points));
    points_m_.clear();
    points_m_.reserve(num_points);
    for (const std::uint32_t i : indices_) points_m_.push_back(point_of(i));
  }

  const std::vector<Node>& nodes() const { return nodes_; }
  const std::vector<Point>& points_m() const { return points_m_; }  // leaf by leaf
  // Index of each of points_m() in the input; ascending within a leaf.
  const std::vector<std::uint32_t>& indices() const { return indices_; }

 private:
  static constexpr std::uint32_t kMaxLeafSize = 8;

  template <class PointOf>
  std::uint32_t Build(const PointOf& point_of, std::uint32_t begin, std::uint32_t end) {
    Node node;
    node.begin = begin;
    node.end = end;
    node.low_m = node.high_m = point_of(indices_[begin]);
    for (std::uint32_t i = begin; i < end; ++i) {
      node.low_m = node.low_m.cwiseMin(point_of(indices_[i]));
      node.high_m = node.high_m.cwiseMax(point_of(indices_[i]));
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
          [&](std::uint32_t a, std::uint32_t b) { return point_of(a)[axis] < point_of(b)[axis]; });
      const std::uint32_t left = Build(point_of, begin, middle);
      const std::uint32_t right = Build(point_of, middle, end);
      nodes_[id].left = left;
      nodes_[id].right = right;
      nodes_[left].parent = nodes_[right].parent = id;
    }
    nodes_[id].next = static_cast<std::uint32_t>(nodes_.size());
    return id;
  }

  std::vector<Node> nodes_;
  std::vector<Point> points_m_;
  std::vector<std::uint32_t> indices_;
};

}  // namespace unlidar
