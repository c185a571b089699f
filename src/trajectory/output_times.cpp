#include "trajectory/output_times.hpp"

#include <algorithm>
#include <utility>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::int64_t kGiga = 1'000'000'000;
constexpr double kMaxInstants = 1e7;
struct InstantsOf {
  const Recording& recording;

  OutputInstants operator()(FirstSensorStamps) const {
    std::vector<TimeNs> stamps;
    for (const FrameInfo& frame : recording.frames) {
      if (frame.sensor == 0) stamps.push_back(frame.stamp_ns);
    }
    return OutputInstants(std::move(stamps));
  }

  OutputInstants operator()(const Rate& rate) const {
    if (recording.frames.empty()) return OutputInstants();
    TimeNs begin_ns = recording.frames.front().begin_ns;
    TimeNs end_ns = recording.frames.front().end_ns;
    for (const FrameInfo& frame : recording.frames) {
      begin_ns = std::min(begin_ns, frame.begin_ns);
      end_ns = std::max(end_ns, frame.end_ns);
    }
    return OutputInstants(rate, begin_ns, end_ns);
  }

  OutputInstants operator()(const std::vector<TimeNs>& list) const { return OutputInstants(list); }
};

}  // namespace

OutputInstants::OutputInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns)
    : nanohertz_(static_cast<std::uint64_t>(rate.nanohertz)), begin_ns_(begin_ns) {
  // Unsigned: stamps at both ends of the 64 bits must not overflow.
  const std::uint64_t span_ns =
      static_cast<std::uint64_t>(end_ns) - static_cast<std::uint64_t>(begin_ns);
  const double hertz = static_cast<double>(rate.nanohertz) / static_cast<double>(kGiga);
  const double span_s = static_cast<double>(span_ns) * kSecondsPerNs;
  if (span_s * hertz > kMaxInstants) {
    throw UsageError("--rate " + std::to_string(hertz) + ": a recording of " +
                     std::to_string(span_s) + " s gives over 10 million output times, expected " +
                     "fewer");
  }
  // The last instant, found step by step from just below the rounded estimate.
  auto last = static_cast<std::uint64_t>(std::max(0.0, span_s * hertz - 2.0));
  while (ElapsedNs(last + 1) - ElapsedNs(last) <= span_ns - ElapsedNs(last)) ++last;
  size_ = last + 1;
}

TimeNs OutputInstants::operator[](std::size_t k) const {
  if (nanohertz_ == 0) return list_[k];
  return static_cast<TimeNs>(static_cast<std::uint64_t>(begin_ns_) + ElapsedNs(k));
}

std::size_t OutputInstants::CountBefore(TimeNs time_ns) const {
  std::size_t before = 0;
  std::size_t not_before = size_;
  while (before < not_before) {
    const std::size_t middle = before + (not_before - before) / 2;
    if ((*this)[middle] < time_ns) {
      before = middle + 1;
    } else {
      not_before = middle;
    }
  }
  return before;
}

// Returns floor(k * 1e18 / nanohertz) for k slightly above kMaxInstants at most. The remainder of
// the division, below 1e15, times k overflows 64 bits; times the thousands of k it does not.
std::uint64_t OutputInstants::ElapsedNs(std::uint64_t k) const {
  constexpr std::uint64_t kDividend = std::uint64_t{1'000'000'000} * 1'000'000'000;
  const std::uint64_t remainder = kDividend % nanohertz_;
  const std::uint64_t thousands = k / 1000 * remainder;
  return k * (kDividend / nanohertz_) + thousands / nanohertz_ * 1000 +
         (thousands % nanohertz_ * 1000 + k % 1000 * remainder) / nanohertz_;
}

OutputInstants ResolveOutputTimes(const OutputTimes& times, const Recording& recording) {
  return std::visit(InstantsOf{recording}, times);
}

}  // namespace unlidar
