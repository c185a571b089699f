// The instants at which rows are written.
#pragma once

#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

struct FirstSensorStamps {};
struct Rate {
  std::int64_t nanohertz = 0;
};
// The instants of a rate one after the other: begin + floor(k / rate), in integers and thus without
// drift.
class RateClock {
 public:
  RateClock(const Rate& rate, TimeNs begin_ns)
      : divisor_(static_cast<std::uint64_t>(rate.nanohertz)), now_ns_(begin_ns) {}

  TimeNs now_ns() const { return now_ns_; }
  std::uint64_t StepNs() const { return kDividend / divisor_ + NextRemainder() / divisor_; }
  void Step() {
    now_ns_ = static_cast<TimeNs>(static_cast<std::uint64_t>(now_ns_) + StepNs());
    remainder_ = NextRemainder() % divisor_;
  }

 private:
  static constexpr std::uint64_t kDividend = std::uint64_t{1'000'000'000} * 1'000'000'000;
  std::uint64_t NextRemainder() const { return remainder_ + kDividend % divisor_; }

  std::uint64_t divisor_;
  std::uint64_t remainder_ = 0;
  TimeNs now_ns_;
};

using OutputTimes = std::variant<FirstSensorStamps, Rate, std::vector<TimeNs>>;

// A decimal number of hertz, read exactly. Throws UsageError outside (0, 1e6] Hz.
Rate ParseRate(std::string_view text);

// One stamp a line, or a CSV with a column `timestamp`; blank lines and lines that begin with '#'
// are skipped. Returns them in ascending order, each once. Throws InputError naming file and line.
std::vector<TimeNs> ReadStampList(const std::string& path);

// The instants in ascending order. A rate runs from the first frame's begin to the last frame's
// end: begin + floor(k / rate), in integers and thus without drift. Throws UsageError for a rate
// that gives more than 10 million instants.
std::vector<TimeNs> ResolveOutputTimes(const OutputTimes& times, const Recording& recording);

}  // namespace unlidar
