// Clutter intensity at the plots of a station.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/queue.hpp"
#include "scene/plots.hpp"
#include "scene/range_grid.hpp"
#include "scene/stations.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// The narrowest neighbourhood, of a branch.
constexpr RangeRadius kClutterNarrow{1.5, 0.04};

// Extent of a static object that is a point to the sensor.
constexpr RangeRadius kSpotRadius{0.19, 0.006};

// Counts the plots of a sensor in neighbourhoods of three sizes. Bins within kExclusionBins of a
// plot's own do not count towards its clutter: a target takes about that long to leave its place.
class ClutterMap {
 public:
  static constexpr std::size_t kNumLevels = 3;
  // Levels of a map in the axes of a carrier that travels: clutter of the same kind comes by again
  // along its way, but no spot does.
  static constexpr std::size_t kNumAlongLevels = 2;
  static constexpr std::uint32_t kExclusionBins = 2;

  using LevelCounts = std::array<std::uint32_t, kNumLevels>;

  // The plots of other times in a neighbourhood, and its volume.
  struct Level {
    std::uint32_t count = 0;
    double volume_m3 = 0.0;
  };
  using Levels = std::array<Level, kNumLevels>;

  ClutterMap();

  // Adds a plot, or removes it again if `count` is -1. `place_m`: in the scene of its station.
  void Add(const Eigen::Vector3f& place_m, std::uint32_t bin, std::int32_t count = 1);

  // Returns the plots of the bins excluded for a plot of this bin, from the widest neighbourhood to
  // the narrowest. Faster, the fewer later bins there are.
  LevelCounts ExcludedAt(const Eigen::Vector3f& place_m, std::uint32_t bin) const;

  // Returns the levels from the widest to the narrowest. `excluded`: result of ExcludedAt().
  Levels LevelsAt(const Eigen::Vector3f& place_m, const LevelCounts& excluded) const;

  // Returns the widest level, with the plots of these bins alone.
  Level WidestAt(const Eigen::Vector3f& place_m, BinRange bins) const {
    return {levels_[0].Count(place_m, bins), levels_[0].VolumeM3(place_m)};
  }

  // Forgets the plots of earlier bins.
  void Forget(std::uint32_t before_bin);

  // Returns the bins excluded for a plot.
  static BinRange Excluded(std::uint32_t bin) {
    return {bin - std::min(bin, kExclusionBins), bin + kExclusionBins + 1};
  }

 private:
  std::array<RangeGrid, kNumLevels> levels_;
};

// Plots a frame that mean a change of weather: no swarm is that large.
inline constexpr double kSwarmPlots = 30.0;

// Clutter intensity, per m^3 and frame of the sensor of a plot: the largest of the rates of its
// neighbourhood, its spot and its place, method.md (2) to (4). Takes the plots of frames in any
// order and forgets them again, so that it serves a stream as well as a recording.
class ClutterModel {
 public:
  explicit ClutterModel(const RobustConfig& config);

  // Adds frames of a sensor, or one of their plots.
  void AddFrames(std::uint32_t sensor, std::uint32_t bin, std::uint32_t count = 1);
  void Add(const Plot& plot, std::uint32_t bin, std::int32_t count = 1);

  // Removes a plot that was added, unless it is forgotten.
  void Remove(const Plot& plot, std::uint32_t bin) {
    if (bin >= sensors_[plot.sensor].first_bin) Add(plot, bin, -1);
  }

  // Forgets the frames and plots of earlier bins, of all sensors or of one.
  void Forget(std::uint32_t before_bin);
  void Forget(std::uint32_t sensor, std::uint32_t before_bin);

  std::uint32_t NumFrames(std::uint32_t sensor, BinRange bins) const {
    return CountIn(sensor, bins).num_frames;
  }

  // The plots about a plot at its own time, in the bins excluded for it.
  struct SameTime {
    ClutterMap::LevelCounts around{};
    ClutterMap::LevelCounts along{};
    std::uint32_t at_spot = 0;
  };

  // Faster, the fewer later bins there are.
  SameTime SameTimeOf(const Plot& plot, std::uint32_t bin) const;

  // Rate of the neighbourhood of a plot, and of what lies as far ahead of a carrier that travels.
  // `num_excluded`: plots of other times around it that are no clutter, as they are its own.
  double SurroundingRate(const Plot& plot, std::uint32_t bin, const SameTime& same_time,
                         std::uint32_t num_excluded) const;

  std::uint32_t NumAtSpot(const Plot& plot) const;

  // Rate of the spot of a plot, given the number of others there: method.md (3).
  struct SpotRate {
    double per_plot = 0.0;
    double num_strays = 0.0;  // expected at the spot of a group among dense strays

    double Given(double num_others) const {
      return std::max(num_others - num_strays, 0.0) * per_plot;
    }
  };
  SpotRate SpotRateOf(const Plot& plot) const;

  // Number of levels in use, and those around a plot.
  std::size_t num_levels() const { return num_levels_; }
  ClutterMap::Levels LevelsAt(const Plot& plot, const SameTime& same_time) const;

  struct Intensity {
    double log_surrounding = 0.0;  // of the neighbourhood alone, without spot and place
    double log_clutter = 0.0;
  };

  // True if frames of this bin have so many more plots than those of other times as no swarm has.
  // Weather begins, or comes in squalls: other times do not tell of its strays.
  bool IsSquall(std::uint32_t sensor, std::uint32_t bin) const;

  // Returns the clutter intensity of a plot that was added, as far as it is known: a plot of a
  // dwell is predicted by the others that were added so far. `is_squall`: of its sensor and bin; it
  // is then at least that of the present.
  Intensity IntensityOf(const Plot& plot, std::uint32_t bin, bool is_squall) const;

 private:
  struct FrameCount {
    std::uint32_t bin = 0;
    std::uint32_t num_frames = 0;
    std::uint32_t num_plots = 0;
  };

  struct Sensor {
    std::uint32_t num_frames = 0;
    std::uint32_t num_plots = 0;
    std::uint32_t first_bin = 0;  // earlier ones are forgotten
    Queue<FrameCount> by_bin;     // ascending
    ClutterMap around;
    ClutterMap along;              // while it travels, in the axes of its carrier
    RangeGrid spots{kSpotRadius};  // of static objects
  };

  FrameCount CountIn(std::uint32_t sensor, BinRange bins) const;
  // Rate of the other plots of the bin about a plot, of which a target has one a frame.
  double PresentRate(const Plot& plot, std::uint32_t bin) const;

  std::size_t num_levels_;
  bool knows_squalls_;
  std::vector<Sensor> sensors_;
};

// Returns the volume in which the plots of one point-like object lie: V_plot of method.md (3).
double PlotVolumeM3(const Plot& plot);

// Sets log_clutter of every plot, after MarkFloating, from the plots of its sensor in the whole
// recording that are not `assigned` (one per plot). By hindsight the plots of a spot may all be one
// dwell, which the chain rule predicts: method.md (4). `station_models`: one per sensor.
void EstimateClutter(const std::vector<StationModel>& station_models, const RobustConfig& config,
                     const std::vector<char>& assigned, std::vector<Plot>* plots);

}  // namespace unlidar
