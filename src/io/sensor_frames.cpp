#include "io/sensor_frames.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "base/maths.hpp"
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

constexpr TimeNs kSingleFramePeriodNs = 100'000'000;
constexpr TimeNs kMaxPeriodNs = 3'600'000'000'000;
// The slowest LiDARs take a second for a frame. If stamps are farther apart, frames are missing or
// the stamps are not times: the sensor did not measure throughout.
constexpr TimeNs kMaxFrameNs = 1'000'000'000;
constexpr TimeNs kMinTimeToleranceNs = 1'000'000'000;
constexpr TimeNs kTimeTolerancePeriods = 10;

// Reserves exactly `size` at first, since a recording may have many frames; a quarter more when
// memory is reused, since the next frames differ little in size.
template <class T>
void MakeRoomFor(std::size_t size, std::vector<T>* values) {
  if (size <= values->capacity()) return;
  values->reserve(values->capacity() == 0 ? size : size + size / 4);
}

bool HasTimes(const PcdCloud& cloud) {
  return !cloud.integer_times.empty() || !cloud.floating_times.empty();
}

// The same frame if its LiDAR turns. Where frames are far apart, one turn may last until the next
// frame or, of every n-th frame kept, as long as that of most LiDARs. A target is hit once in a
// turn, so that no streak tells: the turn is timed halfway, and the doubt grows from the stamp on.
FrameInfo TurnOf(FrameInfo frame) {
  const double length_s = SecondsOf(frame.end_ns - frame.begin_ns);
  if (length_s <= kLongestFrameS) return frame;
  const double doubt_s = 0.5 * (length_s - kCommonFrameS);
  const double kept = 1.0 - doubt_s / length_s;
  const double stamp_s = SecondsOf(frame.stamp_ns - frame.begin_ns);
  frame.begin_ns = frame.stamp_ns - NsOf(kept * stamp_s);
  frame.end_ns = frame.begin_ns + NsOf(kept * length_s);
  // Mean square of an instant from the stamp, in lengths, as a target may be hit at any.
  const double square = 1.0 / 12.0 + Square(0.5 - stamp_s / length_s);
  frame.time_sigma_s = static_cast<float>(doubt_s * std::sqrt(square));
  return frame;
}

std::string Text(const RawTime& raw) {
  if (const auto* const integer = std::get_if<std::int64_t>(&raw)) return std::to_string(*integer);
  return ShortestText(std::get<double>(raw));
}

}  // namespace

SensorFrames::SensorFrames(std::uint32_t index, const std::string& name, const Config& config,
                           Source source, std::optional<TimeReading> reading)
    : sensor_(SensorConfigOf(config, name)),
      offset_ns_(NsOf(sensor_.time_offset_s)),
      input_(config.input),
      index_(index),
      source_(source),
      reading_(reading) {
  info_.name = name;
  info_.origin_m = sensor_.translation_m.cast<float>();
  auto own = config.poses.find(name);
  if (own == config.poses.end()) own = config.poses.find("");
  if (own == config.poses.end()) return;
  poses_.emplace(own->second);
  info_.carrier = poses_->carrier();
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
  const std::vector<Eigen::Vector3f> rows = std::move(cloud.points_m);
  frame->cloud = std::move(cloud);
  frame->return_rows.clear();
  frame->points_m.clear();
  frame->times_ns.clear();
  frame->counts = InputCounts();
  frame->info = FrameInfo();
  const Eigen::Matrix3d rotation = RotationOf(sensor_.rotation_xyzw).toRotationMatrix();
  const auto is_no_return = [](const Eigen::Vector3f& row) { return (row.array() == 0.0F).all(); };
  const bool is_timed = HasTimes(frame->cloud);
  InputCounts& counts = frame->counts;
  counts.rows = rows.size();
  const std::size_t most =
      rows.size() - static_cast<std::size_t>(std::count_if(rows.begin(), rows.end(), is_no_return));
  MakeRoomFor(most, &frame->points_m);
  if (is_timed) MakeRoomFor(most, &frame->return_rows);
  for (std::size_t row = 0; row < rows.size(); ++row) {
    if (is_no_return(rows[row])) {  // tested first: nine of ten rays at the sky
      ++counts.no_return_rows;
      continue;
    }
    const Eigen::Vector3d point_m = input_.scale_m * rows[row].cast<double>();
    if (!point_m.allFinite()) {
      ++counts.non_finite_rows;
      continue;
    }
    const double range_m = point_m.norm();
    ranges_.Add(point_m, range_m);
    if (range_m < input_.min_range_m || range_m > input_.max_range_m) {
      ++counts.out_of_range_rows;
      continue;
    }
    frame->points_m.push_back((rotation * point_m + sensor_.translation_m).cast<float>());
    if (is_timed) frame->return_rows.push_back(static_cast<std::uint32_t>(row));
  }
  counts.returns = frame->points_m.size();
  counts.empty_frames = frame->points_m.empty() ? 1 : 0;
  const bool has_returns = ranges_.EndFrame();
  if (source_ == Source::kStream && has_returns) {
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

std::optional<Warning> SensorFrames::PoseWarning() const {
  if (!has_unplaced_) return std::nullopt;
  return Warning{"frames_without_pose",
                 info_.name +
                     ": frames are left out for whose times there are no poses, expected poses at "
                     "most 1 s apart from the first frame to the last"};
}

void SensorFrames::AppendWarnings(bool are_metres, std::vector<Warning>* warnings) const {
  for (Warning& warning : RangeWarnings(are_metres)) warnings->push_back(std::move(warning));
  if (const auto warning = PoseWarning()) warnings->push_back(*warning);
  const TimeNs period_ns = info().frame_period_ns;
  if (period_ns > kLongestPeriodNs) {
    warnings->push_back({"frames_far_apart",
                         info_.name + ": frames are " + std::to_string(period_ns / kNsPerSecond) +
                             " s apart, expected at most 1: are their stamps in another unit than "
                             "seconds?"});
  }
}

void SensorFrames::SetTimes(TimeReading reading, LoadedFrame& frame) const {
  const TimeNs period_ns = info().frame_period_ns;
  const TimeNs stamp_ns = frame.file.stamp_ns;
  FrameInfo& info = frame.info;
  info.stamp_ns = stamp_ns;
  const TimeNs length_ns = std::min(period_ns, kMaxFrameNs);
  info.begin_ns = stamp_ns;
  if (input_.stamp == StampMeaning::kMiddle) info.begin_ns = stamp_ns - length_ns / 2;
  if (input_.stamp == StampMeaning::kEnd) info.begin_ns = stamp_ns - length_ns;
  info.end_ns = info.begin_ns + length_ns;
  MakeRoomFor(frame.points_m.size(), &frame.times_ns);
  if (!HasTimes(frame.cloud)) {
    const FrameInfo turn = TurnOf(info);
    if (SetTimesOfTurn(frame.points_m, sensor_, turn.begin_ns, turn.end_ns, &frame.times_ns)) {
      info = turn;
      info.is_timed = true;
    } else {
      frame.times_ns.assign(frame.points_m.size(), info.middle_ns());
    }
    return;
  }
  info.is_timed = true;

  const TimeNs tolerance_ns = std::max(kMinTimeToleranceNs, kTimeTolerancePeriods * period_ns);
  const auto plausible = [&](const RawTime& raw) {
    const std::optional<TimeNs> time_ns = PointTime(raw, reading, stamp_ns);
    const bool near = time_ns && std::abs(*time_ns - stamp_ns) <= tolerance_ns;
    return near ? time_ns : std::nullopt;
  };
  for (const std::uint32_t row : frame.return_rows) {
    const RawTime raw = RawTimeOf(frame.cloud, row);
    const std::optional<TimeNs> time_ns = plausible(raw);
    if (!time_ns) {
      throw InputError(
          frame.file.path + ": row " + std::to_string(row + 1) + " has the time " + Text(raw) +
          (reading == TimeReading::kOffset ? " after the frame's stamp" : "") +
          ", expected one within " + std::to_string(tolerance_ns / kMinTimeToleranceNs) +
          " s of the stamp " + std::to_string(stamp_ns) + " ns");
    }
    frame.times_ns.push_back(*time_ns);
  }
  // Rays without a return also show when the sensor measured, but their times may be invalid.
  std::optional<TimeNs> begin_ns;
  std::optional<TimeNs> end_ns;
  const std::size_t num_rows = frame.counts.rows;
  for (std::size_t row = 0; row < num_rows; ++row) {
    const std::optional<TimeNs> time_ns = plausible(RawTimeOf(frame.cloud, row));
    if (!time_ns) continue;
    begin_ns = std::min(begin_ns.value_or(*time_ns), *time_ns);
    end_ns = std::max(end_ns.value_or(*time_ns), *time_ns);
  }
  if (!begin_ns) return;
  info.begin_ns = *begin_ns;
  info.end_ns = *end_ns;
}

bool SensorFrames::Finish(LoadedFrame& frame) {
  if (!reading_ && !vote_.empty()) reading_ = vote_.Winner();
  SetTimes(reading_.value_or(vote_.Winner()), frame);
  frame.cloud = PcdCloud();
  frame.info.sensor = index_;
  frame.info.stamp_ns += offset_ns_;
  frame.info.begin_ns += offset_ns_;
  frame.info.end_ns += offset_ns_;
  for (TimeNs& time_ns : frame.times_ns) time_ns += offset_ns_;
  if (Place(&frame)) return true;
  has_unplaced_ = true;
  return false;
}

bool SensorFrames::Place(LoadedFrame* frame) {
  if (!poses_) return true;
  const std::optional<Eigen::Isometry3d> middle = poses_->At(frame->info.middle_ns());
  if (!middle) return false;
  for (std::size_t i = 0; i < frame->points_m.size(); ++i) {
    const std::optional<Eigen::Isometry3d> pose = poses_->At(frame->times_ns[i]);
    if (!pose) return false;
    frame->points_m[i] = (*pose * frame->points_m[i].cast<double>()).cast<float>();
  }
  const Eigen::Vector3d sensor_m = *middle * sensor_.translation_m;
  if (!first_m_) {
    first_m_ = sensor_m;
    info_.origin_m = sensor_m.cast<float>();
  }
  frame->info.carrier.shift_m = (sensor_m - *first_m_).cast<float>();
  frame->info.carrier.rotation = Eigen::Quaterniond(middle->linear()).cast<float>();
  return true;
}

const SensorInfo& SensorFrames::info() const {
  if (std::exchange(is_period_known_, true)) return info_;
  info_.frame_period_ns = kSingleFramePeriodNs;
  if (stamps_ns_.size() < 2) return info_;
  info_.frame_period_ns = std::min(MedianStep(stamps_ns_, &periods_ns_), kMaxPeriodNs);
  return info_;
}

void AddCounts(const InputCounts& from, InputCounts& to) {
  to.empty_frames += from.empty_frames;
  to.rows += from.rows;
  to.no_return_rows += from.no_return_rows;
  to.non_finite_rows += from.non_finite_rows;
  to.out_of_range_rows += from.out_of_range_rows;
  to.returns += from.returns;
}

void Merge(std::vector<LoadedFrame> frames, Recording& recording) {
  std::sort(frames.begin(), frames.end(), [](const LoadedFrame& a, const LoadedFrame& b) {
    return std::make_pair(a.info.stamp_ns, a.info.sensor) <
           std::make_pair(b.info.stamp_ns, b.info.sensor);
  });
  std::size_t num_returns = recording.points_m.size();
  for (const LoadedFrame& frame : frames) {
    AddCounts(frame.counts, recording.counts);
    num_returns += frame.points_m.size();
  }
  recording.counts.frames += frames.size();
  if (num_returns > std::numeric_limits<std::uint32_t>::max()) {
    throw InputError("--frames: " + std::to_string(num_returns) +
                     " returns in all, expected less than 2^32");
  }
  for (LoadedFrame& loaded : frames) {
    const LoadedFrame frame = std::move(loaded);
    FrameInfo info = frame.info;
    info.first_return = static_cast<std::uint32_t>(recording.points_m.size());
    recording.points_m.insert(recording.points_m.end(), frame.points_m.begin(),
                              frame.points_m.end());
    for (const TimeNs time_ns : frame.times_ns) recording.times_ns.push_back(time_ns);
    info.last_return = static_cast<std::uint32_t>(recording.points_m.size());
    recording.frames.push_back(info);
  }
}

}  // namespace unlidar
