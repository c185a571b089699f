#include "io/frames.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <limits>
#include <sstream>
#include <utility>

#include "base/parallel.hpp"
#include "io/frame_preparation.hpp"
#include "io/pcd.hpp"
#include "io/sensor_frames.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kSingleFramePeriodNs = 100'000'000;
constexpr TimeNs kMaxPeriodNs = 3'600'000'000'000;
// The slowest LiDARs take a second for a frame. Where stamps lie farther apart, frames were left
// out or the stamps are no times: the sensor did not measure all the while.
constexpr TimeNs kMaxFrameNs = 1'000'000'000;
constexpr TimeNs kMinTimeToleranceNs = 1'000'000'000;
constexpr TimeNs kTimeTolerancePeriods = 10;

// No more than it takes, for a recording may have many frames; but where memory is used again also
// for the next ones, which differ by little.
template <class T>
void MakeRoomFor(std::size_t size, std::vector<T>* values) {
  if (size <= values->capacity()) return;
  values->reserve(values->capacity() == 0 ? size : size + size / 4);
}

}  // namespace

void AddCounts(const InputCounts& from, InputCounts& to) {
  to.empty_frames += from.empty_frames;
  to.rows += from.rows;
  to.no_return_rows += from.no_return_rows;
  to.non_finite_rows += from.non_finite_rows;
  to.out_of_range_rows += from.out_of_range_rows;
  to.returns += from.returns;
}

bool IsSensorName(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  });
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

TimeNs MedianPeriod(const std::vector<TimeNs>& stamps_ns, std::vector<TimeNs>* periods_ns) {
  if (stamps_ns.size() < 2) return kSingleFramePeriodNs;
  periods_ns->clear();
  for (std::size_t i = 1; i < stamps_ns.size(); ++i) {
    periods_ns->push_back(stamps_ns[i] - stamps_ns[i - 1]);
  }
  const auto middle =
      periods_ns->begin() + static_cast<std::ptrdiff_t>((periods_ns->size() - 1) / 2);
  std::nth_element(periods_ns->begin(), middle, periods_ns->end());
  return std::min(*middle, kMaxPeriodNs);
}

void LoadFrame(PcdCloud cloud, const InputConfig& config, const SensorConfig& sensor,
               LoadedFrame* frame) {
  const std::vector<Eigen::Vector3f> rows = std::move(cloud.points_m);
  frame->cloud = std::move(cloud);
  frame->return_rows.clear();
  frame->points_m.clear();
  frame->times_ns.clear();
  frame->counts = InputCounts();
  frame->info = FrameInfo();
  const Eigen::Vector4d& q = sensor.rotation_xyzw;
  const Eigen::Matrix3d rotation =
      Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()).normalized().toRotationMatrix();
  const auto is_no_return = [](const Eigen::Vector3f& row) { return (row.array() == 0.0F).all(); };
  const bool is_timed = frame->cloud.time_kind != PcdTimeKind::kNone;
  InputCounts& counts = frame->counts;
  counts.rows = rows.size();
  const std::size_t most =
      rows.size() - static_cast<std::size_t>(std::count_if(rows.begin(), rows.end(), is_no_return));
  MakeRoomFor(most, &frame->points_m);
  if (is_timed) MakeRoomFor(most, &frame->return_rows);
  for (std::size_t row = 0; row < rows.size(); ++row) {
    if (is_no_return(rows[row])) {  // first: nine of ten rays at the sky
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
    frame->points_m.push_back((rotation * point_m + sensor.translation_m).cast<float>());
    if (is_timed) frame->return_rows.push_back(static_cast<std::uint32_t>(row));
  }
  counts.returns = frame->points_m.size();
  counts.empty_frames = frame->points_m.empty() ? 1 : 0;
}

namespace {

std::string Text(const RawTime& raw) {
  if (raw.kind == PcdTimeKind::kInteger) return std::to_string(raw.integer);
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  text << raw.floating;
  return text.str();
}

}  // namespace

void SetTimes(TimeReading reading, TimeNs period_ns, StampMeaning meaning, LoadedFrame& frame) {
  const TimeNs stamp_ns = frame.file.stamp_ns;
  FrameInfo& info = frame.info;
  info.stamp_ns = stamp_ns;
  const TimeNs length_ns = std::min(period_ns, kMaxFrameNs);
  info.begin_ns = stamp_ns;
  if (meaning == StampMeaning::kMiddle) info.begin_ns = stamp_ns - length_ns / 2;
  if (meaning == StampMeaning::kEnd) info.begin_ns = stamp_ns - length_ns;
  info.end_ns = info.begin_ns + length_ns;
  MakeRoomFor(frame.points_m.size(), &frame.times_ns);
  if (frame.cloud.time_kind == PcdTimeKind::kNone) {
    frame.times_ns.assign(frame.points_m.size(), info.middle_ns());
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

// One source being read: bad frames are thrown or, if the user wants so, noted.
class FrameReader::SourceReader {
 public:
  SourceReader(const FrameSource& source, std::uint32_t index, const InputConfig& config,
               const SensorConfig& sensor)
      : directory_(source.directory),
        config_(config),
        files_(ListFrames(source.directory)),
        sensor_(index, SourceName(source), config, sensor) {
    for (const FrameFile& file : {files_.front(), files_.back()})
      sensor_.CheckStamp(file.path, file.stamp_ns);
    for (const FrameFile& file : files_) sensor_.NoteStamp(file.stamp_ns);
  }

  TimeNs first_stamp_ns() const { return files_.front().stamp_ns + sensor_.offset_ns(); }
  TimeNs last_stamp_ns() const { return files_.back().stamp_ns + sensor_.offset_ns(); }
  TimeNs next_stamp_ns() const {
    return next_ == files_.size() ? std::numeric_limits<TimeNs>::max()
                                  : files_[next_].stamp_ns + sensor_.offset_ns();
  }
  SensorInfo info() const { return sensor_.info(); }

  void ReadUntil(TimeNs until_ns, Recording* recording, std::vector<LoadedFrame>* frames) {
    std::vector<std::string> warnings;
    const auto unless_bad = [&](const auto& step) {
      try {
        step();
      } catch (const InputError& error) {
        if (!config_.skip_bad_frames) throw;
        warnings.emplace_back(error.what());
      }
    };
    std::vector<LoadedFrame> loaded;
    const std::size_t first = next_;
    const auto end = std::find_if(
        files_.begin() + static_cast<std::ptrdiff_t>(next_), files_.end(),
        [&](const FrameFile& file) { return file.stamp_ns + sensor_.offset_ns() >= until_ns; });
    const auto last = static_cast<std::size_t>(end - files_.begin());
    while (next_ < last) {
      const auto at_once = static_cast<std::size_t>(MaxThreads().load());
      std::vector<PcdCloud> clouds(std::min(at_once, last - next_));
      std::vector<std::exception_ptr> errors(clouds.size());
      ParallelFor(clouds.size(), [&](std::size_t i) {
        try {
          clouds[i] = ReadPcd(files_[next_ + i].path);
        } catch (const InputError&) {
          errors[i] = std::current_exception();
        }
      });
      for (std::size_t i = 0; i < clouds.size(); ++i, ++next_) {
        unless_bad([&] {
          if (errors[i]) std::rethrow_exception(errors[i]);
          LoadedFrame frame;
          frame.file = files_[next_];
          sensor_.Load(std::move(clouds[i]), &frame);
          loaded.push_back(std::move(frame));
        });
      }
    }
    for (LoadedFrame& frame : loaded) {
      unless_bad([&] {
        sensor_.Finish(frame);
        frames->push_back(std::move(frame));
        any_frame_ = true;
      });
    }
    if (first_warning_.empty() && !warnings.empty()) first_warning_ = warnings.front();
    if (first < files_.size() && next_ == files_.size() && !any_frame_) {
      throw InputError(directory_ + ": none of its " + std::to_string(files_.size()) +
                       " frames can be read, the first: " + first_warning_);
    }
    recording->counts.bad_frames += warnings.size();
    recording->warnings.insert(recording->warnings.end(), warnings.begin(), warnings.end());
  }

 private:
  std::string directory_;
  const InputConfig& config_;
  std::vector<FrameFile> files_;
  SensorFrames sensor_;
  std::size_t next_ = 0;  // file to be read
  bool any_frame_ = false;
  std::string first_warning_;
};

FrameReader::FrameReader(const std::vector<FrameSource>& sources, const InputConfig& config,
                         const std::map<std::string, SensorConfig>& sensors)
    : config_(config) {
  CheckNames(sources);
  for (const FrameSource& source : sources) {
    const auto known = sensors.find(SourceName(source));
    sources_.push_back(
        std::make_unique<SourceReader>(source, static_cast<std::uint32_t>(sources_.size()), config_,
                                       known == sensors.end() ? SensorConfig() : known->second));
  }
}

FrameReader::~FrameReader() = default;

TimeNs FrameReader::first_stamp_ns() const {
  TimeNs first_ns = std::numeric_limits<TimeNs>::max();
  for (const auto& source : sources_) first_ns = std::min(first_ns, source->first_stamp_ns());
  return first_ns;
}

TimeNs FrameReader::last_stamp_ns() const {
  TimeNs last_ns = std::numeric_limits<TimeNs>::min();
  for (const auto& source : sources_) last_ns = std::max(last_ns, source->last_stamp_ns());
  return last_ns;
}

TimeNs FrameReader::ReadUntil(TimeNs until_ns, Recording* recording) {
  std::vector<LoadedFrame> frames;
  for (const auto& source : sources_) source->ReadUntil(until_ns, recording, &frames);
  recording->sensors.clear();
  for (const auto& source : sources_) recording->sensors.push_back(source->info());
  Merge(std::move(frames), *recording);
  TimeNs next_ns = std::numeric_limits<TimeNs>::max();
  for (const auto& source : sources_) next_ns = std::min(next_ns, source->next_stamp_ns());
  return next_ns;
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
  recording.points_m.reserve(num_returns);
  recording.times_ns.reserve(num_returns);
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

Recording ReadRecording(const std::vector<FrameSource>& sources, const InputConfig& config,
                        const std::map<std::string, SensorConfig>& sensors) {
  Recording recording;
  FrameReader(sources, config, sensors).ReadUntil(std::numeric_limits<TimeNs>::max(), &recording);
  return recording;
}

}  // namespace unlidar
