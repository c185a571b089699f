// What holds things up: nothing that stands still floats in the air, but a drone does.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "base/voxel_numbers.hpp"
#include "scene/depth_map.hpp"
#include "scene/field_of_view.hpp"
#include "scene/ground.hpp"
#include "scene/range_grid.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Whether a place is near enough to structure or ground for a static thing to be there.
class Support {
 public:
  // What it is filled in, kept for the next time.
  struct Workspace {
    VoxelNumbers seen;
    std::vector<Eigen::Vector3f> points_m;  // of structure, one for each voxel,
    std::vector<std::uint32_t> cells;       // and theirs
    DepthMap::Workspace depth;
  };

  // Of no structure yet. `cell_deg`: resolution of the directions in which structure hides what is
  // behind it.
  Support(const Ground& ground, double cell_deg, const SupportConfig& config);

  Support(const PointsView& structure_m, const Ground& ground, const ElevationRange& view,
          double cell_deg, const SupportConfig& config);

  // Begins anew, in the memory that it has.
  void Fill(const PointsView& structure_m, const ElevationRange& view, Workspace* workspace);

  const SupportConfig& config() const { return config_; }

  // `is_transient`: the thing was not there before, or is no more.
  bool IsFloating(const Eigen::Vector3f& place_m, bool is_transient = false) const;

  // How far from a thing that may be which holds it up.
  double ReachM(const Eigen::Vector3f& place_m, bool is_transient) const;

  // The returns of `structure` that float; both are indices into the recording, ascending.
  std::vector<std::uint32_t> FloatingReturns(const Recording& recording,
                                             const std::vector<std::uint32_t>& structure) const;

 private:
  bool ArrivedByAir(const Eigen::Vector3f& place_m, bool is_transient) const;

  const Ground& ground_;
  ElevationRange view_;
  SupportConfig config_;
  DepthMap depth_;                         // of structure
  VoxelNumbers cells_;                     // voxels of structure
  std::vector<std::uint32_t> first_;       // (cells) where their points begin; and all end
  std::vector<Eigen::Vector3f> points_m_;  // by cell
};

}  // namespace unlidar
