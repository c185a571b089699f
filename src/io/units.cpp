#include "io/units.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/algorithms.hpp"
#include "base/format.hpp"

namespace unlidar {
namespace {

constexpr int kMinExponent = -10;
constexpr int kBitsPerOctave = 3;
constexpr double kStepsPerOctave = 1 << kBitsPerOctave;
// Of an IEEE 754 double: the bits below those that tell its step, and the first step in those
// above.
static_assert(std::numeric_limits<double>::is_iec559);
constexpr int kLowerBits = std::numeric_limits<double>::digits - 1 - kBitsPerOctave;
constexpr std::int64_t kFirstStep = (std::numeric_limits<double>::max_exponent - 1 + kMinExponent)
                                    << kBitsPerOctave;

constexpr std::uint64_t kMinReturns = 20;
constexpr std::uint64_t kMinReturnsToRefuse = 2'000;
constexpr std::uint64_t kMinFramesToRefuse = 5;
// LiDARs reach 450 m; the median range of those that reach farthest lies well within this.
constexpr double kFarM = 500.0;
constexpr double kFarShare = 0.5;
constexpr double kFarOfMaxRange = 0.25;
// The median range of outdoor scenes is 5 to 40 m: in centimetres and in millimetres these
// intervals meet at about this.
constexpr double kMillimetres = 4500.0;
// Map coordinates: far from the origin, and all close together.
constexpr double kMapSpread = 0.05;
// In metres, nine tenths of the returns of 21 recordings lie within 1.1 m (a depth camera above a
// table) to 92 m (a street).
constexpr double kNearM = 1.0;
constexpr double kNearShare = 0.9;
// In metres, the nearest twentieth of these returns lies within 14 m at most; in centimetres this
// limit is 40 m or more in 17 of 21. A cloud above a LiDAR that sees only the sky is as far away,
// but spans fewer ranges; stray returns in an empty sky are few per frame.
constexpr double kNearestM = 40.0;
constexpr double kNearestShare = 0.05;
constexpr double kFarthestShare = 0.99;
constexpr double kMinSpanRatio = 3.0;
constexpr std::uint64_t kMinReturnsPerFrame = 200;

double FarM(double max_range_m) { return std::max(kFarM, kFarOfMaxRange * max_range_m); }

bool AreOfMap(const RangeStatistics& ranges, double far_m) {
  return ranges.mean_m() > far_m && ranges.spread_m() < kMapSpread * ranges.mean_m();
}

}  // namespace

std::size_t RangeStatistics::StepOf(double range_m) {
  // The exponent, and after it the leading bits of the fraction.
  const std::int64_t step = (LoadAs<std::int64_t>(&range_m) >> kLowerBits) - kFirstStep;
  return static_cast<std::size_t>(
      std::clamp<std::int64_t>(step, 0, static_cast<std::int64_t>(kSteps) - 1));
}

double RangeStatistics::BeginOf(std::size_t step) {
  const double octave = std::floor(static_cast<double>(step) / kStepsPerOctave);
  const double part = static_cast<double>(step) - octave * kStepsPerOctave;
  return std::ldexp(1.0 + part / kStepsPerOctave, static_cast<int>(octave) + kMinExponent);
}

void RangeStatistics::Add(const Eigen::Vector3d& point_m, double range_m) {
  ++steps_[StepOf(range_m)];
  ++returns_;
  sum_m_ += point_m;
  sum_of_squares_m2_ += range_m * range_m;
}

bool RangeStatistics::EndFrame() {
  const bool has_returns = std::exchange(returns_before_, returns_) < returns_;
  frames_ += has_returns ? 1U : 0U;
  return has_returns;
}

double RangeStatistics::ShareBeyond(double range_m) const {
  std::uint64_t beyond = 0;
  for (std::size_t i = StepOf(range_m) + 1; i < kSteps; ++i) beyond += steps_[i];
  return returns_ == 0 ? 0.0 : static_cast<double>(beyond) / static_cast<double>(returns_);
}

double RangeStatistics::Quantile(double share) const {
  double left = share * static_cast<double>(returns_);
  for (std::size_t i = 0; i < kSteps; ++i) {
    left -= static_cast<double>(steps_[i]);
    if (left <= 0.0) return BeginOf(i);
  }
  return BeginOf(kSteps - 1);
}

double RangeStatistics::spread_m() const {
  if (returns_ == 0) return 0.0;
  const double mean_square_m2 = sum_of_squares_m2_ / static_cast<double>(returns_);
  return std::sqrt(std::max(0.0, mean_square_m2 - mean_m() * mean_m()));
}

std::optional<std::string> WhyNotMetres(const RangeStatistics& ranges, double max_range_m) {
  const double far_m = FarM(max_range_m);
  const double share = ranges.ShareBeyond(far_m);
  if (ranges.returns() < kMinReturns || share < kFarShare) return std::nullopt;
  const double middle = ranges.Quantile(0.5);
  const std::string seen = FixedText(100.0 * share, 0) + " % of the returns are farther than " +
                           FixedText(far_m, 0) + " m, the middle one " + FixedText(middle, 0) +
                           " m";
  if (AreOfMap(ranges, far_m)) {
    if (ranges.ShareBeyond(max_range_m) < kFarShare) return std::nullopt;  // reported by a warning
    return seen +
           ", all about one place: likely coordinates of a map (UTM), expected metres from "
           "the sensor: subtract its position";
  }
  const std::string unit =
      middle >= kMillimetres
          ? "likely millimetres, expected metres or input.scale_m=0.001"
          : "likely centimetres, or millimetres in a room, expected metres or input.scale_m=0.01 "
            "(0.001)";
  return seen + ": " + unit + " (or a far larger input.max_range_m if that is true)";
}

std::optional<std::string> WhyCentimetres(const RangeStatistics& ranges) {
  if (!SufficeToRefuse(ranges) || ranges.returns() < kMinReturnsPerFrame * ranges.frames()) {
    return std::nullopt;
  }
  const double nearest_m = ranges.Quantile(kNearestShare);
  if (nearest_m < kNearestM || ranges.Quantile(kFarthestShare) < kMinSpanRatio * nearest_m) {
    return std::nullopt;
  }
  return "19 of 20 returns are farther than " + FixedText(nearest_m, 0) +
         " m, nothing is near: likely centimetres, or feet in the open, expected metres or "
         "input.scale_m=0.01 (0.3048)";
}

bool SufficeToRefuse(const RangeStatistics& ranges) {
  return ranges.returns() >= kMinReturnsToRefuse && ranges.frames() >= kMinFramesToRefuse;
}

std::optional<Warning> WarningOfRanges(const std::string& sensor, const RangeStatistics& ranges,
                                       double max_range_m) {
  if (ranges.returns() < kMinReturns) return std::nullopt;
  const double far_m = FarM(max_range_m);
  if (ranges.ShareBeyond(far_m) >= kFarShare && AreOfMap(ranges, far_m)) {
    return Warning{"map_coordinates",
                   sensor + ": all returns are about one place " + FixedText(ranges.mean_m(), 0) +
                       " m from the origin: coordinates of a map? Expected metres from the sensor"};
  }
  const double share = 1.0 - ranges.ShareBeyond(kNearM);
  if (share < kNearShare) return std::nullopt;
  return Warning{"returns_too_near",
                 sensor + ": " + FixedText(100.0 * share, 0) +
                     " % of the returns are nearer than " + FixedText(kNearM, 1) +
                     " m: a covered window, or coordinates that are not metres (input.scale_m)"};
}

}  // namespace unlidar
