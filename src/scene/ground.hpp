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

  // How many cells the plane goes through, far ones by the inverse square of their distance; 0
  // without a ground.
  double support() const { return exists_ ? support_ : 0.0; }

  // The same of flat cells alone: within this, at most 0.6 m, of a plane fitted to such, as is also
  // a quarter of their returns. As many of a floor; few or none of rough ground, or of things that
  // are equally low. `workspace`: of the last Fit().
  double FlatSupport(double band_m, Workspace* workspace) const;

  // Where the plane is under the station, in m; without a ground it is not defined.
  double height_m() const { return plane_.x(); }

  double HeightAbove(const Eigen::Vector3f& point_m) const;

  // Whether a return comes from the ground itself.
  bool IsGround(const Eigen::Vector3f& point_m) const;

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
  double DistanceM(const Cell& cell) const;  // from the station
  void SetHeights(const PointsView& points_m, Workspace* workspace);
  void FitPlane(Workspace* workspace);
  Plane PlaneOf(double reach_m, Workspace* workspace) const;

  // Fits the plane to the inliers, then takes those within the band of it as inliers; false where
  // they are too few.
  bool Refit(double band_m, Plane* plane, Workspace* workspace) const;
  void SetInliers(double band_m, const Plane& plane, Workspace* workspace) const;
  double SupportOf(const std::vector<std::uint32_t>& inliers) const;

  GroundConfig config_;
  bool exists_ = false;
  double support_ = 0.0;
  Eigen::Vector3d plane_ = Eigen::Vector3d::Zero();
  VoxelNumbers numbers_;     // of the cells
  std::vector<Cell> cells_;  // by number
};

}  // namespace unlidar
