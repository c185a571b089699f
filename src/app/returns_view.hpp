// Returns of a frame for a view of them: thinned, and as short text.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Most returns of a view: 6 bytes each, in base64, fit the lines that readers of events accept.
inline constexpr int kMaxViewReturns = 2000;

// Returns of a view are within this distance of the origin on each axis.
inline constexpr float kMaxViewM = 10'000.0F;

// Edge of the finest voxels in which returns of a view are told apart.
inline constexpr double kFinestViewVoxelM = 0.05;

// Indices of at most `max_returns` > 0 returns, ascending. All within kMaxViewM if they fit.
// Otherwise one of each voxel of the finest edge, among kFinestViewVoxelM and its doublings, with
// which these fit: a lone return stays. The rest of the room is spread over the next finer voxels.
std::vector<std::uint32_t> ThinnedReturns(const std::vector<Eigen::Vector3f>& points_m,
                                          std::size_t max_returns);

// Coordinates of some returns, all within kMaxViewM, in whole steps.
struct ReturnsText {
  double step_m = 0.01;  // doubled until all coordinates fit
  std::string xyz;       // base64 of x, y, z of each as little-endian int16
};
ReturnsText TextOfReturns(const std::vector<Eigen::Vector3f>& points_m,
                          const std::vector<std::uint32_t>& indices);

// Chooses frames of one sensor, five a second by their stamps.
class ViewPace {
 public:
  bool IsDue(TimeNs stamp_ns);

 private:
  std::optional<TimeNs> due_ns_;  // once it has begun
};

}  // namespace unlidar
