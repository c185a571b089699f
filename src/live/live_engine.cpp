#include "live/live_engine.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "io/frame_directory.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

void CheckLive(const Config& config) {
  if (config.method == Method::kRobust || std::isinf(config.live.delay_s)) return;
  throw ConfigError(
      "method: 'paper', expected robust for frames that come one by one: the paper's score needs "
      "the whole recording (live.delay_s: .inf)");
}

LiveEngine::LiveEngine(const Config& config, const std::vector<std::string>& sensors,
                       OutputTimes output_times, EngineCallback on_event,
                       RecordingTracker track_recording, std::optional<TimeReading> reading,
                       bool are_metres, LiveTraceSink trace, FrameCallback on_frame)
    : config_(config),
      output_times_(std::move(output_times)),
      on_event_(std::move(on_event)),
      track_recording_(std::move(track_recording)),
      reading_(reading),
      are_metres_(are_metres),
      is_endless_(std::isinf(config_.live.delay_s)),
      trace_(std::move(trace)),
      on_frame_(std::move(on_frame)),
      tracker_(std::make_unique<LiveTracker>(config_, output_times_, on_event_, trace_)),
      stamps_(config_.live) {
  for (const std::string& name : sensors) AddSensor(name);
}

std::uint32_t LiveEngine::AddSensor(const std::string& name) {
  const auto index = static_cast<std::uint32_t>(sensors_.size());
  sensors_.push_back({FramesOf(index, name)});
  stamps_.AddSensor();
  return index;
}

void LiveEngine::ReplaceSensor(std::uint32_t sensor, const std::string& name) {
  DropAstray([&](std::uint32_t held, TimeNs) { return held == sensor; });
  sensors_[sensor] = {FramesOf(sensor, name)};
  stamps_.Replace(sensor);
  sway_.Forget(sensor);
  warned_of_.erase(warned_of_.lower_bound({sensor, ""}), warned_of_.lower_bound({sensor + 1, ""}));
}

void LiveEngine::Add(CloudFrame frame) {
  const Sensor& sensor = sensors_.at(frame.sensor);
  sensor.frames.CheckStamp(frame.name, frame.stamp_ns);
  const TimeNs stamp_ns = frame.stamp_ns + sensor.frames.offset_ns();
  if (CameBefore(sensor, frame, stamp_ns)) {
    throw InputError(std::string(frame.name) + ": has the stamp " + std::to_string(frame.stamp_ns) +
                     " ns of an earlier frame, expected one frame for each stamp");
  }
  if (is_endless_) return Take(std::move(frame), stamp_ns);
  using Verdict = StampValidator::Verdict;
  const std::uint32_t index = frame.sensor;
  const Verdict verdict = stamps_.Judge({index, stamp_ns, frame.arrival});
  if (verdict == Verdict::kTaken && held_.empty()) return Take(std::move(frame), stamp_ns);
  if (verdict == Verdict::kLate) {
    ++late_frames_;
  } else {
    held_.Add(std::move(frame), stamp_ns);
  }
  Settle(verdict);
}

void LiveEngine::NoteSkipped(std::uint32_t sensor, TimeNs stamp_ns,
                             const std::optional<Arrival>& arrival) {
  const TimeNs time_ns = stamp_ns + sensors_.at(sensor).frames.offset_ns();
  if (is_endless_ || std::abs(time_ns) > kMaxStampNs) return;
  Settle(stamps_.Judge({sensor, time_ns, arrival}));
}

// Applies the verdict on a frame to the held frames, too: passes them on in order of their stamps,
// so that none follows a newer one.
void LiveEngine::Settle(StampValidator::Verdict verdict) {
  if (verdict == StampValidator::Verdict::kRestart) Restart();
  const auto is_due = [this](std::uint32_t sensor, TimeNs time_ns) {
    return stamps_.IsConfirmed(sensor, time_ns);
  };
  while (held_.TakeEarliest(is_due, &taken_)) Take(std::move(taken_.frame), taken_.time_ns);
  DropAstray(
      [this](std::uint32_t sensor, TimeNs time_ns) { return !stamps_.IsPending(sensor, time_ns); });
}

bool LiveEngine::CameBefore(const Sensor& sensor, const CloudFrame& frame, TimeNs stamp_ns) const {
  if (!is_endless_ && has_begun() && stamp_ns < SettledNs()) return false;  // late anyway
  return std::binary_search(sensor.stamps_ns.begin(), sensor.stamps_ns.end(), frame.stamp_ns) ||
         held_.Has(frame.sensor, stamp_ns);
}

void LiveEngine::DropAstray(const HeldFrames::Condition& should_drop) {
  while (held_.TakeOverflow(should_drop, &taken_)) {
    ++astray_.count;
    astray_.sensor = taken_.frame.sensor;
    astray_.ahead_ns = has_begun() ? taken_.time_ns - newest_ns() : 0;
  }
}

void LiveEngine::Take(CloudFrame frame, TimeNs stamp_ns) {
  if (IsBeyondWindow(stamp_ns)) Restart();
  Sensor& sensor = sensors_[frame.sensor];
  std::vector<TimeNs>& stamps_ns = sensor.stamps_ns;
  stamps_ns.insert(std::lower_bound(stamps_ns.begin(), stamps_ns.end(), frame.stamp_ns),
                   frame.stamp_ns);
  if (is_endless_) sensor.frames.NoteStamp(frame.stamp_ns);
  LoadedFrame& loaded = waiting_.Next();
  loaded.file.path = frame.name;
  loaded.file.stamp_ns = frame.stamp_ns;
  sensor.frames.Load(std::move(frame.cloud), &loaded);
  sensor.was_heard = true;
  if (!is_endless_ && sensor.frames.CanTellUnits()) CheckUnits(frame.sensor);
  loaded.info.sensor = frame.sensor;
  AddCounts(loaded.counts, counts_);
  ++counts_.frames;
  const bool is_first = !has_begun();
  stamps_.Take(stamp_ns);
  if (is_first) on_event_(EngineState::kWarmingUp);
  sensor.newest_ns = std::max(sensor.newest_ns, stamp_ns);
  ReportSensorStates(frame.sensor);
  if (on_frame_) on_frame_(frame.sensor, stamp_ns, loaded.points_m);
  waiting_.Add(stamp_ns);
  if (is_endless_) return;
  Release(SettledNs());
  while (const std::optional<LoadedFrame> dropped = waiting_.TakeOverflow()) {
    overflow_.sensor = dropped->info.sensor;
    ++overflow_.count;
    --counts_.frames;
    std::vector<TimeNs>& known_ns = sensors_[overflow_.sensor].stamps_ns;
    known_ns.erase(std::lower_bound(known_ns.begin(), known_ns.end(), dropped->file.stamp_ns));
  }
  if (stamp_ns == newest_ns()) tracker_->Predict(stamp_ns);
}

void LiveEngine::CheckUnits(std::uint32_t index) {
  const SensorFrames& frames = sensors_[index].frames;
  const auto why = frames.UnitProblem();
  if (!why || are_metres_) return Warn(index, frames.RangeWarnings(are_metres_));
  sensors_[index].is_not_metres = true;
  const auto is_right = [](const Sensor& sensor) {
    return sensor.was_heard && !sensor.is_not_metres;
  };
  if (std::none_of(sensors_.begin(), sensors_.end(), is_right)) throw UnitError(*why);
  Warn(index, {{"not_metres", *why}});
}

void LiveEngine::Advance(TimeNs now_ns) {
  if (!has_begun() || now_ns <= newest_ns()) return;
  stamps_.Take(std::min(now_ns, kMaxStampNs));
  ReportSensorStates(std::nullopt);
  if (is_endless_) return;
  Release(SettledNs());
  tracker_->Advance(SettledNs(), newest_ns());
}

void LiveEngine::Close() {
  DropAstray([](std::uint32_t, TimeNs) { return true; });
  EndTracks();
}

void LiveEngine::EndTracks() {
  if (!has_begun()) return;
  if (is_endless_) return TrackAsRecording();
  Release(std::numeric_limits<TimeNs>::max());
  tracker_->Close(newest_ns());
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    Sensor& sensor = sensors_[i];
    sensor.pose.Finish();
    std::vector<Warning> warnings = sensor.pose.WarningsOf(sensor.frames.info().name);
    sensor.frames.AppendWarnings(are_metres_, &warnings);
    Warn(i, std::move(warnings));
  }
}

// True if all frames are older than live.window_s at this stamp, after a long pause or a jump of
// the clock. All structure would be new and could pass for drones.
bool LiveEngine::IsBeyondWindow(TimeNs stamp_ns) const {
  const double window_s = config_.live.window_s;
  if (is_endless_ || !has_begun() || !std::isfinite(window_s)) return false;
  return std::all_of(sensors_.begin(), sensors_.end(), [&](const Sensor& sensor) {
    return stamp_ns - sensor.newest_ns > NsOf(window_s);
  });
}

// Starts a new stream: the frames so far are unrelated to those that follow.
void LiveEngine::Restart() {
  EndTracks();
  auto tracker = std::make_unique<LiveTracker>(config_, output_times_, on_event_, trace_);
  tracker->ContinueNumbers(*tracker_);
  tracker_ = std::move(tracker);
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    Sensor fresh{FramesOf(i, sensors_[i].frames.info().name)};
    // Independent of clocks:
    fresh.sensor_health = std::move(sensors_[i].sensor_health);
    fresh.pose = std::move(sensors_[i].pose);
    fresh.was_heard = sensors_[i].was_heard;
    fresh.is_not_metres = sensors_[i].is_not_metres;
    sensors_[i] = std::move(fresh);
  }
  stamps_.Begin();
}

// `heard`: the sensor of the frame just taken.
void LiveEngine::ReportSensorStates(std::optional<std::uint32_t> heard) {
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    Sensor& sensor = sensors_[i];
    const bool is_silent =
        i != heard && (sensor.state == SensorState::kSilent ||
                       newest_ns() - sensor.newest_ns > NsOf(config_.live.silent_s));
    const bool is_blinded = !is_endless_ && sensor.sensor_health.is_blinded();
    const SensorState state = is_silent    ? SensorState::kSilent
                              : is_blinded ? SensorState::kBlinded
                                           : SensorState::kOk;
    if (std::exchange(sensor.state, state) != state) on_event_(SensorChanged{i, state});
  }
}

void LiveEngine::RemoveSway(LoadedFrame* frame) {
  const SwayingFrame swaying{&frame->info, frame->points_m.data(), frame->points_m.size(),
                             [frame](std::size_t i) { return frame->times_ns[i]; }};
  const SensorInfo& info = sensors_[frame->info.sensor].frames.info();
  sway_.Correct(sway_.Observe(info, swaying), swaying);
  const auto warning = sway_.WarningOf(frame->info.sensor, info.name);
  if (warning) Warn(frame->info.sensor, {*warning});
}

void LiveEngine::UpdateSensorHealth(const LoadedFrame& frame) {
  Sensor& sensor = sensors_[frame.info.sensor];
  const SensorInfo& info = sensor.frames.info();
  sensor.sensor_health.AddFrame(info, frame.info.begin_ns, frame.points_m);
  if (is_endless_) return;  // the recording is checked at the end
  sensor.pose.AddFrame(info, frame.info.begin_ns, frame.points_m);
  Warn(frame.info.sensor, sensor.pose.WarningsOf(info.name));
}

// Keeps the first warning of each code and sensor, also across restarts.
void LiveEngine::Warn(std::uint32_t sensor, std::vector<Warning> warnings) {
  for (Warning& warning : warnings) {
    if (warned_of_.emplace(sensor, warning.code).second) warnings_.push_back(std::move(warning));
  }
}

// Passes the frames up to a stamp to the tracker in order of stamps: no earlier frame will follow.
// Rows depend only on frames passed on, and so not on the order of arrival.
void LiveEngine::Release(TimeNs until_ns) {
  while (!waiting_.empty() && waiting_.earliest_ns() <= until_ns) {
    PassToTracker(until_ns, waiting_.TakeEarliest());
  }
}

// False for a frame that is left out and counted: a bad one, or one without a pose.
bool LiveEngine::Finish(LoadedFrame* frame) {
  try {
    if (sensors_[frame->info.sensor].frames.Finish(*frame)) return true;
    ++counts_.unplaced_frames;
  } catch (const InputError&) {
    if (!config_.input.skip_bad_frames) throw;
    ++counts_.bad_frames;
  }
  return false;
}

void LiveEngine::PassToTracker(TimeNs until_ns, LoadedFrame* frame) {
  const std::uint32_t index = frame->info.sensor;
  Sensor& sensor = sensors_[index];
  const TimeNs offset_ns = sensor.frames.offset_ns();
  const auto may_come_twice = [&](TimeNs stamp_ns) { return stamp_ns + offset_ns >= until_ns; };
  std::vector<TimeNs>& stamps_ns = sensor.stamps_ns;
  stamps_ns.erase(stamps_ns.begin(),
                  std::find_if(stamps_ns.begin(), stamps_ns.end(), may_come_twice));
  sensor.frames.NoteStamp(frame->file.stamp_ns);
  const TimeNs now_ns = frame->file.stamp_ns + offset_ns + NsOf(config_.live.reorder_s);
  if (!Finish(frame)) {
    if (const auto warning = sensor.frames.PoseWarning()) Warn(index, {*warning});
    return;
  }
  const SensorInfo& info = sensor.frames.info();
  if (info.frame_period_ns != std::exchange(sensor.reported_period_ns, info.frame_period_ns)) {
    tracker_->SetSensor(index, info);
  }
  if (config_.robust.Uses(Rule::kSway)) RemoveSway(frame);
  UpdateSensorHealth(*frame);
  tracker_->SetBlinded(std::any_of(sensors_.begin(), sensors_.end(), [](const Sensor& other) {
    return other.sensor_health.may_be_blinded();
  }));
  const bool was_warm = tracker_->is_warm();
  tracker_->Take(frame);
  if (!was_warm && tracker_->is_warm()) on_event_(EngineState::kRunning);
  tracker_->EmitRows(now_ns);
}

// With an endless delay no row is due before the end, so the frames are tracked as a recording.
void LiveEngine::TrackAsRecording() {
  Recording recording;
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    if (!are_metres_) sensors_[i].frames.CheckUnits();  // whatever the others are
  }
  std::vector<LoadedFrame> frames;
  for (LoadedFrame& loaded : waiting_.TakeAll()) {
    if (!Finish(&loaded)) continue;
    UpdateSensorHealth(loaded);
    frames.push_back(std::move(loaded));
  }
  for (const Sensor& sensor : sensors_) {
    sensor.frames.AppendWarnings(are_metres_, &recording.warnings);
    recording.sensors.push_back(sensor.frames.info());
  }
  Merge(std::move(frames), recording);
  const std::vector<Warning> warnings =
      track_recording_(recording, output_times_, config_, on_event_);
  warnings_.insert(warnings_.end(), warnings.begin(), warnings.end());
}

}  // namespace unlidar
