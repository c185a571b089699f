#include "scene/dwell.hpp"

namespace unlidar {

Dwell DwellAt(const RecentBins& hits, int at, int max_break) {
  Dwell dwell{at, at};
  for (int age = at - 1; age >= 0 && dwell.youngest - age <= max_break + 1; --age) {
    if (hits.Contains(age)) dwell.youngest = age;
  }
  for (int age = at + 1; age < RecentBins::kWindow && age - dwell.oldest <= max_break + 1; ++age) {
    if (hits.Contains(age)) dwell.oldest = age;
  }
  return dwell;
}

}  // namespace unlidar
