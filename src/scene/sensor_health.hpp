// Whether a sensor sees what it should. Fog, snow and a covered window take from it what it saw
// before, or fill the air about it with returns.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Of one sensor. What is about it is cut into directions of equal solid angle, and these into
// places by range; it snapshots at them for half a second at a time. A place that is hit in most
// snapshots is structure. The sensor is blinded where, for three seconds without a break,
//
// - less than half of the structure is seen that should be, by how often each place was hit before,
// - the air within 30 m is full of returns that come and go: places there are hit in one snapshot
// and
//   not in the next, several in each direction that returns anything,
// - nearly all directions return from the window alone,
// - or nothing returns although something did before;
//
// and sees again after three seconds of none of these. What it knows of its structure fades over
// hours, and not while it is blinded. But a sensor that was moved sees other structure: where that
// is about as much as before, it is not blinded.
class SensorHealth {
 public:
  // What a snapshot showed.
  struct Snapshot {
    double expected = 0.0;    // places of structure that should be hit,
    double seen = 0.0;        // and those that were
    int directions = 0;       // that returned something, or should
    int near_directions = 0;  // of them, that returned from the window alone
    int strays = 0;           // places in the air that came or went
    int returns = 0;
  };

  SensorHealth();

  // A frame: its returns, and where the sensor stands. One that is older than the last begins anew
  // to snapshot, but forgets nothing.
  void AddFrame(TimeNs time_ns, const Eigen::Vector3f* begin_m, const Eigen::Vector3f* end_m,
                const Eigen::Vector3f& origin_m);

  bool is_blinded() const { return is_blinded_; }

  // Whether it is, or may turn out to be when three seconds are over.
  bool may_be_blinded() const { return is_blinded_ || contrary_snapshots_ > 0; }

  // For so long it was, in all.
  double blinded_s() const { return static_cast<double>(blinded_ns_) * kSecondsPerNs; }

  // The last snapshot that has ended.
  const Snapshot& snapshot() const { return snapshot_; }

 private:
  // How often each place was hit, as a share of so many snapshots.
  struct OccupancyModel {
    std::vector<float> rates;
    double snapshots = 0.0;
  };

  void EndSnapshot();
  Snapshot CompareWith(const OccupancyModel& model) const;
  bool IsDegraded(const Snapshot& snapshot) const;
  void Update(OccupancyModel* model) const;

  OccupancyModel reference_;
  OccupancyModel candidate_;   // of what it sees while it is blinded; empty otherwise
  double mean_returns_ = 0.0;  // of a snapshot, while it was not

  TimeNs last_ns_ = 0;
  TimeNs snapshot_begin_ns_ = 0;
  int frames_ = 0;  // of this snapshot
  int returns_ = 0;
  std::vector<char> hits_;          // by place
  std::vector<char> hits_before_;   // in the snapshot before
  std::vector<char> has_returned_;  // by direction: others need no snapshot
  Snapshot snapshot_;
  int contrary_snapshots_ = 0;  // in a row, that speak against is_blinded_
  bool is_blinded_ = false;
  TimeNs blinded_ns_ = 0;
};

}  // namespace unlidar
