// Whether a sensor moves, by the scene itself.
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <cstddef>
#include <optional>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Of one sensor, by correlative scan matching (Olson, ICRA 2009) of looks of 0.2 s, one each half
// second. A snapshot is the cells of 1 m, seen from above, in which something stands upright:
// walls, trunks, poles, cars. Ground is left out since it looks the same from everywhere.
//
// A sensor that stands sees what stands there again in the same cells, whatever walks about; one
// that moves sees it in cells that a turn and a shift of all of them explain far better. It moves
// where that is so in looks 0.5 s, 2 s or 8 s apart (for 0.3 to 30 m/s and 2 to 60 degrees/s), with
// much the same motion for two seconds without a break. What cannot be matched either way, as in
// fog, tells nothing, nor do walls that go on and on beside it.
class EgoMotion {
 public:
  struct Motion {
    Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();
    double turn_deg_per_s = 0.0;
  };

  // How well a snapshot matches an earlier one: shares of its cells.
  struct Match {
    double stationary = 0.0;
    double moved = 0.0;  // at best
    Motion motion;       // of that
  };

  EgoMotion();

  // A frame: its returns, and where the sensor stands. One that is older than the last begins anew.
  void AddFrame(TimeNs time_ns, const Eigen::Vector3f* begin_m, const Eigen::Vector3f* end_m,
                const Eigen::Vector3f& origin_m);

  // Once it was found to move.
  const std::optional<Motion>& found() const { return found_; }

  // The matches of the last snapshot, of those lags that could be tried.
  const std::vector<Match>& matches() const { return matches_; }

 private:
  // From above, 1 m wide, from -kReach to kReach about the sensor.
  static constexpr int kReach = 40;
  static constexpr int kSide = 2 * kReach;
  using Cells = std::bitset<static_cast<std::size_t>(kSide) * kSide>;

  struct Cell {
    int x = 0;
    int y = 0;
  };
  struct Snapshot {
    TimeNs time_ns = 0;  // of its begin
    Cells cells;         // in which something stands
  };

  static std::size_t CellAt(int x, int y) {
    return static_cast<std::size_t>((x + kReach) * kSide + y + kReach);
  }

  void Collect(const Eigen::Vector3f* begin_m, const Eigen::Vector3f* end_m,
               const Eigen::Vector3f& origin_m);
  void ForgetCollected();
  void EndSnapshot();
  const Snapshot* SnapshotBefore(TimeNs time_ns, TimeNs tolerance_ns) const;
  void Rasterise(const Snapshot& snapshot);
  Match MatchOf(const Snapshot& snapshot, const Snapshot& earlier);

  std::optional<TimeNs> last_ns_;
  bool is_recording_ = false;
  TimeNs snapshot_begin_ns_ = 0;     // of this snapshot, or the last
  std::vector<float> lowest_m_;      // (cells) of this snapshot
  std::vector<float> highest_m_;     // (cells)
  std::vector<Snapshot> snapshots_;  // the last ones, in turns,
  std::size_t num_snapshots_ = 0;    // of so many in all
  std::vector<char> raster_;         // (cells and a margin) where an earlier snapshot has any
  std::vector<Cell> sampled_;        // cells of a snapshot, evenly drawn,
  std::vector<Cell> transformed_;    // and where they come to lie
  std::vector<Match> matches_;
  int moving_snapshots_ = 0;  // in a row, that speak of one motion,
  Motion motion_;             // the last of them
  std::optional<Motion> found_;
};

}  // namespace unlidar
