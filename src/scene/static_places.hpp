// Places that hold static objects, and the static neighbours of unsupported ones.
#pragma once

#include <Eigen/Core>
#include <cstdint>

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

// Static plots around one unsupported static plot at the same time.
struct Neighbours {
  std::int32_t self = 0;          // within the size of a body, itself included,
  std::int32_t neighbouring = 0;  // within reach of a support,
  std::int32_t surrounding = 0;   // and farther away

  // Adds `count` plots at a distance.
  void Add(double distance_m, double reach_m, std::int32_t count = 1);

  // True if plots at both distances, and all between, count alike.
  static bool AreAlike(double nearest_m, double farthest_m, double reach_m);
};

// Tells whether an unsupported static object has static neighbours within reach: objects hit too
// seldom to be structure can hold it up as well. Static plots at other times do not count, as they
// may be the target itself.
class NeighbourTest {
 public:
  // Adds an unsupported static plot.
  void Add(const Eigen::Vector3f& place_m, const Neighbours& neighbours);

  // True if the plots of a place, at least one, have more neighbours than chance allows, as the
  // density farther away tells.
  bool HasNeighbours(const Eigen::Vector3f& place_m) const;

 private:
  static constexpr RangeRadius kRadius{kObjectRadiusM, 0.01};

  RangeGrid plots_{kRadius};
  // Their neighbours:
  RangeGrid self_{kRadius};
  RangeGrid neighbouring_{kRadius};
  RangeGrid surrounding_{kRadius};
};

}  // namespace unlidar
