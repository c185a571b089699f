// A list of times in little memory.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/algorithms.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// The exact times of the returns of a recording at 4 bytes each: as differences from the first time
// of a run, in which they all are within 2 s.
class TimeList {
 public:
  std::size_t size() const { return offsets_ns_.size(); }

  TimeNs operator[](std::size_t i) const { return RunAfter(i)[-1].time_ns + offsets_ns_[i]; }

  void push_back(TimeNs time_ns) {
    constexpr TimeNs kMaxOffsetNs = std::numeric_limits<std::int32_t>::max();
    const TimeNs base_ns = runs_.empty() ? 0 : runs_.back().time_ns;
    if (runs_.empty() || time_ns > base_ns + kMaxOffsetNs || time_ns < base_ns - kMaxOffsetNs) {
      runs_.push_back({offsets_ns_.size(), time_ns});
    }
    offsets_ns_.push_back(static_cast<std::int32_t>(time_ns - runs_.back().time_ns));
  }

  void reserve(std::size_t size) { offsets_ns_.reserve(size); }

  // Keeps the memory.
  void clear() {
    offsets_ns_.clear();
    runs_.clear();
  }

  // Removes the first `count` times.
  void DropFirst(std::size_t count) {
    if (count == 0) return;
    unlidar::DropFirst(count, &offsets_ns_);
    runs_.erase(runs_.begin(), std::max(RunAfter(count), runs_.cbegin() + 1) - 1);
    for (Run& run : runs_) run.first -= std::min(run.first, count);
  }

 private:
  struct Run {
    std::size_t first;  // index of its first time
    TimeNs time_ns;
  };

  // Returns the first run whose times are all behind this index.
  std::vector<Run>::const_iterator RunAfter(std::size_t i) const {
    return std::upper_bound(runs_.begin(), runs_.end(), i,
                            [](std::size_t k, const Run& run) { return k < run.first; });
  }

  std::vector<std::int32_t> offsets_ns_;  // from the time of the run
  std::vector<Run> runs_;                 // in order of indices
};

}  // namespace unlidar
