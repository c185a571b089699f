#include "scene/static_places.hpp"

#include <cmath>

namespace unlidar {
namespace {

constexpr std::uint32_t kMinPlots = 3;
constexpr double kOuterReachFactor = 5.0;  // radius of the surroundings over the reach

}  // namespace

bool StaticPlaces::IsStatic(const Eigen::Vector3f& place_m) const {
  const std::uint32_t here = places_.Count(place_m);
  const double chance =
      regions_.Count(place_m) * places_.VolumeM3(place_m) / regions_.VolumeM3(place_m);
  return here >= kMinPlots && here > chance + 3.0 * std::sqrt(chance);
}

void Neighbours::Add(double distance_m, double reach_m, std::int32_t count) {
  if (distance_m >= kOuterReachFactor * reach_m) return;
  (distance_m <= kObjectRadiusM ? self
   : distance_m < reach_m       ? neighbouring
                                : surrounding) += count;
}

bool Neighbours::AreAlike(double nearest_m, double farthest_m, double reach_m) {
  const double outer_m = kOuterReachFactor * reach_m;
  return nearest_m >= outer_m || farthest_m <= kObjectRadiusM ||
         (nearest_m > kObjectRadiusM && farthest_m < reach_m) ||
         (nearest_m > kObjectRadiusM && nearest_m >= reach_m && farthest_m < outer_m);
}

void NeighbourTest::Add(const Eigen::Vector3f& place_m, const Neighbours& neighbours) {
  constexpr std::uint32_t kBin = 0;  // the whole recording
  plots_.Add(place_m, kBin);
  const auto add = [&](std::int32_t count, RangeGrid* grid) {
    if (count > 0) grid->Add(place_m, kBin, count);
  };
  add(neighbours.self, &self_);
  add(neighbours.neighbouring, &neighbouring_);
  add(neighbours.surrounding, &surrounding_);
}

bool NeighbourTest::HasNeighbours(const Eigen::Vector3f& place_m) const {
  // Each neighbour was counted once for every plot of this place near it in time.
  const double times = static_cast<double>(self_.Count(place_m)) / plots_.Count(place_m);
  const double chance = surrounding_.Count(place_m) / times /
                        (kOuterReachFactor * kOuterReachFactor * kOuterReachFactor - 1.0);
  return neighbouring_.Count(place_m) / times > chance + 2.0 * std::sqrt(chance);
}

}  // namespace unlidar
