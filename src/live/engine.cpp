#include "live/engine.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "io/sensor_frames.hpp"
#include "live/live_tracker.hpp"
#include "recording/pipeline.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

TimeNs Ns(double seconds) { return std::llround(seconds / kSecondsPerNs); }

}  // namespace

class Engine::Impl {
 public:
  Impl(const Config& config, const std::vector<std::string>& sensors, OutputTimes output_times,
       Callback on_event)
      : config_(config),
        output_times_(std::move(output_times)),
        on_event_(std::move(on_event)),
        is_endless_(std::isinf(config_.live.delay_s)),
        tracker_(config_, output_times_, on_event_) {
    for (const std::string& name : sensors) AddSensor(name);
  }

  std::uint32_t AddSensor(const std::string& name) {
    const auto known = config_.sensors.find(name);
    const auto index = static_cast<std::uint32_t>(sensors_.size());
    sensors_.push_back(
        {SensorFrames(
             index, name, config_.input,
             known == config_.sensors.end() ? SensorConfig() : known->second,
             is_endless_ ? SensorFrames::Source::kRecording : SensorFrames::Source::kStream),
         0,
         true,
         0,
         {}});
    return index;
  }

  void Add(Frame frame) {
    Sensor& sensor = sensors_.at(frame.sensor);
    sensor.frames.CheckStamp({frame.name, frame.stamp_ns});
    const TimeNs stamp_ns = frame.stamp_ns + sensor.frames.offset_ns();
    if (!is_endless_ && counts_.frames > 0 && stamp_ns < newest_ns_ - Ns(config_.live.reorder_s)) {
      ++late_frames_;
      return;
    }
    if (!sensor.stamps_ns.insert(frame.stamp_ns).second) {
      throw InputError(frame.name + ": has the stamp " + std::to_string(frame.stamp_ns) +
                       " ns of an earlier frame, expected one frame for each stamp");
    }
    if (is_endless_) sensor.frames.NoteStamp(frame.stamp_ns);
    LoadedFrame loaded = sensor.frames.Load({frame.name, frame.stamp_ns}, std::move(frame.cloud));
    loaded.info.sensor = frame.sensor;
    AddCounts(loaded.counts, counts_);
    if (counts_.frames++ == 0) {
      newest_ns_ = stamp_ns;
      on_event_(EngineState::kWarmingUp);
    }
    newest_ns_ = std::max(newest_ns_, stamp_ns);
    TellSensors(frame.sensor, stamp_ns);
    waiting_.emplace(std::make_pair(stamp_ns, frame.sensor), std::move(loaded));
    if (is_endless_) return;
    Release(newest_ns_ - Ns(config_.live.reorder_s));
  }

  void Close() {
    if (waiting_.empty() && counts_.frames == 0) return;
    if (is_endless_) {
      TrackAll();
      return;
    }
    Release(std::numeric_limits<TimeNs>::max());
    tracker_.Close(newest_ns_);
  }

  TimeNs newest_ns_ = 0;
  InputCounts counts_;
  std::uint64_t late_frames_ = 0;

 private:
  struct Sensor {
    SensorFrames frames;
    TimeNs newest_ns;
    bool is_silent;
    TimeNs told_period_ns;
    std::set<TimeNs> stamps_ns;  // of the frames that may still come twice
  };

  void TellSensors(std::uint32_t index, TimeNs stamp_ns) {
    sensors_[index].newest_ns = std::max(sensors_[index].newest_ns, stamp_ns);
    for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
      Sensor& sensor = sensors_[i];
      const bool is_silent = i != index && (sensor.is_silent || newest_ns_ - sensor.newest_ns >
                                                                    Ns(config_.live.silent_s));
      if (std::exchange(sensor.is_silent, is_silent) != is_silent) {
        on_event_(SensorChanged{i, is_silent});
      }
    }
  }

  // Hands on the frames up to a stamp in order: none of an earlier stamp will come. Rows depend on
  // what was handed on alone, so that they are the same in whatever order the frames came.
  void Release(TimeNs until_ns) {
    while (!waiting_.empty() && waiting_.begin()->first.first <= until_ns) {
      LoadedFrame frame = std::move(waiting_.begin()->second);
      waiting_.erase(waiting_.begin());
      Sensor& sensor = sensors_[frame.info.sensor];
      while (!sensor.stamps_ns.empty() &&
             *sensor.stamps_ns.begin() + sensor.frames.offset_ns() < until_ns) {
        sensor.stamps_ns.erase(sensor.stamps_ns.begin());
      }
      sensor.frames.NoteStamp(frame.file.stamp_ns);
      const TimeNs now_ns =
          frame.file.stamp_ns + sensor.frames.offset_ns() + Ns(config_.live.reorder_s);
      try {
        sensor.frames.Finish(frame);
      } catch (const InputError&) {
        if (!config_.input.skip_bad_frames) throw;
        ++counts_.bad_frames;
        continue;
      }
      const SensorInfo info = sensor.frames.info();
      if (info.frame_period_ns != std::exchange(sensor.told_period_ns, info.frame_period_ns)) {
        tracker_.SetSensor(frame.info.sensor, info);
      }
      const bool was_warm = tracker_.is_warm();
      tracker_.Take(std::move(frame));
      if (!was_warm && tracker_.is_warm()) on_event_(EngineState::kRunning);
      tracker_.GiveRows(now_ns);
    }
  }

  // With an endless delay no row is due before the end, and then all that there is to know is
  // known: the frames are a recording.
  void TrackAll() {
    Recording recording;
    for (const Sensor& sensor : sensors_) recording.sensors.push_back(sensor.frames.info());
    std::vector<LoadedFrame> frames;
    for (auto& [key, loaded] : waiting_) {
      try {
        sensors_[loaded.info.sensor].frames.Finish(loaded);
        frames.push_back(std::move(loaded));
      } catch (const InputError&) {
        if (!config_.input.skip_bad_frames) throw;
        ++counts_.bad_frames;
      }
    }
    waiting_.clear();
    Merge(std::move(frames), recording);
    const PipelineResult result = TrackRecording(std::move(recording), output_times_, config_);
    std::vector<TrajectoryRow> rows;
    for (const Track& track : result.tracks) {
      on_event_(TrackConfirmed{track.id, track.begin_ns});
      const RowStream next = RowsOf(result, track);
      while (const std::optional<TrajectoryRow> row = next()) rows.push_back(*row);
    }
    std::stable_sort(rows.begin(), rows.end(), [](const TrajectoryRow& a, const TrajectoryRow& b) {
      return std::make_pair(a.time_ns, a.track_id) < std::make_pair(b.time_ns, b.track_id);
    });
    for (const TrajectoryRow& row : rows) on_event_(RowGiven{row, false});
    for (const Track& track : result.tracks) on_event_(TrackEnded{track.id, track.end_ns});
  }

  Config config_;
  OutputTimes output_times_;
  Callback on_event_;
  bool is_endless_;
  std::vector<Sensor> sensors_;
  std::map<std::pair<TimeNs, std::uint32_t>, LoadedFrame> waiting_;
  LiveTracker tracker_;
};

Engine::Engine(const Config& config, std::vector<std::string> sensors, OutputTimes output_times,
               Callback on_event)
    : impl_(std::make_unique<Impl>(config, sensors, std::move(output_times), std::move(on_event))) {
}

Engine::~Engine() = default;

std::uint32_t Engine::AddSensor(const std::string& name) { return impl_->AddSensor(name); }

void Engine::Add(Frame frame) { impl_->Add(std::move(frame)); }

void Engine::Close() { impl_->Close(); }

TimeNs Engine::newest_ns() const { return impl_->newest_ns_; }

const InputCounts& Engine::counts() const { return impl_->counts_; }

std::uint64_t Engine::late_frames() const { return impl_->late_frames_; }

}  // namespace unlidar
