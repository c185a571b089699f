#include "io/point_times.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "io/stamp.hpp"

namespace unlidar {
namespace {

std::optional<TimeNs> InNs(std::int64_t value, std::int64_t unit_ns) {
  if (value > kMaxStampNs / unit_ns || value < -kMaxStampNs / unit_ns) return std::nullopt;
  return value * unit_ns;
}

// Converts whole and fractional parts separately: a product of doubles would round Unix time to 256
// ns.
std::optional<TimeNs> InNs(double value, std::int64_t unit_ns) {
  const double unit = static_cast<double>(unit_ns);
  if (!(std::abs(value) < static_cast<double>(kMaxStampNs) / unit)) return std::nullopt;
  const double whole = std::floor(value);
  return static_cast<std::int64_t>(whole) * unit_ns + std::llround((value - whole) * unit);
}

}  // namespace

RawTime RawTimeOf(const PcdCloud& cloud, std::size_t row) {
  if (cloud.floating_times.empty()) return cloud.integer_times[row];
  return cloud.floating_times[row];
}

std::optional<TimeNs> PointTime(const RawTime& raw, TimeReading reading, TimeNs stamp_ns) {
  const auto in_ns = [&](auto value) {
    std::int64_t unit_ns = std::is_integral_v<decltype(value)> ? 1 : kNsPerSecond;
    if (reading == TimeReading::kAbsoluteByMagnitude) {
      unit_ns = NsPerUnitByMagnitude(std::abs(static_cast<double>(value)));
    }
    return InNs(value, unit_ns);
  };
  const std::optional<TimeNs> time_ns = std::visit(in_ns, raw);
  if (!time_ns || reading != TimeReading::kOffset) return time_ns;
  return stamp_ns + *time_ns;  // both within kMaxStampNs
}

void TimeReadingVote::Add(const RawTime& raw, TimeNs stamp_ns) {
  std::size_t nearest = 0;
  std::int64_t nearest_ns = std::numeric_limits<std::int64_t>::max();
  for (std::size_t i = 0; i < votes_.size(); ++i) {
    const std::optional<TimeNs> time_ns = PointTime(raw, static_cast<TimeReading>(i), stamp_ns);
    if (!time_ns) continue;
    const std::int64_t distance_ns = std::abs(*time_ns - stamp_ns);
    if (distance_ns >= nearest_ns) continue;
    nearest_ns = distance_ns;
    nearest = i;
  }
  ++votes_[nearest];
}

TimeReading TimeReadingVote::Winner() const {
  const auto most = std::max_element(votes_.begin(), votes_.end());
  return static_cast<TimeReading>(most - votes_.begin());
}

}  // namespace unlidar
