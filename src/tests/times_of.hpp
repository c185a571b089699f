// The times of a TimeList, to compare.
#pragma once

#include <cstddef>
#include <vector>

#include "base/time_list.hpp"

namespace unlidar::testing {

inline std::vector<TimeNs> TimesOf(const TimeList& list) {
  std::vector<TimeNs> times_ns;
  for (std::size_t i = 0; i < list.size(); ++i) times_ns.push_back(list[i]);
  return times_ns;
}

}  // namespace unlidar::testing
