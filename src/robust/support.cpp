#include "unlidar/robust/support.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_set>

namespace unlidar {
namespace {

constexpr float kCellM = 2.0F;

std::int64_t IndexOf(float coordinate_m, float edge_m) {
  return static_cast<std::int64_t>(std::floor(coordinate_m / edge_m));
}

std::uint64_t Pack(std::int64_t x, std::int64_t y, std::int64_t z) {
  constexpr std::int64_t kOffset = 1 << 20;
  constexpr std::int64_t kMask = (1 << 21) - 1;
  return static_cast<std::uint64_t>((x + kOffset) & kMask) << 42 |
         static_cast<std::uint64_t>((y + kOffset) & kMask) << 21 |
         static_cast<std::uint64_t>((z + kOffset) & kMask);
}

std::uint64_t KeyOf(const Eigen::Vector3f& point_m, float edge_m) {
  return Pack(IndexOf(point_m.x(), edge_m), IndexOf(point_m.y(), edge_m),
              IndexOf(point_m.z(), edge_m));
}

}  // namespace

Support::Support(const std::vector<Eigen::Vector3f>& structure_m, const Ground& ground,
                 double cell_deg, const SupportConfig& config)
    : ground_(ground),
      config_(config),
      depth_(structure_m, std::vector<std::uint32_t>(structure_m.size(), 0), 1, cell_deg) {
  const auto voxel_m = static_cast<float>(config.voxel_m);
  std::unordered_set<std::uint64_t> seen;
  for (const Eigen::Vector3f& point_m : structure_m) {
    if (seen.insert(KeyOf(point_m, voxel_m)).second) {
      cells_[KeyOf(point_m, kCellM)].push_back(point_m);
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
  const std::int64_t x = IndexOf(place_m.x(), kCellM);
  const std::int64_t y = IndexOf(place_m.y(), kCellM);
  const std::int64_t z = IndexOf(place_m.z(), kCellM);
  // From near to far: most places are next to structure, and done at once.
  const auto last_ring = static_cast<std::int64_t>(std::ceil(reach_m / kCellM));
  for (std::int64_t ring = 0; ring <= last_ring; ++ring) {
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        const bool is_edge = std::abs(dx) == ring || std::abs(dy) == ring;
        const std::int64_t step = is_edge || ring == 0 ? 1 : 2 * ring;
        for (std::int64_t dz = -ring; dz <= ring; dz += step) {
          const auto cell = cells_.find(Pack(x + dx, y + dy, z + dz));
          if (cell != cells_.end() &&
              std::any_of(cell->second.begin(), cell->second.end(), holds)) {
            return false;
          }
        }
      }
    }
  }
  // What holds it may be hidden.
  return depth_.HiddenShare(place_m, config_.ReachM(range_m), config_.body_m) <=
         config_.max_hidden_share;
}

std::vector<std::uint32_t> Support::FloatingReturns(
    const Recording& recording, const std::vector<std::uint32_t>& structure) const {
  const auto voxel_m = static_cast<float>(config_.voxel_m);
  std::unordered_map<std::uint64_t, bool> verdicts;  // by voxel
  std::vector<std::uint32_t> floating;
  for (const std::uint32_t i : structure) {
    const Eigen::Vector3f& point_m = recording.points_m[i];
    const auto [verdict, is_new] = verdicts.try_emplace(KeyOf(point_m, voxel_m), false);
    if (is_new) verdict->second = IsFloating(point_m);
    if (verdict->second) floating.push_back(i);
  }
  return floating;
}

}  // namespace unlidar
