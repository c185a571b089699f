// Checks the pose that tracking requires of a sensor: at rest, or with known poses, and z up.
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/ground.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Ego motion of one sensor, by correlative scan matching (Olson, ICRA 2009) of snapshots of 0.2 s,
// one every half second. A snapshot is the set of 1 m cells, seen from above, that contain
// something upright: walls, trunks, poles, cars. Ground is left out since it looks the same from
// everywhere.
//
// A stationary sensor sees static objects in the same cells again, whatever moves around it; for a
// moving one, a rotation and translation of all cells match far better. The sensor is reported as
// moving if that holds for snapshots 0.5 s, 2 s or 8 s apart (0.3 to 30 m/s and 2 to 60 degrees/s),
// with a consistent motion for two seconds without a break. Snapshots that match neither way, as in
// fog, carry no evidence, nor do long uniform walls beside the sensor.
class EgoMotion {
 public:
  static constexpr int kReach = 40;  // of cells, around the sensor

  struct Motion {
    Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();
    double turn_deg_per_s = 0.0;
  };

  EgoMotion();

  // Adds the returns of a frame; `origin_m`: position of the sensor. A frame older than the last,
  // or more than 10 s later, resets the state.
  void AddFrame(TimeNs time_ns, PointsView points_m, const Eigen::Vector3f& origin_m);

  // Set once the sensor was found to move.
  const std::optional<Motion>& found() const { return found_; }

 private:
  // Match of a snapshot with an earlier one: shares of its cells that coincide.
  struct Match {
    double stationary = 0.0;
    double moved = 0.0;  // best over all motions tried
    Motion motion;       // that yields `moved`
  };

  // Cells of 1 m, seen from above.
  static constexpr int kSide = 2 * kReach;
  using Cells = std::bitset<static_cast<std::size_t>(kSide) * kSide>;

  struct Snapshot {
    TimeNs time_ns = 0;  // begin
    Cells cells;         // with something upright
  };

  static std::size_t CellAt(int x, int y) {
    return static_cast<std::size_t>((x + kReach) * kSide + y + kReach);
  }

  void ResetHeights();
  void EndSnapshot();
  Match MatchOf(const Snapshot& snapshot, const Snapshot& earlier);

  std::optional<TimeNs> last_ns_;
  bool is_recording_ = false;
  TimeNs snapshot_begin_ns_ = 0;          // of the current or the last snapshot
  std::vector<float> lowest_m_;           // (cells) of the current snapshot
  std::vector<float> highest_m_;          // (cells)
  Queue<Snapshot> snapshots_;             // at most kNumSnapshots, since the last reset
  std::vector<char> raster_;              // (cells and a margin) of an earlier snapshot, dilated
  std::vector<Eigen::Vector2i> sampled_;  // evenly drawn cells of a snapshot
  std::vector<Eigen::Vector2i> transformed_;  // the same after rotation
  int moving_snapshots_ = 0;                  // consecutive ones with a consistent motion
  Motion motion_;                             // of the last of them
  std::optional<Motion> found_;
};

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
  void Finish() {
    while (!IsDone()) TestNext();
  }

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

// Checks one sensor from its frames, in the common coordinate frame. Its warnings:
//
//   upside_down   z points down
//   z_not_up      z points in another direction
//   sensor_moves  the sensor moves, but has no poses
class PoseCheck {
 public:
  void AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m);

  // Completes the checks after the last frame.
  void Finish() { up_.Finish(); }

  // Returns the warnings so far.
  std::vector<Warning> WarningsOf(const std::string& sensor) const;

 private:
  UpDirection up_;
  EgoMotion motion_;
};

}  // namespace unlidar
