#include "robust/scene/support.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/voxel_grid.hpp"
#include "base/voxel_numbers.hpp"

namespace unlidar {
namespace {

constexpr double kCellM = 2.0;

}  // namespace

Support::Support(const PointsView& structure_m, const Ground& ground, const ElevationRange& view,
                 double cell_deg, const SupportConfig& config)
    : ground_(ground), view_(view), config_(config), depth_(structure_m, {}, 1, cell_deg) {
  VoxelNumbers seen;
  for (std::size_t i = 0; i < structure_m.size(); ++i) {
    const Eigen::Vector3f& point_m = structure_m[i];
    const std::uint32_t num_seen = seen.size();
    if (seen.FindOrAdd(0, VoxelOf(point_m, config.voxel_m)) == num_seen) {
      cells_[VoxelOf(point_m, kCellM)].push_back(point_m);
    }
  }
}

bool Support::IsFloating(const Eigen::Vector3f& place_m) const {
  const auto range_m = static_cast<double>(place_m.norm());
  if (range_m > config_.max_range_m) return false;
  // The station itself may hold it, as the ground may.
  const double nearest_m = std::min(range_m, ground_.HeightAbove(place_m));
  const auto reach_m = static_cast<float>(config_.ReachM(range_m));
  if (nearest_m < static_cast<double>(reach_m)) return false;
  const auto body_m = static_cast<float>(config_.body_m);
  const auto holds = [&](const Eigen::Vector3f& structure_m) {
    const float distance_m = (structure_m - place_m).norm();
    return distance_m > body_m && distance_m < reach_m;
  };
  const Voxel home = VoxelAt(place_m, kCellM);
  // From near to far: most places are next to structure, and done at once.
  const auto last_ring =
      static_cast<std::int64_t>(std::ceil(static_cast<double>(reach_m) / kCellM));
  for (std::int64_t ring = 0; ring <= last_ring; ++ring) {
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        const bool is_edge = std::abs(dx) == ring || std::abs(dy) == ring;
        const std::int64_t step = is_edge || ring == 0 ? 1 : 2 * ring;
        for (std::int64_t dz = -ring; dz <= ring; dz += step) {
          const auto cell = cells_.find(KeyOf({home.x + dx, home.y + dy, home.z + dz}));
          if (cell != cells_.end() &&
              std::any_of(cell->second.begin(), cell->second.end(), holds)) {
            return false;
          }
        }
      }
    }
  }
  // What holds it may be hidden or out of view.
  return depth_.HiddenShare(place_m, config_.ReachM(range_m), config_.body_m, view_) <=
         config_.max_hidden_share;
}

std::vector<std::uint32_t> Support::FloatingReturns(
    const Recording& recording, const std::vector<std::uint32_t>& structure) const {
  VoxelNumbers seen;
  std::vector<char> verdicts;  // by voxel
  std::vector<std::uint32_t> floating;
  for (const std::uint32_t i : structure) {
    const Eigen::Vector3f& point_m = recording.points_m[i];
    const std::uint32_t voxel = seen.FindOrAdd(0, VoxelOf(point_m, config_.voxel_m));
    if (voxel == verdicts.size()) verdicts.push_back(IsFloating(point_m) ? 1 : 0);
    if (verdicts[voxel] != 0) floating.push_back(i);
  }
  return floating;
}

}  // namespace unlidar
