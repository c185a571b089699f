// What holds things up: nothing that stands still floats in the air, but a drone does.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "base/recording.hpp"
#include "base/voxel_grid.hpp"
#include "robust/scene/depth_map.hpp"
#include "robust/scene/ground.hpp"
#include "robust/scene/range_grid.hpp"

namespace unlidar {

struct SupportConfig {
  // Structure, ground or station as near as this holds a thing up, whether or not what joins the
  // two is seen: poles and wires are thin,
  RangeRadius reach{1.5, 0.1};
  // and farther away than this little is seen well: only what is alone for so far floats there,
  double far_m = 50.0;
  RangeRadius far_reach{1.5, 0.3};
  double max_range_m = 100.0;  // and beyond this nobody knows.
  double body_m = 1.5;         // structure nearer than this may be the thing itself
  double voxel_m = 0.25;       // resolution of structure
  // Where more than this of the directions about a thing is hidden, so may be what holds it.
  double max_hidden_share = 0.2;

  double ReachM(double range_m) const { return (range_m < far_m ? reach : far_reach).At(range_m); }
};

// Whether a place is near enough to structure or ground for a static thing to be there.
class Support {
 public:
  // `cell_deg`: resolution of the directions in which structure hides what is behind it.
  Support(const PointsView& structure_m, const Ground& ground, double cell_deg,
          const SupportConfig& config);

  const SupportConfig& config() const { return config_; }

  bool IsFloating(const Eigen::Vector3f& place_m) const;

  // The returns of `structure` that float; both are indices into the recording, ascending.
  std::vector<std::uint32_t> FloatingReturns(const Recording& recording,
                                             const std::vector<std::uint32_t>& structure) const;

 private:
  const Ground& ground_;
  SupportConfig config_;
  DepthMap depth_;                                                    // of structure
  std::unordered_map<VoxelKey, std::vector<Eigen::Vector3f>> cells_;  // voxels of structure
};

}  // namespace unlidar
