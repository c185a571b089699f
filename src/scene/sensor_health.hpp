// Detects sensors blinded by fog, snow or a covered window: known structure is no longer hit, or
// the air around the sensor is full of returns.
#pragma once

#include <vector>

#include "base/recording.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Health of one sensor at rest: what a moving one should see is not known. Its surroundings are
// divided into directions of equal solid angle and these into places by range. A snapshot records
// which places are hit within half a second. A place hit in most snapshots is structure. The sensor
// becomes blinded if, for three seconds without a break,
//
// - less than half of the structure is hit that is expected from the hit rate of each place,
// - the air within 30 m is full of intermittent returns: several places in each direction with
//   returns are hit in one snapshot and not in the next,
// - nearly all directions return from the window alone,
// - or no returns arrive although some did before;
//
// and recovers after three seconds without any of these. The model of its structure fades over
// hours, but not while blinded. A sensor that was moved sees other structure: if there is about as
// much of it as before, the sensor is not blinded.
class SensorHealth {
 public:
  SensorHealth();

  // Adds the returns of a frame; no effect if the sensor is on a carrier. A frame older than the
  // last one starts a new snapshot and keeps the model.
  void AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m);

  bool is_blinded() const { return is_blinded_; }

  // True if blinded, or if the sensor may prove so when the three seconds have passed.
  bool may_be_blinded() const { return is_blinded_ || contrary_snapshots_ > 0; }

  // Total time blinded, s.
  double blinded_s() const { return static_cast<double>(blinded_ns_) * kSecondsPerNs; }

 private:
  struct Snapshot {
    double expected = 0.0;    // expected number of structure places hit
    double seen = 0.0;        // number of structure places hit
    int directions = 0;       // with returns or known structure
    int near_directions = 0;  // of these, with returns from the window alone
    int strays = 0;           // places in the air whose state changed since the last one
    int returns = 0;
  };

  // Hit rate of each place, as a fraction of `snapshots`.
  struct OccupancyModel {
    std::vector<float> rates;
    double snapshots = 0.0;
  };

  void EndSnapshot();
  Snapshot CompareWith(const OccupancyModel& model) const;
  bool IsDegraded(const Snapshot& snapshot) const;
  void Update(OccupancyModel* model) const;

  OccupancyModel reference_;
  OccupancyModel candidate_;   // model of the time while blinded; empty otherwise
  double mean_returns_ = 0.0;  // per snapshot, while not blinded

  TimeNs last_ns_ = 0;
  TimeNs snapshot_begin_ns_ = 0;
  int frames_ = 0;  // of this snapshot
  int returns_ = 0;
  std::vector<char> hits_;          // by place
  std::vector<char> hits_before_;   // of the previous snapshot
  std::vector<char> has_returned_;  // by direction: others are skipped
  int contrary_snapshots_ = 0;      // consecutive ones that contradict is_blinded_
  bool is_blinded_ = false;
  TimeNs blinded_ns_ = 0;
};

}  // namespace unlidar
