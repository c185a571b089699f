// End of the rows that earlier runs left in an output.
#pragma once

#include <algorithm>
#include <optional>

#include "unlidar/types.hpp"

namespace unlidar {

// Rows are in order, except for those of a track, which follow at once when it is confirmed. A row
// earlier than the latest by more than this delay shows a clock that was set back: earlier rows
// were ahead. Rows beyond `max_time_ns` count only if there are no others.
class RowTimes {
 public:
  RowTimes(TimeNs max_late_ns, TimeNs max_time_ns)
      : max_late_ns_(max_late_ns), max_time_ns_(max_time_ns) {}

  void Add(TimeNs time_ns) {
    last_ns_ = time_ns;
    Take(time_ns, &latest_ns_);
    if (time_ns <= max_time_ns_) Take(time_ns, &latest_within_ns_);
  }

  // The row at the end.
  std::optional<TimeNs> last_ns() const { return last_ns_; }

  // The latest one by the clock of the end.
  std::optional<TimeNs> latest_ns() const {
    return latest_within_ns_ ? latest_within_ns_ : latest_ns_;
  }

 private:
  void Take(TimeNs time_ns, std::optional<TimeNs>* latest_ns) const {
    const bool has_gone_back = *latest_ns && **latest_ns - time_ns > max_late_ns_;
    *latest_ns = has_gone_back ? time_ns : std::max(latest_ns->value_or(time_ns), time_ns);
  }

  TimeNs max_late_ns_;
  TimeNs max_time_ns_;
  std::optional<TimeNs> last_ns_;
  std::optional<TimeNs> latest_ns_;
  std::optional<TimeNs> latest_within_ns_;
};

}  // namespace unlidar
