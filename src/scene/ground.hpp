// The ground under the scene, from the lowest returns.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/recording.hpp"
#include "base/voxel_numbers.hpp"

namespace unlidar {

// A steeper plane is a wall or a tree crown, not terrain (17 degrees).
constexpr double kMaxTerrainSlope = 0.3;
// Anything lower above the ground is the ground itself: grass and range noise.
constexpr double kGroundThicknessM = 0.3;

// Lowest local heights relative to one plane z = c0 + c1 x + c2 y, x and y from the station. What
// the station would see through nearer ground is an image mirrored by a wet one, and does not
// count. Without a ground in view (a sensor that looks up) every height above ground is infinite.
class Ground {
 public:
  // No ground until Fit().
  explicit Ground(double max_slope = kMaxTerrainSlope) : max_slope_(max_slope) {}

  // Replaces the ground, reusing memory.
  void Fit(const PointsView& points_m);

  // Number of inlier cells of the plane, those beyond 20 m weighted by the inverse square of their
  // distance; 0 without a ground.
  double support() const { return plane_.support; }

  // Same as support(), of flat cells only: within `band_m` (at most 0.6 m) of a plane refitted to
  // such cells, with at least a quarter of their returns as low. Nearly all cells of a floor count,
  // few or none of rough ground or of objects of equal lowest height.
  double FlatSupport(double band_m);

  // Height (z) of the plane at x = y = 0, the station, in m; undefined without a ground.
  double height_m() const { return plane_.coefficients.x(); }

  double HeightAbove(const Eigen::Vector3f& point_m) const;

  // True if the return comes from the ground itself.
  bool IsGround(const Eigen::Vector3f& point_m) const {
    return HeightAbove(point_m) < kGroundThicknessM;
  }

 private:
  // A column of the scene.
  struct Cell {
    Voxel at;
    double height_m = std::numeric_limits<double>::quiet_NaN();  // NaN if it has too few points
    // Slope of the lowest line of sight above all nearer ground on the way to the cell.
    double horizon = -std::numeric_limits<double>::infinity();
  };

  struct Plane {
    Eigen::Vector3d coefficients = Eigen::Vector3d::Zero();
    double support = 0.0;  // weighted number of inlier cells; 0: no plane
  };

  void SetHeights(const PointsView& points_m);
  void SetHeightsOutwards();
  double HorizonBefore(const Voxel& at) const;
  Plane PlaneOf(double reach_m);

  // Fits the plane to the inliers, then makes all known cells within the band of it the inliers.
  // Returns false if there are too few to fit.
  bool Refit(double band_m, Plane* plane);
  void SetInliers(double band_m, const Plane& plane);
  double SupportOf() const;  // of the inliers

  double max_slope_;
  Plane plane_;              // without support: there is no ground
  VoxelNumbers numbers_;     // of the cells
  std::vector<Cell> cells_;  // by number
  // Of the last fit, kept for reuse.
  std::vector<std::uint32_t> cell_of_;   // (points)
  std::vector<float> heights_m_;         // of the points, by cell
  std::vector<std::uint32_t> begins_;    // (cells + 1) in heights_m_
  std::vector<std::uint32_t> outwards_;  // all cells, the nearest first
  std::vector<std::uint32_t> known_;     // cells with a height, ordered by x, then y
  std::vector<double> lowest_m_;         // heights of these, or of those near the station
  std::vector<std::uint32_t> inliers_;   // the known cells to which the plane is fitted
};

}  // namespace unlidar
