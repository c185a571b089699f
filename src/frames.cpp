#include "unlidar/frames.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <sstream>
#include <utility>

#include "frame_directory.hpp"
#include "point_times.hpp"
#include "unlidar/error.hpp"
#include "unlidar/pcd.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kSingleFramePeriodNs = 100'000'000;
constexpr TimeNs kMaxPeriodNs = 3'600'000'000'000;
constexpr TimeNs kMinTimeToleranceNs = 1'000'000'000;
constexpr TimeNs kTimeTolerancePeriods = 10;

// A frame in the common frame, its times still to be told.
struct LoadedFrame {
  FrameFile file;
  PcdCloud cloud;                          // times of all rows; the points have moved on
  std::vector<std::uint32_t> return_rows;  // (N) rows of the returns, only with point times
  std::vector<Eigen::Vector3f> points_m;   // (N)
  std::vector<TimeNs> times_ns;            // (N)
  InputCounts counts;
  FrameInfo info;
};

// Adds the rows of one frame; `frames` and `bad_frames` are counted elsewhere.
void AddCounts(const InputCounts& from, InputCounts& to) {
  to.empty_frames += from.empty_frames;
  to.rows += from.rows;
  to.no_return_rows += from.no_return_rows;
  to.non_finite_rows += from.non_finite_rows;
  to.out_of_range_rows += from.out_of_range_rows;
  to.returns += from.returns;
}

std::string SourceName(const FrameSource& source) {
  if (!source.name.empty()) return source.name;
  const std::filesystem::path path = std::filesystem::absolute(source.directory).lexically_normal();
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

void CheckNames(const std::vector<FrameSource>& sources) {
  std::map<std::string, std::string> directories;
  for (const FrameSource& source : sources) {
    const auto [other, is_new] = directories.emplace(SourceName(source), source.directory);
    if (is_new) continue;
    throw UsageError("--frames: " + other->second + " and " + source.directory +
                     " are both named '" + other->first +
                     "', expected NAME=DIR with a name of its own for each");
  }
}

TimeNs MedianPeriod(const std::vector<FrameFile>& files) {
  if (files.size() < 2) return kSingleFramePeriodNs;
  std::vector<TimeNs> periods;
  for (std::size_t i = 1; i < files.size(); ++i) {
    periods.push_back(files[i].stamp_ns - files[i - 1].stamp_ns);
  }
  const auto middle = periods.begin() + static_cast<std::ptrdiff_t>((periods.size() - 1) / 2);
  std::nth_element(periods.begin(), middle, periods.end());
  return std::min(*middle, kMaxPeriodNs);
}

LoadedFrame LoadFrame(const FrameFile& file, const InputConfig& config,
                      const SensorConfig& sensor) {
  LoadedFrame frame;
  frame.file = file;
  frame.cloud = ReadPcd(file.path);
  const std::vector<Eigen::Vector3f> rows = std::move(frame.cloud.points_m);
  const Eigen::Vector4d& q = sensor.rotation_xyzw;
  const Eigen::Matrix3d rotation =
      Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()).normalized().toRotationMatrix();
  InputCounts& counts = frame.counts;
  counts.rows = rows.size();
  for (std::size_t row = 0; row < rows.size(); ++row) {
    if ((rows[row].array() == 0.0F).all()) {  // first: nine of ten rays at the sky
      ++counts.no_return_rows;
      continue;
    }
    const Eigen::Vector3d point_m = rows[row].cast<double>();
    if (!point_m.allFinite()) {
      ++counts.non_finite_rows;
      continue;
    }
    const double range_m = point_m.norm();
    if (range_m < config.min_range_m || range_m > config.max_range_m) {
      ++counts.out_of_range_rows;
      continue;
    }
    frame.points_m.push_back((rotation * point_m + sensor.translation_m).cast<float>());
    if (frame.cloud.time_kind != PcdTimeKind::kNone) {
      frame.return_rows.push_back(static_cast<std::uint32_t>(row));
    }
  }
  counts.returns = frame.points_m.size();
  counts.empty_frames = frame.points_m.empty() ? 1 : 0;
  return frame;
}

std::string Text(const RawTime& raw) {
  if (raw.kind == PcdTimeKind::kInteger) return std::to_string(raw.integer);
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  text << raw.floating;
  return text.str();
}

// Fills info.begin_ns, info.end_ns and times_ns, all without the sensor's time offset.
void SetTimes(TimeReading reading, TimeNs period_ns, StampMeaning meaning, LoadedFrame& frame) {
  const TimeNs stamp_ns = frame.file.stamp_ns;
  FrameInfo& info = frame.info;
  info.stamp_ns = stamp_ns;
  info.begin_ns = stamp_ns;
  if (meaning == StampMeaning::kMiddle) info.begin_ns = stamp_ns - period_ns / 2;
  if (meaning == StampMeaning::kEnd) info.begin_ns = stamp_ns - period_ns;
  info.end_ns = info.begin_ns + period_ns;
  if (frame.cloud.time_kind == PcdTimeKind::kNone) {
    frame.times_ns.assign(frame.points_m.size(), info.begin_ns + period_ns / 2);
    return;
  }

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
  // A ray without a return tells as well when the sensor measured, but owes no sound time.
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

TimeNs OffsetNs(const std::string& name, const SensorConfig& sensor) {
  const double offset_ns = sensor.time_offset_s / kSecondsPerNs;
  if (!(std::abs(offset_ns) < static_cast<double>(kMaxStampNs))) {
    throw ConfigError("sensors." + name + ".time_offset_s: '" +
                      std::to_string(sensor.time_offset_s) + "', expected seconds below 4e9");
  }
  return std::llround(offset_ns);
}

// With the time offset applied as without it: any two times of a recording may be added and
// subtracted.
void CheckStamp(const FrameFile& file, TimeNs offset_ns) {
  const TimeNs stamp_ns = file.stamp_ns + offset_ns;
  if (-kMaxStampNs <= stamp_ns && stamp_ns <= kMaxStampNs) return;
  throw InputError(file.path + ": the stamp " + std::to_string(file.stamp_ns) +
                   " ns with the sensor's time offset of " + std::to_string(offset_ns) +
                   " ns is farther from 1970 than " + std::to_string(kMaxStampNs) +
                   " ns, expected a year from 1844 to 2096");
}

// One source being read: bad frames are thrown or, if the user wants so, noted.
class SourceReader {
 public:
  SourceReader(const FrameSource& source, const InputConfig& config, const SensorConfig& sensor)
      : source_(source), config_(config), sensor_(sensor) {}

  SensorInfo Read(std::uint32_t sensor_index, Recording& recording,
                  std::vector<LoadedFrame>& frames) {
    const std::vector<FrameFile> files = ListFrames(source_.directory);
    SensorInfo info;
    info.name = SourceName(source_);
    info.origin_m = sensor_.translation_m.cast<float>();
    info.frame_period_ns = MedianPeriod(files);
    const TimeNs offset_ns = OffsetNs(info.name, sensor_);
    for (const FrameFile& file : {files.front(), files.back()}) CheckStamp(file, offset_ns);

    std::vector<LoadedFrame> loaded;
    TimeReadingVote vote;
    for (const FrameFile& file : files) {
      UnlessBad([&] {
        loaded.push_back(LoadFrame(file, config_, sensor_));
        const LoadedFrame& frame = loaded.back();
        for (const std::uint32_t row : frame.return_rows) {
          vote.Add(RawTimeOf(frame.cloud, row), file.stamp_ns);
        }
      });
    }
    const TimeReading reading = vote.Winner();
    bool any_frame = false;
    for (LoadedFrame& frame : loaded) {
      UnlessBad([&] {
        SetTimes(reading, info.frame_period_ns, config_.stamp, frame);
        frame.cloud = PcdCloud();
        frame.info.sensor = sensor_index;
        frame.info.stamp_ns += offset_ns;
        frame.info.begin_ns += offset_ns;
        frame.info.end_ns += offset_ns;
        for (TimeNs& time_ns : frame.times_ns) time_ns += offset_ns;
        frames.push_back(std::move(frame));
        any_frame = true;
      });
    }
    if (!any_frame) {
      throw InputError(source_.directory + ": none of its " + std::to_string(files.size()) +
                       " frames can be read, the first: " + warnings_.front());
    }
    recording.counts.bad_frames += warnings_.size();
    recording.warnings.insert(recording.warnings.end(), warnings_.begin(), warnings_.end());
    return info;
  }

 private:
  template <typename Step>
  void UnlessBad(const Step& step) {
    try {
      step();
    } catch (const InputError& error) {
      if (!config_.skip_bad_frames) throw;
      warnings_.emplace_back(error.what());
    }
  }

  const FrameSource& source_;
  const InputConfig& config_;
  const SensorConfig& sensor_;
  std::vector<std::string> warnings_;
};

// Frames in the order of (stamp, sensor), each freed once its returns are in the recording.
void Merge(std::vector<LoadedFrame> frames, Recording& recording) {
  std::sort(frames.begin(), frames.end(), [](const LoadedFrame& a, const LoadedFrame& b) {
    return std::make_pair(a.info.stamp_ns, a.info.sensor) <
           std::make_pair(b.info.stamp_ns, b.info.sensor);
  });
  InputCounts& counts = recording.counts;
  for (const LoadedFrame& frame : frames) AddCounts(frame.counts, counts);
  counts.frames = frames.size();
  if (counts.returns > std::numeric_limits<std::uint32_t>::max()) {
    throw InputError("--frames: " + std::to_string(counts.returns) +
                     " returns in all, expected less than 2^32");
  }
  recording.points_m.reserve(counts.returns);
  recording.times_ns.reserve(counts.returns);
  for (LoadedFrame& loaded : frames) {
    const LoadedFrame frame = std::move(loaded);
    FrameInfo info = frame.info;
    info.first_return = static_cast<std::uint32_t>(recording.points_m.size());
    recording.points_m.insert(recording.points_m.end(), frame.points_m.begin(),
                              frame.points_m.end());
    recording.times_ns.insert(recording.times_ns.end(), frame.times_ns.begin(),
                              frame.times_ns.end());
    info.last_return = static_cast<std::uint32_t>(recording.points_m.size());
    recording.frames.push_back(info);
  }
}

}  // namespace

Recording ReadRecording(const std::vector<FrameSource>& sources, const InputConfig& config,
                        const std::map<std::string, SensorConfig>& sensors) {
  CheckNames(sources);
  Recording recording;
  std::vector<LoadedFrame> frames;
  for (const FrameSource& source : sources) {
    const auto known = sensors.find(SourceName(source));
    const SensorConfig sensor = known == sensors.end() ? SensorConfig() : known->second;
    const auto index = static_cast<std::uint32_t>(recording.sensors.size());
    SourceReader reader(source, config, sensor);
    recording.sensors.push_back(reader.Read(index, recording, frames));
  }
  Merge(std::move(frames), recording);
  return recording;
}

}  // namespace unlidar
