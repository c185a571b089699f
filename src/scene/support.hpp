// Support of static objects by structure or ground: only a hovering drone has none.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/angles.hpp"
#include "base/recording.hpp"
#include "base/voxel_numbers.hpp"
#include "scene/field_of_view.hpp"
#include "scene/ground.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Median range of the returns per direction cell.
class DepthMap {
 public:
  // An empty map.
  DepthMap();

  // Replaces the contents, reusing memory.
  void Fill(const PointsView& points_m);

  // Median range in the direction of a place, as seen from the sensor; infinity without returns.
  float MedianM(const Eigen::Vector3f& place_m) const {
    return medians_m_[DirectionCells::CellOf(place_m)];
  }

  // Returns the share of the directions within `radius_m` of a place, as seen from the sensor, that
  // are out of view or in which something is nearer than the place by `margin_m`.
  double HiddenShare(const Eigen::Vector3f& place_m, double radius_m, double margin_m,
                     const ElevationRange& view) const;

 private:
  struct Angle {
    double rad;
    double cosine;
    double sine;
  };

  std::vector<Angle> elevations_;  // (rows) of the cell centres
  std::vector<Angle> azimuths_;    // (columns)
  std::vector<float> medians_m_;   // (rows x columns) infinity without returns
  // Buffers of Fill(), kept for reuse.
  std::vector<std::uint32_t> cell_of_;  // (points)
  std::vector<std::uint32_t> begins_;   // (cells + 1) in ranges_m_
  std::vector<float> ranges_m_;         // (points) by cell
};

// Structure closer than this may be the object itself.
constexpr double kObjectRadiusM = 1.5;
// Beyond this range rays are too far apart to show poles and wires: only objects isolated within
// kSupportFarReach float there.
constexpr double kSupportFarM = 50.0;
constexpr RangeRadius kSupportFarReach{1.5, 0.3};
// Structure is thinned to one point per voxel, finer than any reach.
constexpr double kSupportVoxelM = 0.25;
// A deck or a roof reaches this far behind the edge that hides it from below. Objects on it come
// into view at the line of sight past the edge, which the depth map resolves to kEdgeClearM.
constexpr double kEdgeReachM = 6.0;
constexpr double kEdgeClearM = 0.8;
// If more than this share of the directions around an object is hidden, its support may be, too.
constexpr double kMaxHiddenShare = 0.2;

// Largest distance in m from an object at this range to a possible support.
inline double SupportReachM(double range_m, const SupportConfig& config) {
  return (range_m < kSupportFarM ? config.reach : kSupportFarReach).At(range_m);
}

// Tests whether structure or ground near a place may support a static object there.
class Support {
 public:
  Support(Ground ground, const SupportConfig& config);

  // Replace ground and possible supports. `are_lasting` (supports): false where a target may have
  // been (Occupancy::GetSupporters). Reuse the allocated memory.
  void FitGround(const PointsView& structure_m) { ground_.Fit(structure_m); }
  void Fill(const PointsView& supports_m, const std::vector<char>& are_lasting,
            const ElevationRange& view);

  const Ground& ground() const { return ground_; }

  // True if a static object at `place_m` has no support; false if unknown. `is_transient`: it was
  // absent before, or is absent afterwards.
  bool IsFloating(const Eigen::Vector3f& place_m, bool is_transient = false) const;

  // Returns the height in m of a place over the highest lasting structure in the column of this
  // radius below it, from `least_m` on; infinity if there is none within `most_m`.
  double HeightAboveStructureM(const Eigen::Vector3f& place_m, double radius_m, double least_m,
                               double most_m) const;

  // Returns the same over what lasting structure hides that is up to kEdgeReachM nearer and at most
  // `most_m` lower: over the line of sight past its edge. A parapet hides the deck that carries
  // what is seen above it.
  double HeightAboveEdgeM(const Eigen::Vector3f& place_m, double least_m, double most_m) const;

  // Returns the largest distance in m from an object to a possible support.
  double ReachM(const Eigen::Vector3f& place_m, bool is_transient) const;

 private:
  bool ArrivedByAir(const Eigen::Vector3f& place_m, bool is_transient) const;

  Ground ground_;
  ElevationRange view_;
  SupportConfig config_;
  DepthMap depth_;                         // of structure
  DepthMap lasting_depth_;                 // of what lasts of it
  VoxelNumbers cells_;                     // voxels of structure
  std::vector<std::uint32_t> first_;       // (cells + 1) first point of each cell, then the end
  std::vector<Eigen::Vector3f> points_m_;  // by cell
  std::vector<char> are_lasting_;          // (points)
  // Buffers of Fill(), kept for reuse.
  VoxelNumbers seen_;
  std::vector<Eigen::Vector3f> thinned_m_;  // structure, one point per voxel
  std::vector<std::uint32_t> cell_of_;      // of each of these
  std::vector<Eigen::Vector3f> lasting_m_;
  std::vector<char> lasts_;  // whether a lasting one is in its voxel
};

}  // namespace unlidar
