// Detects a moving sensor from the scene itself.
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <cstddef>
#include <optional>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
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

  struct Cell {
    int x = 0;
    int y = 0;
  };
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
  TimeNs snapshot_begin_ns_ = 0;   // of the current or the last snapshot
  std::vector<float> lowest_m_;    // (cells) of the current snapshot
  std::vector<float> highest_m_;   // (cells)
  Queue<Snapshot> snapshots_;      // at most kNumSnapshots, since the last reset
  std::vector<char> raster_;       // (cells and a margin) of an earlier snapshot, dilated
  std::vector<Cell> sampled_;      // evenly drawn cells of a snapshot
  std::vector<Cell> transformed_;  // the same after rotation
  int moving_snapshots_ = 0;       // consecutive ones with a consistent motion
  Motion motion_;                  // of the last of them
  std::optional<Motion> found_;
};

}  // namespace unlidar
