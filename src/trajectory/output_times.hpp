// Output times: the instants at which rows are written.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/recording.hpp"

namespace unlidar {

// Instants in ascending order. Those of a rate are computed on demand.
class OutputInstants {
 public:
  OutputInstants() = default;
  explicit OutputInstants(std::vector<TimeNs> list) : list_(std::move(list)), size_(list_.size()) {}

  // begin + floor(k / rate) up to the end, in integers and thus without drift. Throws UsageError
  // for more than 10 million.
  OutputInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns);

  // Replaces the instants by the list [first, last), reusing memory.
  template <class Iterator>
  void SetList(Iterator first, Iterator last) {
    list_.assign(first, last);
    nanohertz_ = 0;
    size_ = list_.size();
  }

  std::size_t size() const { return size_; }
  TimeNs operator[](std::size_t k) const;

  // Returns the number of instants before the time, the index of the first one not before it; of a
  // rate as if it had no end.
  std::size_t CountBefore(TimeNs time_ns) const;

 private:
  std::vector<TimeNs> list_;     // empty for a rate
  std::uint64_t nanohertz_ = 0;  // 0 for a list
  TimeNs begin_ns_ = 0;
  std::size_t size_ = 0;
};

// A rate runs from the start of the first frame to the end of the last one.
OutputInstants ResolveOutputTimes(const OutputTimes& times, const Recording& recording);

}  // namespace unlidar
