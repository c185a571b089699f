// Whether a sensor sees what it should. Fog, snow and a covered window take from it what it saw
// before, or fill the air about it with returns.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Of one sensor. What is about it is cut into directions of equal solid angle, and these into
// places by range; it looks at them for half a second at a time. A place that is hit in most looks
// is structure. The sensor is blinded where, for three seconds without a break,
//
// - less than half of the structure is seen that should be, by how often each place was hit before,
// - the air within 30 m is full of returns that come and go: places there are hit in one look and
//   not in the next, several in each direction that returns anything,
// - nearly all directions return from the window alone,
// - or nothing returns although something did before;
//
// and sees again after three seconds of none of these. What it knows of its structure fades over
// hours, and not while it is blinded. But a sensor that was moved sees other structure: where that
// is about as much as before, it is not blinded.
class SensorSight {
 public:
  // What a look showed.
  struct Look {
    double expected = 0.0;    // places of structure that should be hit,
    double seen = 0.0;        // and those that were
    int directions = 0;       // that returned something, or should
    int near_directions = 0;  // of them, that returned from the window alone
    int strays = 0;           // places in the air that came or went
    int returns = 0;
  };

  SensorSight();

  // A frame: its returns, and where the sensor stands. One that is older than the last begins anew
  // to look, but forgets nothing.
  void AddFrame(TimeNs time_ns, const Eigen::Vector3f* begin_m, const Eigen::Vector3f* end_m,
                const Eigen::Vector3f& origin_m);

  bool is_blinded() const { return is_blinded_; }

  // Whether it is, or may turn out to be when three seconds are over.
  bool is_doubtful() const { return is_blinded_ || contrary_looks_ > 0; }

  // For so long it was, in all.
  double blinded_s() const { return static_cast<double>(blinded_ns_) * kSecondsPerNs; }

  // The last look that has ended.
  const Look& look() const { return look_; }

 private:
  // How often each place was hit, as a share of so many looks.
  struct Picture {
    std::vector<float> rates;
    double looks = 0.0;
  };

  void EndLook();
  Look LookAt(const Picture& picture) const;
  bool IsBad(const Look& look) const;
  void Learn(Picture* picture) const;

  Picture known_;
  Picture other_;              // of what it sees while it is blinded; empty otherwise
  double mean_returns_ = 0.0;  // of a look, while it was not

  TimeNs last_ns_ = 0;
  TimeNs look_begin_ns_ = 0;
  int frames_ = 0;  // of this look
  int returns_ = 0;
  std::vector<char> hits_;          // by place
  std::vector<char> hits_before_;   // in the look before
  std::vector<char> has_returned_;  // by direction: others need no look
  Look look_;
  int contrary_looks_ = 0;  // in a row, that speak against is_blinded_
  bool is_blinded_ = false;
  TimeNs blinded_ns_ = 0;
};

}  // namespace unlidar
