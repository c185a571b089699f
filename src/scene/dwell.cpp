#include "scene/dwell.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace unlidar {
namespace {

// Breaks so long that a dwell would have fewer of them by chance end it, if it has so many hits
// that their share is known.
constexpr double kMinChanceBreaks = 0.05;
constexpr int kEnoughDwellHits = 16;

}  // namespace

Dwell DwellAt(const RecentBins& hits, int at, int max_break) {
  std::array<Dwell, RecentBins::kWindow / 2 + 1> runs{};  // youngest first
  std::size_t count = 0;
  for (int age = 0; age < RecentBins::kWindow; ++age) {
    if (!hits.Contains(age) && age != at) continue;
    if (count == 0 || age - runs[count - 1].oldest > max_break + 1) runs[count++] = {age, age, 0};
    runs[count - 1].oldest = age;
    ++runs[count - 1].num_hits;
  }
  for (std::size_t before = 0; before != count;) {
    before = std::exchange(count, 1);
    for (std::size_t i = 1; i < before; ++i) {
      Dwell& last = runs[count - 1];
      const int num_hits = last.num_hits + runs[i].num_hits;
      const int length = last.length() + runs[i].length();
      if (runs[i].youngest - last.oldest - 1 <= LongestBreak(num_hits, length, max_break)) {
        last = {last.youngest, runs[i].oldest, num_hits};
      } else {
        runs[count++] = runs[i];
      }
    }
  }
  return *std::find_if(runs.begin(), runs.end(),
                       [&](const Dwell& run) { return at <= run.oldest; });
}

int LongestBreak(int num_hits, int length, int max_break) {
  if (num_hits < kEnoughDwellHits || num_hits == length) return max_break;
  const double log_empty = std::log1p(-static_cast<double>(num_hits) / length);
  const double by_chance = std::log(kMinChanceBreaks / num_hits) / log_empty;
  return std::max(max_break, static_cast<int>(std::min(by_chance, 1.0 * RecentBins::kWindow)));
}

}  // namespace unlidar
