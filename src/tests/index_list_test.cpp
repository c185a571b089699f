#include "base/index_list.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "base/maths.hpp"

namespace unlidar {
namespace {

std::vector<std::uint32_t> ValuesOf(const IndexList& list) { return {list.begin(), list.end()}; }

TEST(IndexList, HoldsWhatAVectorDoes) {
  IndexList list;
  std::vector<std::uint32_t> expected;
  for (std::uint32_t i = 0; i < 100; ++i) {
    EXPECT_EQ(ValuesOf(list), expected);
    EXPECT_EQ(list.size(), expected.size());
    list.push_back(7 * i);
    expected.push_back(7 * i);
    EXPECT_EQ(list.front(), 0U);
    EXPECT_EQ(list[i], 7 * i);
  }
  list.clear();
  EXPECT_TRUE(list.empty());
  list.push_back(3);
  EXPECT_EQ(ValuesOf(list), (std::vector<std::uint32_t>{3}));
}

TEST(IndexList, IsCopiedAndMovedWhole) {
  for (const IndexList& list : {IndexList(), IndexList({5}), IndexList({5, 6, 7})}) {
    IndexList copy = list;
    EXPECT_EQ(ValuesOf(copy), ValuesOf(list));
    const IndexList moved = std::move(copy);
    EXPECT_EQ(ValuesOf(moved), ValuesOf(list));
    EXPECT_TRUE(copy.empty());  // NOLINT(bugprone-use-after-move): it can be used again
    copy = {1, 2};
    EXPECT_EQ(ValuesOf(copy), (std::vector<std::uint32_t>{1, 2}));
    copy = list;
    EXPECT_EQ(ValuesOf(copy), ValuesOf(list));
  }
}

TEST(SymmetricMatrix, IsWhatItWasMadeFrom) {
  Eigen::Matrix3d m;
  m << 1, 2, 3, 2, 4, 5, 3, 5, 6;
  EXPECT_EQ(SymmetricMatrix(m).Full(), m);
  EXPECT_EQ(SymmetricMatrix().Full(), Eigen::Matrix3d::Zero());
}

}  // namespace
}  // namespace unlidar
