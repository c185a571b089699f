// The ground under the scene, from the lowest returns.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/recording.hpp"
#include "base/voxel_numbers.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Local lowest heights about one plane z = c0 + c1 x + c2 y, x and y from the station. Without a
// ground in view (a sensor that looks up) every height above it is infinite.
class Ground {
 public:
  // What it is fitted in, kept for the next fit.
  struct Workspace {
    std::vector<float> heights_m;        // of the points, by cell
    std::vector<std::uint32_t> known;    // cells with a height, by place
    std::vector<double> lowest_m;        // theirs, or of those near the station
    std::vector<std::uint32_t> inliers;  // of them, those that the plane is fitted to
  };

  // None, until it is fitted.
  explicit Ground(const GroundConfig& config) : config_(config) {}

  Ground(const PointsView& points_m, const GroundConfig& config);

  // Begins anew, in the memory that it has.
  void Fit(const PointsView& points_m, Workspace* workspace);

  double HeightAbove(const Eigen::Vector3f& point_m) const;

  // Whether a return comes from the ground itself.
  bool Holds(const Eigen::Vector3f& point_m) const;

 private:
  // A column of the scene.
  struct Cell {
    int x = 0;
    int y = 0;
    std::uint32_t end = 0;                                       // of its points among all
    double height_m = std::numeric_limits<double>::quiet_NaN();  // unless it has too few
  };

  struct Plane {
    Eigen::Vector3d coefficients = Eigen::Vector3d::Zero();
    double support = 0.0;  // cells that it goes through, by how near they are; 0: there is none
  };

  // Without its height.
  Cell CellOf(const Eigen::Vector3f& point_m) const;
  static VoxelKey KeyOf(const Cell& cell);
  Eigen::Vector3d MiddleOf(const Cell& cell) const;
  void SetHeights(const PointsView& points_m, Workspace* workspace);
  void FitPlane(Workspace* workspace);
  Plane PlaneOf(double reach_m, Workspace* workspace) const;

  GroundConfig config_;
  bool exists_ = false;
  Eigen::Vector3d plane_ = Eigen::Vector3d::Zero();
  VoxelNumbers numbers_;     // of the cells
  std::vector<Cell> cells_;  // by number
};

}  // namespace unlidar
