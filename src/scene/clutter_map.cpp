#include "scene/clutter_map.hpp"

#include "scene/plots.hpp"

namespace unlidar {
namespace {

// The widest neighbourhood reaches across a scene. Where nothing is known the rate is that of an
// empty sky.
constexpr RangeRadius kWide{4.0, 0.35};
constexpr RangeRadius kMiddle{4.0, 0.12};
constexpr double kEmptySkyRate = 1e-6;
// Extent of a static object that is a point to the sensor.
constexpr RangeRadius kSpotRadius{0.19, 0.006};

// Among strays many plots of a bin share a voxel.
RangeGrid CachedGrid(const RangeRadius& radius) {
  return RangeGrid(radius, RangeGrid::CountCache::kPerVoxel);
}

}  // namespace

ClutterMap::Sensor::Sensor()
    : levels{CachedGrid(kWide), CachedGrid(kMiddle), CachedGrid(kClutterNarrow)},
      spots(kSpotRadius) {}

const ClutterMap::Sensor& ClutterMap::SensorAt(std::uint32_t sensor) const {
  static const Sensor empty;
  return sensor < sensors_.size() ? sensors_[sensor] : empty;
}

void ClutterMap::Add(std::uint32_t sensor, const Eigen::Vector3f& place_m, std::uint32_t bin,
                     std::int32_t count) {
  if (sensors_.size() <= sensor) sensors_.resize(sensor + 1);
  for (RangeGrid& level : sensors_[sensor].levels) level.Add(place_m, bin, count);
  sensors_[sensor].spots.Add(place_m, bin, count);
}

ClutterMap::LevelCounts ClutterMap::ExcludedAt(std::uint32_t sensor, const Eigen::Vector3f& place_m,
                                               std::uint32_t bin) const {
  LevelCounts counts;
  for (std::size_t k = 0; k < kNumLevels; ++k) {
    counts[k] = SensorAt(sensor).levels[k].Count(place_m, Excluded(bin));
  }
  return counts;
}

ClutterMap::Levels ClutterMap::LevelsAt(std::uint32_t sensor, const Eigen::Vector3f& place_m,
                                        const LevelCounts& excluded) const {
  Levels levels;
  for (std::size_t k = 0; k < kNumLevels; ++k) {
    const RangeGrid& grid = SensorAt(sensor).levels[k];
    levels[k] = {grid.Count(place_m) - excluded[k], grid.VolumeM3(place_m)};
  }
  return levels;
}

std::uint32_t ClutterMap::ExcludedAtSpot(std::uint32_t sensor, const Eigen::Vector3f& place_m,
                                         std::uint32_t bin) const {
  return SensorAt(sensor).spots.Count(place_m, Excluded(bin));
}

std::uint32_t ClutterMap::AllAtSpot(std::uint32_t sensor, const Eigen::Vector3f& place_m) const {
  return SensorAt(sensor).spots.Count(place_m);
}

double ClutterMap::SpotVolumeM3(std::uint32_t sensor, const Eigen::Vector3f& place_m) const {
  return SensorAt(sensor).spots.VolumeM3(place_m);
}

void ClutterMap::Forget(std::uint32_t before_bin) {
  for (Sensor& sensor : sensors_) {
    for (RangeGrid& level : sensor.levels) level.Forget(before_bin);
    sensor.spots.Forget(before_bin);
  }
}

double RateAtOtherTimes(const ClutterMap::Levels& levels, double num_frames,
                        std::uint32_t num_excluded, std::size_t num_levels) {
  double rate = kEmptySkyRate;
  for (std::size_t k = 0; k < num_levels; ++k) {
    const ClutterMap::Level& level = levels[k];
    rate = ClutterRate(level.count - std::min(level.count, num_excluded),
                       num_frames * level.volume_m3, rate);
  }
  return rate;
}

}  // namespace unlidar
