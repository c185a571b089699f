#include "unlidar/engine.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "io/sensor_frames.hpp"
#include "unlidar/error.hpp"
#include "unlidar/pipeline.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kUpdateNs = 1'000'000'000;
constexpr TimeNs kWarmUpNs = 3'000'000'000;
constexpr double kSameTrack_m = 3.0;

TimeNs Ns(double seconds) { return std::llround(seconds / kSecondsPerNs); }

}  // namespace

// A stand-in: keeps every frame, and tracks all of them as a recording at the end, with a finite
// delay also each second.
class Engine::Impl {
 public:
  Impl(Config config, const std::vector<std::string>& sensors, OutputTimes output_times,
       Callback on_event)
      : config_(std::move(config)),
        output_times_(std::move(output_times)),
        on_event_(std::move(on_event)),
        is_endless_(std::isinf(config_.live.delay_s)) {
    for (const std::string& name : sensors) AddSensor(name);
  }

  std::uint32_t AddSensor(const std::string& name) {
    const auto known = config_.sensors.find(name);
    const auto index = static_cast<std::uint32_t>(sensors_.size());
    sensors_.push_back(
        {SensorFrames(index, name, config_.input,
                      known == config_.sensors.end() ? SensorConfig() : known->second),
         0, true});
    return index;
  }

  void Add(Frame frame) {
    Sensor& sensor = sensors_.at(frame.sensor);
    const TimeNs stamp_ns = frame.stamp_ns + sensor.frames.offset_ns();
    if (!is_endless_ && counts_.frames > 0 && stamp_ns < newest_ns_ - Ns(config_.live.reorder_s)) {
      ++late_frames_;
      return;
    }
    if (!stamps_.emplace(frame.sensor, frame.stamp_ns).second) {
      throw InputError(frame.name + ": has the stamp " + std::to_string(frame.stamp_ns) +
                       " ns of an earlier frame, expected one frame for each stamp");
    }
    sensor.frames.NoteStamp(frame.stamp_ns);
    frames_.push_back(sensor.frames.Load({frame.name, frame.stamp_ns}, std::move(frame.cloud)));
    frames_.back().info.sensor = frame.sensor;
    AddCounts(frames_.back().counts, counts_);
    if (counts_.frames++ == 0) {
      first_ns_ = newest_ns_ = last_update_ns_ = stamp_ns;
      on_event_(EngineState::kWarmingUp);
    }
    const bool was_warm = newest_ns_ - first_ns_ >= kWarmUpNs;
    newest_ns_ = std::max(newest_ns_, stamp_ns);
    if (!is_endless_ && !was_warm && newest_ns_ - first_ns_ >= kWarmUpNs) {
      on_event_(EngineState::kRunning);
    }
    TellSensors(frame.sensor, stamp_ns);
    if (!is_endless_ && newest_ns_ - last_update_ns_ >= kUpdateNs) {
      last_update_ns_ = newest_ns_;
      Update(newest_ns_ - Ns(config_.live.delay_s));
    }
  }

  void Close() {
    if (frames_.empty()) return;
    Update(std::numeric_limits<TimeNs>::max());
    for (const Given& track : given_) {
      on_event_(TrackEnded{track.id, track.last_evidence_ns});
    }
  }

  TimeNs newest_ns_ = 0;
  InputCounts counts_;
  std::uint64_t late_frames_ = 0;

 private:
  struct Sensor {
    SensorFrames frames;
    TimeNs newest_ns;
    bool is_silent;
  };
  struct Given {
    int id;
    TimeNs last_evidence_ns;
    TimeNs last_row_ns;
    std::map<TimeNs, Eigen::Vector3d> rows_m;
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

  Recording MergedFrames() {
    Recording recording;
    for (const Sensor& sensor : sensors_) recording.sensors.push_back(sensor.frames.info());
    std::vector<LoadedFrame> frames;
    for (const LoadedFrame& loaded : frames_) {
      frames.push_back(loaded);
      try {
        sensors_[loaded.info.sensor].frames.Finish(frames.back());
      } catch (const InputError&) {
        if (!config_.input.skip_bad_frames) throw;
        frames.pop_back();
      }
    }
    counts_.bad_frames = frames_.size() - frames.size();
    Merge(std::move(frames), recording);
    return recording;
  }

  Given* KnownTrack(const Track& track) {
    for (Given& given : given_) {
      int same = 0;
      for (const TrajectoryRow& row : track.rows) {
        const auto at = given.rows_m.find(row.time_ns);
        if (at == given.rows_m.end()) continue;
        same += (at->second - row.position_m).norm() < kSameTrack_m ? 1 : -1;
      }
      if (same > 0) return &given;
    }
    return nullptr;
  }

  // Gives the rows up to this instant that were not given yet.
  void Update(TimeNs due_ns) {
    const std::vector<Track> tracks = TrackRecording(MergedFrames(), output_times_, config_);
    std::vector<RowGiven> rows;
    for (const Track& track : tracks) {
      Given* given = KnownTrack(track);
      const bool is_new = given == nullptr;
      if (is_new) {
        given_.push_back(
            {static_cast<int>(given_.size()), 0, std::numeric_limits<TimeNs>::min(), {}});
        given = &given_.back();
        on_event_(TrackConfirmed{given->id, track.begin_ns});
      }
      given->last_evidence_ns = track.end_ns;
      for (TrajectoryRow row : track.rows) {
        if (row.time_ns <= given->last_row_ns || row.time_ns > due_ns) continue;
        row.track_id = given->id;
        rows.push_back(
            {row, is_new && !is_endless_ && row.time_ns < newest_ns_ - Ns(config_.live.delay_s)});
        given->last_row_ns = row.time_ns;
        given->rows_m[row.time_ns] = row.position_m;
      }
    }
    std::stable_sort(rows.begin(), rows.end(), [](const RowGiven& a, const RowGiven& b) {
      return std::make_pair(a.row.time_ns, a.row.track_id) <
             std::make_pair(b.row.time_ns, b.row.track_id);
    });
    for (const RowGiven& row : rows) on_event_(row);
  }

  Config config_;
  OutputTimes output_times_;
  Callback on_event_;
  bool is_endless_;
  std::vector<Sensor> sensors_;
  std::set<std::pair<std::uint32_t, TimeNs>> stamps_;
  std::vector<LoadedFrame> frames_;
  std::vector<Given> given_;
  TimeNs first_ns_ = 0;
  TimeNs last_update_ns_ = 0;
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
