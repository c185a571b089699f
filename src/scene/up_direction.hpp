// Checks from the scene alone that z points up.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "scene/ground.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Ground is the one large plane with objects standing on it and none hanging from it: with z up,
// the lowest returns of many columns lie on it and other returns above it. Each of 26 directions,
// 45 degrees apart, is tested as up with the returns of the first seconds of one sensor. z is
// rejected if another direction has far more ground, with objects on it, unless a flat floor lies
// below: indoors more of the ceiling is seen than of the floor, and only the floor below
// distinguishes the two. The test is inconclusive for a sensor that sees only sky or a wall, is
// tilted by less than about 30 degrees, or is rotated inside a hall.
//
// One direction is tested per frame, to bound the time per frame.
class UpDirection {
 public:
  UpDirection();

  // Adds the returns of a frame. `origin_m`: position of the sensor.
  void AddFrame(TimeNs time_ns, PointsView points_m, const Eigen::Vector3f& origin_m);

  // Tests the remaining directions after the last frame.
  void Finish();

  // Unit vector that points up; empty unless z was rejected.
  const std::optional<Eigen::Vector3f>& found() const { return found_; }

 private:
  bool IsDone() const { return next_ > directions_.size(); }
  // Evidence that a direction is up.
  struct Evidence {
    double cells = 0.0;   // ground cells, far ones weighted by 1 / distance^2
    double ground = 0.0;  // cells x share of returns on it x share not below it
    bool has_objects_above = false;
  };

  Evidence EvidenceOf(const Eigen::Vector3f& up);
  bool HasFloor();
  void TryNext();

  std::vector<Eigen::Vector3f> directions_;  // z first
  std::vector<Eigen::Vector3f> points_m_;    // relative to the sensor
  std::vector<Eigen::Vector3f> rotated_m_;
  Ground ground_;
  std::optional<TimeNs> begin_ns_;  // time of the first frame with a return
  std::size_t next_ = 0;            // direction to test next; beyond the size when done
  Evidence z_;
  Evidence best_;  // of the directions other than z
  Eigen::Vector3f best_up_ = Eigen::Vector3f::UnitZ();
  std::optional<Eigen::Vector3f> found_;
};

}  // namespace unlidar
