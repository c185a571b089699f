#include "trajectory/output_times.hpp"

#include <algorithm>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// A time in nanoseconds times a rate in nanohertz has up to 114 bits.
__extension__ using Wide = unsigned __int128;

constexpr double kMaxInstants = 1e7;

// Number of instants of a rate within a time from its begin, without that at its end.
std::size_t CountWithin(Wide elapsed_ns, std::uint64_t nanohertz) {
  constexpr Wide kPerInstant = Wide{kNsPerSecond} * kNsPerSecond;
  return static_cast<std::size_t>((elapsed_ns * nanohertz + kPerInstant - 1) / kPerInstant);
}

}  // namespace

OutputInstants::OutputInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns)
    : nanohertz_(static_cast<std::uint64_t>(rate.nanohertz)), begin_ns_(begin_ns) {
  // Unsigned: stamps at both ends of the 64 bits must not overflow.
  const std::uint64_t span_ns =
      static_cast<std::uint64_t>(end_ns) - static_cast<std::uint64_t>(begin_ns);
  const double hertz = static_cast<double>(rate.nanohertz) * kSecondsPerNs;
  const double span_s = static_cast<double>(span_ns) * kSecondsPerNs;
  if (span_s * hertz > kMaxInstants) {
    throw UsageError("--rate " + std::to_string(hertz) + ": a recording of " +
                     std::to_string(span_s) + " s gives over 10 million output times, expected " +
                     "fewer");
  }
  size_ = CountWithin(Wide{span_ns} + 1, nanohertz_);
}

TimeNs OutputInstants::operator[](std::size_t k) const {
  if (nanohertz_ == 0) return list_[k];
  const Wide elapsed_ns = Wide{kNsPerSecond} * kNsPerSecond * k / nanohertz_;
  return static_cast<TimeNs>(static_cast<std::uint64_t>(begin_ns_) +
                             static_cast<std::uint64_t>(elapsed_ns));
}

std::size_t OutputInstants::CountBefore(TimeNs time_ns) const {
  if (nanohertz_ == 0) {
    return static_cast<std::size_t>(std::lower_bound(list_.begin(), list_.end(), time_ns) -
                                    list_.begin());
  }
  if (time_ns <= begin_ns_) return 0;
  return CountWithin(static_cast<std::uint64_t>(time_ns) - static_cast<std::uint64_t>(begin_ns_),
                     nanohertz_);
}

OutputInstants ResolveOutputTimes(const OutputTimes& times, const Recording& recording) {
  if (const auto* const list = std::get_if<std::vector<TimeNs>>(&times)) {
    return OutputInstants(*list);
  }
  std::vector<TimeNs> stamps;
  TimeNs begin_ns = std::numeric_limits<TimeNs>::max();
  TimeNs end_ns = std::numeric_limits<TimeNs>::min();
  for (const FrameInfo& frame : recording.frames) {
    if (frame.sensor == 0) stamps.push_back(frame.stamp_ns);
    begin_ns = std::min(begin_ns, frame.begin_ns);
    end_ns = std::max(end_ns, frame.end_ns);
  }
  const auto* const rate = std::get_if<Rate>(&times);
  if (rate == nullptr) return OutputInstants(std::move(stamps));
  return recording.frames.empty() ? OutputInstants() : OutputInstants(*rate, begin_ns, end_ns);
}

}  // namespace unlidar
