#include "base/point_tree.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::Random;

using Tree = PointTree<double>;

std::vector<Eigen::Vector3d> Points(std::size_t count, Random* random) {
  std::vector<Eigen::Vector3d> points_m;
  for (std::size_t i = 0; i < count; ++i) points_m.push_back(random->NormalVector(10.0));
  for (std::size_t i = 0; i < count / 3; ++i) points_m.push_back(points_m[random->Index(9)]);
  return points_m;
}

TEST(PointTree, ANodeIsFollowedByAllBelowItAndHoldsTheirPoints) {
  Random random(1);
  Tree tree;
  for (const std::size_t count : {900U, 1U, 8U, 9U, 60U}) {
    const std::vector<Eigen::Vector3d> points_m = Points(count, &random);
    tree.Reset(points_m);
    std::vector<int> found(points_m.size(), 0);
    for (std::uint32_t id = 0; id < tree.nodes().size(); ++id) {
      const Tree::Node& node = tree.nodes()[id];
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const Eigen::Vector3d& point_m = points_m[tree.indices()[i]];
        EXPECT_EQ(tree.points_m()[i], point_m);
        EXPECT_EQ(point_m, point_m.cwiseMax(node.low_m).cwiseMin(node.high_m));
        if (node.IsLeaf()) ++found[tree.indices()[i]];
      }
      if (node.IsLeaf()) {
        EXPECT_EQ(node.next, id + 1);
        continue;
      }
      const Tree::Node& left = tree.nodes()[node.left];
      const Tree::Node& right = tree.nodes()[node.right];
      EXPECT_EQ(node.left, id + 1);
      EXPECT_EQ(left.next, node.right);
      EXPECT_EQ(right.next, node.next);
      EXPECT_EQ(left.parent, id);
      EXPECT_EQ(right.parent, id);
      EXPECT_EQ(left.begin, node.begin);
      EXPECT_EQ(left.end, right.begin);
      EXPECT_EQ(right.end, node.end);
    }
    EXPECT_EQ(found, std::vector<int>(points_m.size(), 1));
    EXPECT_EQ(tree.nodes().front().next, tree.nodes().size());
  }
}

TEST(PointTree, OfNothingHasNoNodes) {
  Tree tree({{1.0, 2.0, 3.0}});
  tree.Reset({});
  EXPECT_TRUE(tree.nodes().empty());
  EXPECT_TRUE(tree.points_m().empty());
}

}  // namespace
}  // namespace unlidar
