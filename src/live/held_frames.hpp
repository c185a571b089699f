// Frames that wait until their stamps are borne out.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/pcd.hpp"
#include "live/stamp_judge.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// One frame of one sensor, in the sensor's own axes and by its own clock.
struct CloudFrame {
  std::uint32_t sensor = 0;  // index into the sensors of the engine
  TimeNs stamp_ns = 0;       // as its source says: the sensor's time offset is not yet applied
  std::string_view name;     // what messages call it
  PcdCloud cloud;
  std::optional<Arrival> arrival;  // of live sources
};

class HeldFrames {
 public:
  // Of all sensors together: 20 MB or so, and more than any clock takes to be believed.
  static constexpr std::size_t kMaxFrames = 256;
  static constexpr std::size_t kMaxPoints = std::size_t{1} << 20;

  struct Held {
    TimeNs time_ns = 0;  // the stamp, with the sensor's time offset
    std::string name;
    CloudFrame frame;
  };

  bool empty() const { return held_.empty(); }
  bool Has(std::uint32_t sensor, TimeNs time_ns) const;
  void Add(CloudFrame frame, TimeNs time_ns);

  // Takes the earliest of those for which `is_due(sensor, time_ns)`; false where there is none.
  template <class IsDue>
  bool TakeEarliest(const IsDue& is_due, Held* taken);

  // Takes one that is to go: one for which `is_to_go(sensor, time_ns)`, else, where there are too
  // many, the one of the sensor with the most that has waited longest.
  template <class IsToGo>
  bool TakeSurplus(const IsToGo& is_to_go, Held* taken);

 private:
  using Place = std::vector<Held>::iterator;

  bool TakeAt(Place place, Held* taken);
  Place OldestOfMost();
  bool IsOverfull() const;

  std::vector<Held> held_;  // as they came
  std::size_t points_ = 0;
};

template <class IsDue>
bool HeldFrames::TakeEarliest(const IsDue& is_due, Held* taken) {
  Place earliest = held_.end();
  for (Place at = held_.begin(); at != held_.end(); ++at) {
    const bool is_earlier =
        earliest == held_.end() || std::make_pair(at->time_ns, at->frame.sensor) <
                                       std::make_pair(earliest->time_ns, earliest->frame.sensor);
    if (is_earlier && is_due(at->frame.sensor, at->time_ns)) earliest = at;
  }
  return TakeAt(earliest, taken);
}

template <class IsToGo>
bool HeldFrames::TakeSurplus(const IsToGo& is_to_go, Held* taken) {
  const Place found = std::find_if(held_.begin(), held_.end(), [&](const Held& held) {
    return is_to_go(held.frame.sensor, held.time_ns);
  });
  if (found != held_.end()) return TakeAt(found, taken);
  return IsOverfull() && TakeAt(OldestOfMost(), taken);
}

}  // namespace unlidar
