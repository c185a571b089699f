#include "io/frames.hpp"

#include <algorithm>
#include <exception>
#include <limits>
#include <utility>

#include "base/parallel.hpp"
#include "io/frame_preparation.hpp"
#include "io/pcd.hpp"
#include "io/sensor_frames.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

bool IsSensorName(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  });
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

Recording ReadRecording(const std::vector<FrameSource>& sources, const InputConfig& config,
                        const std::map<std::string, SensorConfig>& sensors) {
  Recording recording;
  FrameReader(sources, config, sensors).ReadUntil(std::numeric_limits<TimeNs>::max(), &recording);
  return recording;
}

}  // namespace unlidar
