#include "live/live_engine.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "recording/pipeline.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// So many frames of each sensor in a row tell of a clock that has gone back; fewer may be astray.
constexpr int kFramesOfPast = 8;

template <class Waiting>
bool ComesLater(const Waiting& a, const Waiting& b) {
  return b.ComesBefore(a);
}

}  // namespace

void CheckLive(const Config& config) {
  if (config.method == Method::kRobust || std::isinf(config.live.delay_s)) return;
  throw ConfigError(
      "method: 'paper', expected robust for frames that come one by one: the paper's score needs "
      "the whole recording (live.delay_s: .inf)");
}

LiveEngine::LiveEngine(const Config& config, const std::vector<std::string>& sensors,
                       OutputTimes output_times, EngineCallback on_event,
                       std::optional<TimeReading> reading)
    : config_(config),
      output_times_(std::move(output_times)),
      on_event_(std::move(on_event)),
      reading_(reading),
      is_endless_(std::isinf(config_.live.delay_s)),
      tracker_(std::make_unique<LiveTracker>(config_, output_times_, on_event_)) {
  for (const std::string& name : sensors) AddSensor(name);
}

std::uint32_t LiveEngine::AddSensor(const std::string& name) {
  const auto index = static_cast<std::uint32_t>(sensors_.size());
  sensors_.emplace_back(FramesOf(index, name));
  return index;
}

SensorFrames LiveEngine::FramesOf(std::uint32_t sensor, const std::string& name) const {
  const auto known = config_.sensors.find(name);
  return {sensor,
          name,
          config_.input,
          known == config_.sensors.end() ? SensorConfig() : known->second,
          is_endless_ ? SensorFrames::Source::kRecording : SensorFrames::Source::kStream,
          reading_};
}

void LiveEngine::Add(CloudFrame frame) {
  Sensor& sensor = sensors_.at(frame.sensor);
  sensor.frames.CheckStamp(frame.name, frame.stamp_ns);
  const TimeNs stamp_ns = frame.stamp_ns + sensor.frames.offset_ns();
  if (!is_endless_ && has_begun_ && stamp_ns < SettledNs()) {
    if (!HasClockGoneBack(&sensor, stamp_ns)) {
      ++late_frames_;
      return;
    }
    BeginAnew();
  } else if (HasForgottenAll(stamp_ns)) {
    BeginAnew();
  }
  sensor.frames_of_past = 0;
  const auto at =
      std::lower_bound(sensor.stamps_ns.begin(), sensor.stamps_ns.end(), frame.stamp_ns);
  if (at != sensor.stamps_ns.end() && *at == frame.stamp_ns) {
    throw InputError(std::string(frame.name) + ": has the stamp " + std::to_string(frame.stamp_ns) +
                     " ns of an earlier frame, expected one frame for each stamp");
  }
  sensor.stamps_ns.insert(at, frame.stamp_ns);
  if (is_endless_) sensor.frames.NoteStamp(frame.stamp_ns);
  if (num_waiting_ == waiting_.size()) waiting_.emplace_back();
  waiting_[num_waiting_].stamp_ns = stamp_ns;
  LoadedFrame& loaded = waiting_[num_waiting_].frame;
  loaded.file.path = frame.name;
  loaded.file.stamp_ns = frame.stamp_ns;
  sensor.frames.Load(std::move(frame.cloud), &loaded);
  loaded.info.sensor = frame.sensor;
  AddCounts(loaded.counts, counts_);
  ++counts_.frames;
  if (!std::exchange(has_begun_, true)) {
    newest_ns_ = stamp_ns;
    on_event_(EngineState::kWarmingUp);
  }
  newest_ns_ = std::max(newest_ns_, stamp_ns);
  sensor.newest_ns = std::max(sensor.newest_ns, stamp_ns);
  TellSensors(frame.sensor);
  ++num_waiting_;
  std::push_heap(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(num_waiting_),
                 ComesLater<Waiting>);
  if (!is_endless_) Release(SettledNs());
}

void LiveEngine::Advance(TimeNs now_ns) {
  if (!has_begun_ || now_ns <= newest_ns_) return;
  newest_ns_ = now_ns;
  TellSensors(std::nullopt);
  if (is_endless_) return;
  Release(SettledNs());
  tracker_->Advance(SettledNs(), newest_ns_);
}

void LiveEngine::Close() {
  if (!has_begun_) return;
  if (is_endless_) {
    TrackAll();
    return;
  }
  Release(std::numeric_limits<TimeNs>::max());
  tracker_->Close(newest_ns_);
}

// A sensor whose clock has gone back, or was far ahead before, would be heard again only when it
// has caught up. Where what all that are not silent tell is older than anything that is remembered,
// it is a new beginning. A sensor that alone is so far behind the others is only late.
bool LiveEngine::HasClockGoneBack(Sensor* sensor, TimeNs stamp_ns) const {
  const double window_s = config_.live.window_s;
  const bool is_past = std::isfinite(window_s) && newest_ns_ - stamp_ns > NsOf(window_s);
  sensor->frames_of_past = is_past ? sensor->frames_of_past + 1 : 0;
  const auto is_past_or_silent = [&](const Sensor& other) {
    return other.frames_of_past >= kFramesOfPast ||
           (&other != sensor && other.state == SensorState::kSilent);
  };
  return std::all_of(sensors_.begin(), sensors_.end(), is_past_or_silent);
}

// Whether nothing that is remembered is young enough for a frame of this stamp: there was none for
// so long, or the clock has jumped. What stands and grows there would be new, and seem to fly.
bool LiveEngine::HasForgottenAll(TimeNs stamp_ns) const {
  const double window_s = config_.live.window_s;
  if (is_endless_ || !has_begun_ || !std::isfinite(window_s)) return false;
  return std::all_of(sensors_.begin(), sensors_.end(), [&](const Sensor& sensor) {
    return stamp_ns - sensor.newest_ns > NsOf(window_s);
  });
}

// Nothing of what was is related to what comes.
void LiveEngine::BeginAnew() {
  Close();
  auto tracker = std::make_unique<LiveTracker>(config_, output_times_, on_event_);
  tracker->NumberFrom(tracker_->next_id());
  tracker_ = std::move(tracker);
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    Sensor anew(FramesOf(i, sensors_[i].frames.info().name));
    anew.sight = std::move(sensors_[i].sight);  // which no clock changes
    sensors_[i] = std::move(anew);
  }
  has_begun_ = false;
}

// No earlier frame will come.
TimeNs LiveEngine::SettledNs() const { return newest_ns_ - NsOf(config_.live.reorder_s); }

// `heard`: the sensor of the frame that has just come.
void LiveEngine::TellSensors(std::optional<std::uint32_t> heard) {
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    Sensor& sensor = sensors_[i];
    const bool is_silent =
        i != heard && (sensor.state == SensorState::kSilent ||
                       newest_ns_ - sensor.newest_ns > NsOf(config_.live.silent_s));
    const bool is_blinded = !is_endless_ && sensor.sight.is_blinded();
    const SensorState state = is_silent    ? SensorState::kSilent
                              : is_blinded ? SensorState::kBlinded
                                           : SensorState::kOk;
    if (std::exchange(sensor.state, state) != state) on_event_(SensorChanged{i, state});
  }
}

// What a frame tells of the sight of its sensor.
void LiveEngine::LookAt(const LoadedFrame& frame) {
  Sensor& sensor = sensors_[frame.info.sensor];
  const Eigen::Vector3f* const begin_m = frame.points_m.data();
  sensor.sight.AddFrame(frame.info.begin_ns, begin_m, begin_m + frame.points_m.size(),
                        sensor.frames.info().origin_m);
}

// Hands on the frames up to a stamp in order: none of an earlier stamp will come. Rows depend on
// what was handed on alone, so that they are the same in whatever order the frames came.
void LiveEngine::Release(TimeNs until_ns) {
  while (num_waiting_ > 0 && waiting_.front().stamp_ns <= until_ns) {
    std::pop_heap(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(num_waiting_),
                  ComesLater<Waiting>);
    --num_waiting_;
    HandOn(until_ns, &waiting_[num_waiting_].frame);
  }
}

void LiveEngine::HandOn(TimeNs until_ns, LoadedFrame* frame) {
  const std::uint32_t index = frame->info.sensor;
  Sensor& sensor = sensors_[index];
  const TimeNs offset_ns = sensor.frames.offset_ns();
  const auto may_come_twice = [&](TimeNs stamp_ns) { return stamp_ns + offset_ns >= until_ns; };
  std::vector<TimeNs>& stamps_ns = sensor.stamps_ns;
  stamps_ns.erase(stamps_ns.begin(),
                  std::find_if(stamps_ns.begin(), stamps_ns.end(), may_come_twice));
  sensor.frames.NoteStamp(frame->file.stamp_ns);
  const TimeNs now_ns = frame->file.stamp_ns + offset_ns + NsOf(config_.live.reorder_s);
  try {
    sensor.frames.Finish(*frame);
  } catch (const InputError&) {
    if (!config_.input.skip_bad_frames) throw;
    ++counts_.bad_frames;
    return;
  }
  const SensorInfo& info = sensor.frames.info();
  if (info.frame_period_ns != std::exchange(sensor.told_period_ns, info.frame_period_ns)) {
    tracker_->SetSensor(index, info);
  }
  LookAt(*frame);
  tracker_->SetBlinded(std::any_of(sensors_.begin(), sensors_.end(),
                                   [](const Sensor& other) { return other.sight.is_doubtful(); }));
  const bool was_warm = tracker_->is_warm();
  tracker_->Take(frame);
  if (!was_warm && tracker_->is_warm()) on_event_(EngineState::kRunning);
  tracker_->GiveRows(now_ns);
}

// With an endless delay no row is due before the end, and then all that there is to know is known:
// the frames are a recording.
void LiveEngine::TrackAll() {
  Recording recording;
  for (const Sensor& sensor : sensors_) recording.sensors.push_back(sensor.frames.info());
  std::vector<LoadedFrame> frames;
  waiting_.resize(num_waiting_);
  std::sort(waiting_.begin(), waiting_.end(),
            [](const Waiting& a, const Waiting& b) { return a.ComesBefore(b); });
  for (Waiting& waiting : waiting_) {
    LoadedFrame& loaded = waiting.frame;
    try {
      sensors_[loaded.info.sensor].frames.Finish(loaded);
      LookAt(loaded);
      frames.push_back(std::move(loaded));
    } catch (const InputError&) {
      if (!config_.input.skip_bad_frames) throw;
      ++counts_.bad_frames;
    }
  }
  waiting_.clear();
  num_waiting_ = 0;
  Merge(std::move(frames), recording);
  const PipelineResult result = TracksOf(recording, output_times_, config_);
  std::vector<TrajectoryRow> rows;
  for (const FittedTrack& track : result.tracks) {
    on_event_(TrackConfirmed{track.id, track.begin_ns, track.flight.kind});
    const RowStream next = RowsOf(result, track);
    while (const std::optional<TrajectoryRow> row = next()) rows.push_back(*row);
  }
  std::stable_sort(rows.begin(), rows.end(), [](const TrajectoryRow& a, const TrajectoryRow& b) {
    return std::make_pair(a.time_ns, a.track_id) < std::make_pair(b.time_ns, b.track_id);
  });
  const auto kind_of = [&](const TrajectoryRow& row) {
    return result.tracks[static_cast<std::size_t>(row.track_id)].flight.kind;
  };
  for (const TrajectoryRow& row : rows) on_event_(RowGiven{row, false, kind_of(row)});
  for (const FittedTrack& track : result.tracks) {
    on_event_(TrackEnded{track.id, track.end_ns, track.flight.kind});
  }
}

}  // namespace unlidar
