#include "io/sensor_frames.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Enough for a median, few enough to follow a changed frame rate.
constexpr std::size_t kStreamStamps = 101;

// The slowest LiDARs take a second for a frame, and some frames may be missing.
constexpr TimeNs kLongestPeriodNs = 5'000'000'000;

// Time after a stream's first return in which its coordinates are checked: their unit does not
// change later.
constexpr TimeNs kUnitsFromNs = 1'000'000'000;
constexpr TimeNs kUnitsUntilNs = 10'000'000'000;

}  // namespace

SensorFrames::SensorFrames(std::uint32_t index, const std::string& name, const InputConfig& input,
                           const SensorConfig& sensor, Source source,
                           std::optional<TimeReading> reading)
    : index_(index),
      input_(input),
      sensor_(sensor),
      source_(source),
      offset_ns_(OffsetNs(name, sensor)),
      reading_(reading) {
  info_.name = name;
  info_.origin_m = sensor.translation_m.cast<float>();
}

void SensorFrames::CheckStamp(std::string_view name, TimeNs stamp_ns) const {
  if (-kMaxStampNs <= stamp_ns + offset_ns_ && stamp_ns + offset_ns_ <= kMaxStampNs) return;
  throw InputError(std::string(name) + ": the stamp " + std::to_string(stamp_ns) +
                   " ns with the sensor's time offset of " + std::to_string(offset_ns_) +
                   " ns is farther from 1970 than " + std::to_string(kMaxStampNs) +
                   " ns, expected a year from 1844 to 2096");
}

void SensorFrames::NoteStamp(TimeNs stamp_ns) {
  stamps_ns_.insert(std::upper_bound(stamps_ns_.begin(), stamps_ns_.end(), stamp_ns), stamp_ns);
  if (source_ == Source::kStream && stamps_ns_.size() > kStreamStamps) {
    stamps_ns_.erase(stamps_ns_.begin());
  }
  is_period_known_ = false;
}

void SensorFrames::Load(PcdCloud cloud, LoadedFrame* frame) {
  LoadFrame(std::move(cloud), input_, sensor_, frame);
  ranges_.Add(frame->ranges);
  if (source_ == Source::kStream && frame->ranges.returns() > 0) {
    if (!first_return_ns_) first_return_ns_ = frame->file.stamp_ns;
    returns_for_ns_ = frame->file.stamp_ns - *first_return_ns_;
  }
  if (reading_ || frame->return_rows.empty()) return;
  for (const std::uint32_t row : frame->return_rows) {
    vote_.Add(RawTimeOf(frame->cloud, row), frame->file.stamp_ns);
  }
  if (source_ == Source::kStream) reading_ = vote_.Winner();
}

bool SensorFrames::CanTellUnits() const {
  const bool is_due = source_ == Source::kRecording ||
                      (kUnitsFromNs <= returns_for_ns_ && returns_for_ns_ <= kUnitsUntilNs);
  return is_due && SufficeToRefuse(ranges_);
}

std::optional<std::string> SensorFrames::UnitProblem() const {
  if (!CanTellUnits()) return std::nullopt;
  const auto why = WhyNotMetres(ranges_, input_.max_range_m);
  return why ? std::make_optional(info_.name + ": " + *why) : std::nullopt;
}

void SensorFrames::CheckUnits() const {
  if (const auto why = UnitProblem()) throw UnitError(*why);
}

std::vector<Warning> SensorFrames::RangeWarnings(bool are_metres) const {
  auto why = WhyNotMetres(ranges_, input_.max_range_m);
  if (!why) why = WhyCentimetres(ranges_);
  if (why && !are_metres) return {{"not_metres", info_.name + ": " + *why}};
  const auto doubt = WarningOfRanges(info_.name, ranges_, input_.max_range_m);
  return doubt ? std::vector<Warning>{*doubt} : std::vector<Warning>();
}

void SensorFrames::AppendWarnings(bool are_metres, std::vector<Warning>* warnings) const {
  for (Warning& warning : RangeWarnings(are_metres)) warnings->push_back(std::move(warning));
  const TimeNs period_ns = info().frame_period_ns;
  if (period_ns > kLongestPeriodNs) {
    warnings->push_back({"frames_far_apart",
                         info_.name + ": frames are " + std::to_string(period_ns / kNsPerSecond) +
                             " s apart, expected at most 1: are their stamps in another unit than "
                             "seconds?"});
  }
}

void SensorFrames::Finish(LoadedFrame& frame) {
  if (!reading_ && !vote_.empty()) reading_ = vote_.Winner();
  SetTimes(reading_.value_or(vote_.Winner()), info().frame_period_ns, input_.stamp, frame);
  frame.cloud = PcdCloud();
  frame.info.sensor = index_;
  frame.info.stamp_ns += offset_ns_;
  frame.info.begin_ns += offset_ns_;
  frame.info.end_ns += offset_ns_;
  for (TimeNs& time_ns : frame.times_ns) time_ns += offset_ns_;
}

const SensorInfo& SensorFrames::info() const {
  if (!std::exchange(is_period_known_, true)) {
    info_.frame_period_ns = MedianPeriod(stamps_ns_, &periods_ns_);
  }
  return info_;
}

}  // namespace unlidar
