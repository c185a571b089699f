// Elevations that the rays of a station have, told from its returns.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "base/recording.hpp"

namespace unlidar {

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

}  // namespace unlidar
