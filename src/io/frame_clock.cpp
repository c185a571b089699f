#include "io/frame_clock.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "io/stamp.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::uint64_t kHourS = 3600;

struct NumberUnit {
  std::uint64_t min_step;
  std::uint64_t max_step;
  double rate_hz;
  const char* words;
};

constexpr std::array<NumberUnit, 4> kUnits = {{
    {0, 19, 10.0, "the numbers of frames, 10 frames a second"},
    {20, 2'000, 1e3, "milliseconds"},
    {20'000, 2'000'000, 1e6, "microseconds"},
    {20'000'000, 2'000'000'000, 1e9, "nanoseconds"},
}};

// `numbers`: ascending; `median_step`: of these, 0 for a single one.
bool AreNumbers(const std::vector<std::uint64_t>& numbers, std::uint64_t median_step) {
  if (numbers.front() < kMinUnixS) return true;
  const bool are_seconds =
      NsPerUnitByMagnitude(static_cast<double>(numbers.back())) == kNsPerSecond;
  return are_seconds && median_step > kHourS;
}

}  // namespace

SensorConfig SensorConfigOf(const Config& config, const std::string& name) {
  const auto known = config.sensors.find(name);
  return known == config.sensors.end() ? SensorConfig() : known->second;
}

double FrameRateHz(const Config& config, const std::string& name) {
  const double rate_hz = SensorConfigOf(config, name).frame_rate_hz;
  return rate_hz > 0.0 ? rate_hz : config.input.frame_rate_hz;
}

void FrameClock::Settle(const std::vector<std::string_view>& names) {
  std::vector<std::uint64_t> numbers;
  bool are_whole = true;
  for (const std::string_view name : names) {
    if (!ParseStamp(name)) continue;
    const auto number = ParseNumber<std::uint64_t>(name);
    are_whole = are_whole && number;
    if (number) numbers.push_back(*number);
  }
  std::sort(numbers.begin(), numbers.end());
  std::vector<std::uint64_t> steps;
  const std::uint64_t step = numbers.size() < 2 ? 0 : MedianStep(numbers, &steps);
  if (numbers.empty() || !are_whole || !AreNumbers(numbers, step)) {
    SetStamps(numbers.empty() ? std::nullopt : std::make_optional(numbers.front()));
    return;
  }
  if (numbers.size() == 1) return;  // no difference to judge by: TimeOf() assumes frame numbers
  SetNumbers(step, std::to_string(numbers.front()) + " to " + std::to_string(numbers.back()) +
                       ", " + std::to_string(step) + " apart");
}

// `whole`: a name that may have been meant as a number, if any.
void FrameClock::SetStamps(std::optional<std::uint64_t> whole) {
  reading_ = Reading::kStamps;
  if (rate_hz_ <= 0.0 || !whole) return;
  warning_ = Warning{"frame_rate_unused",
                     source_ + ": frame_rate_hz is given, but names are stamps (" +
                         std::to_string(*whole) + "), not numbers of frames: it is not used"};
}

void FrameClock::SetNumbers(std::uint64_t step, const std::string& seen) {
  if (rate_hz_ > 0.0) {
    reading_ = Reading::kNumbers;
    return;
  }
  const auto* const unit = std::find_if(kUnits.begin(), kUnits.end(), [&](const NumberUnit& known) {
    return known.min_step <= step && step <= known.max_step;
  });
  if (unit == kUnits.end()) {
    throw InputError(source_ + ": names are whole numbers (" + seen +
                     "), neither numbers of frames nor times of a LiDAR, expected "
                     "input.frame_rate_hz: how many make a second");
  }
  reading_ = Reading::kNumbers;
  rate_hz_ = unit->rate_hz;
  warning_ = Warning{"numbered_frames", source_ + ": names are whole numbers (" + seen +
                                            "), no stamps: taken as " + unit->words +
                                            "; input.frame_rate_hz says how many make a second"};
}

std::optional<TimeNs> FrameClock::TimeOf(std::string_view name) {
  const auto number = ParseNumber<std::uint64_t>(name);
  if (reading_ == Reading::kUnsettled) {
    if (number && *number == 0) {
      last_number_ = 0;
      return 0;
    }
    if (!ParseStamp(name)) return std::nullopt;
    if (number && *number < kMinUnixS) {
      is_assumed_by_one_ = rate_hz_ <= 0.0 && !last_number_;
      SetNumbers(last_number_ ? *number : 0, std::to_string(*number) + " at first");
    } else {
      SetStamps(number);
    }
  }
  if (reading_ == Reading::kStamps) return StampInRange(name);
  if (!number) {
    if (!StampInRange(name)) return std::nullopt;
    throw InputError(source_ + ": " + Quoted(name) +
                     " is a stamp, but frames before are numbered (" +
                     std::to_string(last_number_.value_or(0)) + "), expected one or the other");
  }
  if (is_assumed_by_one_ && last_number_) {
    const auto [less, more] = std::minmax(*number, *last_number_);
    if (more - less > kUnits.front().max_step) {
      throw InputError(source_ + ": names are whole numbers, " + std::to_string(*number) +
                       " after " + std::to_string(*last_number_) +
                       ", expected input.frame_rate_hz: how many make a second (1000: "
                       "milliseconds)");
    }
    is_assumed_by_one_ = false;
  }
  last_number_ = number;
  return OfNumber(static_cast<double>(*number));
}

std::optional<TimeNs> FrameClock::OfNumber(double number) const {
  const double time_ns = number * 1e9 / rate_hz_;
  if (!(time_ns <= static_cast<double>(kMaxStampNs))) return std::nullopt;
  return static_cast<TimeNs>(std::floor(time_ns + 0.5));
}

}  // namespace unlidar
