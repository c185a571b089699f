#include "io/sensor_frames.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Enough for a median, few enough to follow a sensor whose rate was changed.
constexpr std::size_t kStreamStamps = 101;

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
  if (reading_ || frame->return_rows.empty()) return;
  for (const std::uint32_t row : frame->return_rows) {
    vote_.Add(RawTimeOf(frame->cloud, row), frame->file.stamp_ns);
  }
  if (source_ == Source::kStream) reading_ = vote_.Winner();
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
