// Surfaces of the static structure around a sensor, against which its frames are registered.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "base/voxel_numbers.hpp"

namespace unlidar {

// Normal distributions of the returns in cells (Biber and Strasser, IROS 2003) whose edge grows
// with range, as the spacing of rays does. A cell is a surface along those axes of its returns in
// which it is thin: one for a wall or the ground, two for a pole or an edge.
class SurfaceMap {
 public:
  struct Surface {
    Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
    int num_normals = 0;  // 0: not a surface
    std::array<Eigen::Vector3d, 3> normals;
    std::array<double, 3> variances_m2{};  // along them
  };

  // Positions are relative to the viewpoint.
  void Add(const Eigen::Vector3d& position_m);

  // Returns the surface at a position; null if none is known there. Valid until the next Add().
  const Surface* Find(const Eigen::Vector3d& position_m) const;

  // Keeps the memory.
  void Clear() {
    numbers_.Clear();
    cells_.clear();
  }

 private:
  struct Cell {
    double count = 0.0;
    double count_of_fit = 0.0;                        // when the surface was computed
    Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();  // from the centre
    Eigen::Matrix3d squares_m2 = Eigen::Matrix3d::Zero();
    Surface surface;
  };

  VoxelNumbers numbers_;  // a grid for each size of cells
  std::vector<Cell> cells_;
};

}  // namespace unlidar
