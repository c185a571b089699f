// Detects static plots without support.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "scene/range_grid.hpp"
#include "scene/support.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Counts plots at places and in the regions around them. The plots of static objects are nearer to
// each other than chance allows, which those of rain are not.
class StaticPlaces {
 public:
  explicit StaticPlaces(const RangeRadius& place)
      : places_(place), regions_({kWider * place.constant_m, kWider * place.slope}) {}

  void Add(const Eigen::Vector3f& place_m, std::uint32_t bin) {
    places_.Add(place_m, bin);
    regions_.Add(place_m, bin);
  }

  // True if a place holds more plots than chance allows: 3 standard deviations above the mean.
  bool IsStatic(const Eigen::Vector3f& place_m) const;

  // The plots at places, by bin.
  const RangeGrid& places() const { return places_; }

  // Forgets the plots of earlier bins.
  void Forget(std::uint32_t before_bin) {
    places_.Forget(before_bin);
    regions_.Forget(before_bin);
  }

 private:
  static constexpr double kWider = 3.0;  // radius of a region over that of a place

  RangeGrid places_;
  RangeGrid regions_;
};

// Sets is_floating of the plots that are static and unsupported. Static: their place holds more
// plots than chance allows, which excludes rain. Plots with neighbours (other static plots beside
// them at the same time, more than the surroundings explain) are excluded, because objects hit too
// seldom to be structure can hold something up as well; static plots at other times do not count,
// as they may be the target itself. Replays of a frame are excluded, too. A transient place may
// float even if part of its surroundings is hidden: an object that is held up does not appear and
// vanish.
void MarkFloating(const Recording& recording, const Support& support, const RobustConfig& config,
                  std::vector<Plot>* plots);

// Same for a stream, from the plots so far; later ones are not known yet, so that no place is
// transient, and a static one must be hit often instead of having no neighbours.
class FloatingPlots {
 public:
  explicit FloatingPlots(const RangeRadius& place) : place_(place), static_places_(place) {}

  // Adds a plot and sets its is_floating. `num_recent_frames`: frames of its sensor in
  // RecentBins(), its own included.
  void Add(const Support& support, std::uint32_t bin, std::uint32_t num_recent_frames, Plot* plot);

  // Forgets the plots of earlier bins.
  void Forget(std::uint32_t before_bin);

  // Returns the bins in which a plot of this bin must be hit often.
  static BinRange RecentBins(std::uint32_t bin);

 private:
  static constexpr std::uint32_t kRecentBins = 6;
  static constexpr std::uint32_t kKeptBins = 2 * kRecentBins;  // frames may come out of order

  RangeRadius place_;
  std::vector<RangeGrid> places_;  // (sensors) their recent plots
  std::uint32_t first_bin_ = 0;    // earlier ones of these are forgotten
  StaticPlaces static_places_;
};

}  // namespace unlidar
