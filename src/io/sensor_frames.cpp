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
      name_(name),
      input_(input),
      sensor_(sensor),
      source_(source),
      offset_ns_(OffsetNs(name, sensor)),
      reading_(reading) {}

void SensorFrames::CheckStamp(const FrameFile& file) const {
  const TimeNs stamp_ns = file.stamp_ns + offset_ns_;
  if (-kMaxStampNs <= stamp_ns && stamp_ns <= kMaxStampNs) return;
  throw InputError(file.path + ": the stamp " + std::to_string(file.stamp_ns) +
                   " ns with the sensor's time offset of " + std::to_string(offset_ns_) +
                   " ns is farther from 1970 than " + std::to_string(kMaxStampNs) +
                   " ns, expected a year from 1844 to 2096");
}

void SensorFrames::NoteStamp(TimeNs stamp_ns) {
  stamps_ns_.insert(std::upper_bound(stamps_ns_.begin(), stamps_ns_.end(), stamp_ns), stamp_ns);
  if (source_ == Source::kStream && stamps_ns_.size() > kStreamStamps) {
    stamps_ns_.erase(stamps_ns_.begin());
  }
  period_ns_.reset();
}

LoadedFrame SensorFrames::Load(FrameFile file, PcdCloud cloud) {
  LoadedFrame frame = LoadFrame(std::move(file), std::move(cloud), input_, sensor_);
  if (reading_ || frame.return_rows.empty()) return frame;
  for (const std::uint32_t row : frame.return_rows) {
    vote_.Add(RawTimeOf(frame.cloud, row), frame.file.stamp_ns);
  }
  if (source_ == Source::kStream) reading_ = vote_.Winner();
  return frame;
}

void SensorFrames::Finish(LoadedFrame& frame) {
  if (!reading_ && !vote_.empty()) reading_ = vote_.Winner();
  SetTimes(reading_.value_or(vote_.Winner()), FramePeriodNs(), input_.stamp, frame);
  frame.cloud = PcdCloud();
  frame.info.sensor = index_;
  frame.info.stamp_ns += offset_ns_;
  frame.info.begin_ns += offset_ns_;
  frame.info.end_ns += offset_ns_;
  for (TimeNs& time_ns : frame.times_ns) time_ns += offset_ns_;
}

SensorInfo SensorFrames::info() const {
  SensorInfo info;
  info.name = name_;
  info.origin_m = sensor_.translation_m.cast<float>();
  info.frame_period_ns = FramePeriodNs();
  return info;
}

TimeNs SensorFrames::FramePeriodNs() const {
  if (!period_ns_) period_ns_ = MedianPeriod(stamps_ns_, &periods_ns_);
  return *period_ns_;
}

}  // namespace unlidar
