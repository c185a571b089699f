#include "io/frames.hpp"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <map>
#include <utility>

#include "base/format.hpp"
#include "base/parallel.hpp"
#include "io/input_limits.hpp"
#include "io/pcd.hpp"
#include "io/sensor_frames.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Largest ratio of the durations of two sensors with the same frame rate.
constexpr double kMaxDurationRatio = 1.3;
constexpr TimeNs kPartNs = 2'000'000'000;

// Reserves memory for the returns of `num_frames` frames, given those of the first `num_read`, as
// growing in steps needs it twice. Memory that is never used costs nothing.
void MakeRoom(std::size_t num_read, std::size_t num_frames, Recording* recording) {
  constexpr double kMargin = 1.25;
  const double size = static_cast<double>(recording->points_m.size()) *
                      static_cast<double>(num_frames) / static_cast<double>(num_read);
  if (size <= static_cast<double>(recording->points_m.capacity())) return;
  recording->points_m.reserve(static_cast<std::size_t>(kMargin * size));
  recording->times_ns.reserve(static_cast<std::size_t>(kMargin * size));
}

}  // namespace

bool IsSensorName(const std::string& name) {
  constexpr const char* kAllowed =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
  return !name.empty() && name.size() <= kMaxSensorNameBytes &&
         name.find_first_not_of(kAllowed) == std::string::npos;
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

// Reads one source; bad frames are thrown or, with skip_bad_frames, counted.
class FrameReader::SourceReader {
 public:
  SourceReader(const FrameSource& source, std::size_t index, const Config& config)
      : directory_(source.directory),
        config_(config.input),
        clock_(source.directory, FrameRateHz(config, SourceName(source))),
        files_(ListFrames(source.directory, &clock_)),
        sensor_(static_cast<std::uint32_t>(index), SourceName(source), config,
                SensorFrames::Source::kRecording) {
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
  std::size_t num_read() const { return next_; }
  const SensorFrames& sensor() const { return sensor_; }
  const FrameClock& clock() const { return clock_; }

  // Number of frames, read or not, before a stamp.
  std::size_t NumUntil(TimeNs until_ns) const {
    const auto end = std::partition_point(files_.begin(), files_.end(), [&](const FrameFile& file) {
      return file.stamp_ns + sensor_.offset_ns() < until_ns;
    });
    return static_cast<std::size_t>(end - files_.begin());
  }

  // Appends the warnings about the frames read so far.
  void AppendWarnings(std::vector<Warning>* warnings) const {
    if (clock_.warning()) warnings->push_back(*clock_.warning());
    sensor_.AppendWarnings(false, warnings);
  }

  void ReadUntil(TimeNs until_ns, Recording* recording, std::vector<LoadedFrame>* frames) {
    const auto unless_bad = [&](const auto& step) {
      try {
        step();
      } catch (const InputError& error) {
        if (!config_.skip_bad_frames) throw;
        ++recording->counts.bad_frames;
        if (first_bad_frame_.empty()) first_bad_frame_ = error.what();
      }
    };
    std::vector<LoadedFrame> loaded;
    const std::size_t first = next_;
    const std::size_t last = NumUntil(until_ns);
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
        if (!sensor_.Finish(frame)) {
          ++recording->counts.unplaced_frames;
          return;
        }
        frames->push_back(std::move(frame));
        any_frame_ = true;
      });
    }
    if (first < files_.size() && next_ == files_.size() && !any_frame_) {
      throw InputError(directory_ + ": none of its " + std::to_string(files_.size()) +
                       (first_bad_frame_.empty()
                            ? " frames has a pose, expected poses of the times of its stamps"
                            : " frames can be read, the first: " + first_bad_frame_));
    }
  }

 private:
  std::string directory_;
  const InputConfig& config_;
  FrameClock clock_;
  std::vector<FrameFile> files_;
  SensorFrames sensor_;
  std::size_t next_ = 0;  // next file to read
  bool any_frame_ = false;
  std::string first_bad_frame_;
};

FrameReader::FrameReader(const std::vector<FrameSource>& sources, const Config& config) {
  CheckNames(sources);
  for (const FrameSource& source : sources) {
    sources_.push_back(std::make_unique<SourceReader>(source, sources_.size(), config));
    first_stamp_ns_ = std::min(first_stamp_ns_, sources_.back()->first_stamp_ns());
    last_stamp_ns_ = std::max(last_stamp_ns_, sources_.back()->last_stamp_ns());
  }
}

FrameReader::~FrameReader() = default;

const FrameClock& FrameReader::first_clock() const { return sources_.front()->clock(); }

// Warns about sensors whose frames cannot belong to one recording.
void FrameReader::AppendClockWarnings(std::vector<Warning>* warnings) const {
  const SourceReader& first = *sources_.front();
  const auto seconds_of = [](const SourceReader& source) {
    return SecondsOf(source.last_stamp_ns() - source.first_stamp_ns());
  };
  for (const auto& other : sources_) {
    const std::string names =
        first.sensor().info().name + " and " + other->sensor().info().name + ": ";
    const TimeNs apart_ns = std::max(other->first_stamp_ns() - first.last_stamp_ns(),
                                     first.first_stamp_ns() - other->last_stamp_ns());
    if (apart_ns > kNsPerSecond) {
      warnings->push_back({"sensors_apart", names + "their frames are of times " +
                                                std::to_string(apart_ns / kNsPerSecond) +
                                                " s apart, expected one recording (numbers beside "
                                                "stamps, or sensors.NAME.time_offset_s)"});
      continue;
    }
    const bool are_assumed = first.clock().warning() && other->clock().warning();
    const double first_s = seconds_of(first);
    const double other_s = seconds_of(*other);
    const auto [shortest_s, longest_s] = std::minmax(first_s, other_s);
    if (are_assumed && longest_s > kMaxDurationRatio * shortest_s + 1.0) {
      warnings->push_back({"sensors_uneven", names + FixedText(first_s, 0) + " s and " +
                                                 FixedText(other_s, 0) +
                                                 " s of numbered frames: of one rate? "
                                                 "sensors.NAME.frame_rate_hz says otherwise"});
    }
  }
}

TimeNs FrameReader::NextStampNs() const {
  TimeNs next_ns = std::numeric_limits<TimeNs>::max();
  for (const auto& source : sources_) next_ns = std::min(next_ns, source->next_stamp_ns());
  return next_ns;
}

TimeNs FrameReader::ReadUntil(TimeNs until_ns, Recording* recording) {
  // Some seconds at a time: frames are in memory twice until they are merged.
  while (NextStampNs() < until_ns) {
    const TimeNs part_ns = std::min(until_ns - kPartNs, NextStampNs()) + kPartNs;
    std::vector<LoadedFrame> frames;
    for (const auto& source : sources_) source->ReadUntil(part_ns, recording, &frames);
    Merge(std::move(frames), *recording);
    std::size_t num_read = 0;
    std::size_t num_frames = 0;
    for (const auto& source : sources_) {
      num_read += source->num_read();
      num_frames += source->NumUntil(until_ns);
    }
    MakeRoom(num_read, num_frames, recording);
  }
  recording->sensors.clear();
  recording->warnings.clear();
  for (const auto& source : sources_) {
    source->sensor().CheckUnits();
    recording->sensors.push_back(source->sensor().info());
    source->AppendWarnings(&recording->warnings);
  }
  AppendClockWarnings(&recording->warnings);
  return NextStampNs();
}

}  // namespace unlidar
