#include "collection/spots.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "base/voxel_grid.hpp"
#include "base/voxel_numbers.hpp"
#include "scene/plots.hpp"
#include "unlidar/config.hpp"

namespace unlidar {
namespace {

// Four times the ranging noise, and the width of a beam.
constexpr RangeRadius kSpot{0.08, 0.002};
// Exceeds the neighbourhood of any spot within 250 m. Beyond, some returns are missed, and the rate
// of the surroundings applies.
constexpr double kReachM = 1.0;

}  // namespace

Spots::Spots(const Recording& recording, const std::vector<StationModel>& station_models,
             const std::vector<std::uint32_t>& candidates)
    : station_models_(station_models) {
  std::vector<const TimeBins*> bins;
  for (const StationModel& station : station_models) {
    const auto at = std::find(bins.begin(), bins.end(), station.bins);
    stations_.push_back(static_cast<std::size_t>(at - bins.begin()));
    if (at != bins.end()) continue;
    bins.push_back(station.bins);
    grids_.emplace_back(kSpot);
  }
  VoxelNumbers voxels;      // about the candidates
  Eigen::AlignedBox3f box;  // around these, for fast rejection of most returns
  for (const std::uint32_t i : candidates) {
    const Eigen::Vector3f& point_m = recording.points_m[i];
    box.extend(point_m);
    const Voxel home = VoxelAt(point_m, kReachM);
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          voxels.FindOrAdd(0, KeyOf({home.x + dx, home.y + dy, home.z + dz}));
        }
      }
    }
  }
  const Eigen::Vector3f margin_m = Eigen::Vector3f::Constant(static_cast<float>(2.0 * kReachM));
  box = {box.min() - margin_m, box.max() + margin_m};
  for (const FrameInfo& frame : recording.frames) {
    const StationModel& station = station_models[frame.sensor];
    RangeGrid& grid = grids_[stations_[frame.sensor]];
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      const Eigen::Vector3f& point_m = recording.points_m[i];
      if (!box.contains(point_m)) continue;
      if (voxels.Find(0, VoxelOf(point_m, kReachM)) == VoxelNumbers::kNone) continue;
      if (std::binary_search(candidates.begin(), candidates.end(), i)) continue;
      grid.Add(point_m - station.viewpoint_m, station.bins->BinOf(recording.times_ns[i]));
    }
  }
}

double Spots::RateOutside(std::uint32_t sensor, const Eigen::Vector3f& point_m, TimeNs from_ns,
                          TimeNs to_ns, double surroundings_rate) const {
  const StationModel& station = station_models_[sensor];
  const RangeGrid& grid = grids_[stations_[sensor]];
  const Eigen::Vector3f ray_m = point_m - station.viewpoint_m;
  const BinRange inside = station.bins->BinsTouching(from_ns, to_ns);
  const double returns = grid.Count(ray_m) - grid.Count(ray_m, inside);
  const double exposure = station.bins->NumFramesOutside(inside) * grid.VolumeM3(ray_m);
  return ClutterRate(returns, exposure, surroundings_rate);
}

}  // namespace unlidar
