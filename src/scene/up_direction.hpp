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
// distinguishes the two. Most scenes have one, so it is looked for first. The test is inconclusive
// for a sensor that sees only sky or a wall, is tilted by less than about 30 degrees, or is rotated
// inside a hall.
//
// The floor or one direction is tested per frame, to bound the time per frame.
class UpDirection {
 public:
  UpDirection();

  // Adds the returns of a frame. `origin_m`: position of the sensor.
  void AddFrame(TimeNs time_ns, PointsView points_m, const Eigen::Vector3f& origin_m);

  // Tests the remaining directions after the last frame.
  void Finish();

  // Unit vector that points up; empty unless z was rejected, which the last direction decides.
  std::optional<Eigen::Vector3f> found() const { return IsDone() ? best_up_ : std::nullopt; }

 private:
  // Evidence that a direction is up.
  struct Evidence {
    // Ground cells, far ones weighted by 1 / distance^2, x share of returns on it x share not
    // below it.
    double ground = 0.0;
    bool has_objects_above = false;
  };

  bool IsDone() const { return step_ > directions_.size(); }
  bool HasFloor();
  // Returns no evidence if there are fewer ground cells than `min_cells`.
  Evidence EvidenceOf(const Eigen::Vector3f& up, double min_cells);
  void TestNext();

  std::vector<Eigen::Vector3f> directions_;  // z first
  std::vector<Eigen::Vector3f> points_m_;    // relative to the sensor
  std::vector<Eigen::Vector3f> rotated_m_;
  Ground ground_;
  std::optional<TimeNs> begin_ns_;          // time of the first frame with a return
  std::size_t step_ = 0;                    // 0: the floor is tested next; k: direction k - 1
  double best_ground_ = 0.0;                // of another direction than z: at least what rejects z
  std::optional<Eigen::Vector3f> best_up_;  // so far; empty if none rejects z
};

}  // namespace unlidar
