// The field of view of a station, told from its returns: its edges, and the elevations between them
// that its rays have.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/angles.hpp"
#include "base/recording.hpp"

namespace unlidar {

// Range of elevations as seen from the viewpoint; by default all. Those of a carrier that tilts are
// relative to its own horizon.
struct ElevationRange {
  double lowest_rad = -M_PI / 2;
  double highest_rad = M_PI / 2;
  std::vector<Eigen::Vector3f> ups{};  // z axis of the carrier at each attitude; none: never tilts

  // True if a direction, a unit vector of elevation `elevation_rad`, is within the range at each
  // attitude.
  bool Contains(const Eigen::Vector3d& direction, double elevation_rad) const {
    const auto is_within = [this](double rad) { return rad > lowest_rad && rad < highest_rad; };
    if (ups.empty()) return is_within(elevation_rad);
    return std::all_of(ups.begin(), ups.end(), [&](const Eigen::Vector3f& up) {
      return is_within(std::asin(std::clamp(direction.dot(up.cast<double>()), -1.0, 1.0)));
    });
  }
};

// What a sensor sees in the axes of its carrier: the directions that ever had returns, and the
// lower and upper edge of the field of view. The sky yields no returns, so an edge is only known if
// the returns of many azimuths end at one elevation, as those of hills, roofs and trees do not.
class FieldOfView {
 public:
  FieldOfView();

  void AddFrame(PointsView points_m, const CarrierPose& carrier);

  // True once the carrier has moved.
  bool is_carrier_moving() const { return is_carrier_moving_; }

  // True if a direction is between the lowest and the highest elevation of all returns and in an
  // azimuth that had any since the carrier moved. `ray_m`: in the axes of the carrier.
  bool Contains(const Eigen::Vector3f& ray_m) const;

  // Returns the elevation (rad) of the lowest return so far, in the axes of the carrier; 0 before
  // the first. The view does not end above it.
  double LowestRad() const;

  // Returns the edges in rad; an unknown edge is at -pi/2 or pi/2.
  ElevationRange Edges() const;

 private:
  void Add(const Eigen::Vector3f& ray_m);

  // Sines of the lowest and highest elevations of all returns, and per azimuth column (exact only
  // near the overall bounds).
  float lowest_;
  float highest_;
  std::array<float, kAzimuthColumns> lowest_of_;
  std::array<float, kAzimuthColumns> highest_of_;
  std::bitset<kAzimuthColumns> columns_;  // with returns since the carrier moved
  CarrierPose first_carrier_;
  bool has_begun_ = false;
  bool is_carrier_moving_ = false;
  double sharp_rad_;                  // width of an edge
  std::vector<Eigen::Vector3f> ups_;  // see ElevationRange
};

// Returns the elevation (rad) below which one return in a hundred of a station lies: near it, the
// legs of people are cut off. Unlike FieldOfView's lower edge it is always known, whether the
// sensor or the scene ends there, and a few returns below it, from a ditch, do not change it. Needs
// at least one point.
double LowestElevationRad(const std::vector<Eigen::Vector3f>& points_m);

// A spinning sensor looks along the cones of its beams and never between them, any sensor never
// beyond the edges of its field of view. A thing that is not seen there may be there all the same.
class WatchedElevations {
 public:
  WatchedElevations();

  // `points_m`: relative to the viewpoint of the station.
  void AddFrame(PointsView points_m, const CarrierPose& carrier);

  // Lets Share() tell by all frames so far; until then all elevations are watched.
  void Update();

  // Returns how much of a line the sensor looks at, 0 to 1. Its ends are seen from the viewpoint of
  // a frame, in the axes of its carrier, the first one below the second.
  double Share(const Eigen::Vector3d& from_m, const Eigen::Vector3d& to_m) const;

  // Returns the distance from beam to beam about a place, across the ray to it; 0 where all is
  // watched, or nothing is known. `ray_m`: from the viewpoint of a frame, in the axes of its
  // carrier.
  double BeamStepM(const Eigen::Vector3d& ray_m) const;

 private:
  void FindBeams();

  static constexpr std::size_t kBands = 1146;  // of sines: a tenth of a degree at the horizon

  std::array<std::uint32_t, kBands> returns_{};  // per band
  std::uint32_t num_returns_ = 0;
  std::array<float, kBands + 1> watched_below_;  // bands up to each
  std::array<float, kBands> beam_steps_{};       // bands from beam to beam
};

// Lines of sight of a frame per steradian, told from the directions of its returns: the sky yields
// none.
class SightDensity {
 public:
  // `points_m`: relative to the viewpoint of the station.
  void AddFrame(PointsView points_m, const CarrierPose& carrier);

  // Lets PerSr() tell by all frames so far; until then it is 0.
  void Update();

  // Returns the density that nine in ten returns exceed: of an uneven sensor, that of its sparse
  // parts. Where a band ends at the edge of the field of view, that of the band beside it counts.
  double PerSr() const { return per_sr_; }

 private:
  static constexpr std::size_t kBands = 64;  // of sines, so that all cells are equal

  std::array<float, kBands * kAzimuthColumns> returns_{};  // per cell
  float num_frames_ = 0.0F;
  double per_sr_ = 0.0;
};

}  // namespace unlidar
