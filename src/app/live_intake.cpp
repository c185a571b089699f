#include "app/live_intake.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>
#include <variant>

#include "api/recording_events.hpp"
#include "io/frames.hpp"

namespace unlidar {
namespace {

// Two thirds of the time after which readers consider an engine stopped.
constexpr TimeNs kStateIntervalNs = 40'000'000'000;

std::vector<std::string> NamesOf(const std::vector<FrameSource>& sources) {
  std::vector<std::string> names;
  names.reserve(sources.size());
  for (const FrameSource& source : sources) names.push_back(SourceName(source));
  return names;
}

}  // namespace

void LiveEventReporter::Take(const EngineEvent& event, const LiveProgress& now) {
  if (const auto* confirmed = std::get_if<TrackConfirmed>(&event)) {
    output_.Confirm(*confirmed);
  } else if (const auto* given = std::get_if<RowGiven>(&event)) {
    const std::uint64_t unwritable = output_.counts().unwritable_rows;
    output_.AddRow(now.newest_ns, *given);
    NoteCount(unwritable, output_.counts().unwritable_rows, "row", kUnwritableText);
  } else if (const auto* predicted = std::get_if<TrackPredicted>(&event)) {
    output_.AddPrediction(now.newest_ns, *predicted);
  } else if (const auto* ended = std::get_if<TrackEnded>(&event)) {
    output_.End(now.newest_ns, *ended);
  } else if (const auto* changed = std::get_if<SensorChanged>(&event)) {
    ReportSensor(changed->sensor, changed->state, now.newest_ns);
  } else {
    OnEngineState(std::get<EngineState>(event), now);
  }
}

void LiveEventReporter::OnEngineState(EngineState state, const LiveProgress& now) {
  const bool is_beginning = state == EngineState::kWarmingUp;
  state_ = is_beginning ? LiveState::kWarmingUp : LiveState::kRunning;
  if (is_beginning && std::exchange(has_begun_, true)) {
    Note("begins anew at " + SecondsText(now.newest_ns) +
         ": the clock has gone back, or no frame came for longer than live.window_s");
  }
  state_reported_ns_ = now.newest_ns;  // even if hidden by overload: the clock may have jumped back
  if (!is_overloaded()) ReportState(now);
}

void LiveEventReporter::ReportSensor(std::size_t index, SensorState state, TimeNs newest_ns) {
  Sensor& sensor = sensors_[index];
  if (sensor.state == state) return;
  sensor.state = state;
  output_.ReportSensor(newest_ns, sensor.name, state, sensor.clock);
  if (state != SensorState::kBlinded) return;
  NoteIncident(
      sensor.name + ": blinded: it does not see what it should (fog, snow, a covered window?)",
      &sensor.num_blinded);
}

void LiveEventReporter::ReportReturns(std::size_t sensor, TimeNs stamp_ns,
                                      const std::vector<Eigen::Vector3f>& points_m,
                                      std::size_t max_returns, TimeNs newest_ns) {
  if (!sensors_[sensor].view.IsDue(stamp_ns)) return;
  output_.ReportReturns(newest_ns, sensors_[sensor].name, stamp_ns,
                        TextOfReturns(points_m, ThinnedReturns(points_m, max_returns)));
}

void LiveEventReporter::ReportClock(std::size_t index, SyncState clock, TimeNs newest_ns) {
  Sensor& sensor = sensors_[index];
  if (std::exchange(sensor.clock, clock) == clock) return;
  if (sensor.state) output_.ReportSensor(newest_ns, sensor.name, *sensor.state, clock);
  if (clock != SyncState::kLost) return;
  NoteIncident(sensor.name +
                   ": has lost its time synchronisation (PTP, GPS), its frames go on by the clock "
                   "of this computer",
               &sensor.num_lost);
}

void LiveEventReporter::ReportPace(std::uint64_t one_in, std::uint64_t left_out,
                                   const LiveProgress& now) {
  const bool was_overloaded = is_overloaded();
  if (std::exchange(one_in_, one_in) == one_in) return;
  Note(is_overloaded() ? "overloaded: one frame in " + std::to_string(one_in) + " is worked off"
                       : "no more overloaded, left out: " + Count(left_out, "frame"));
  if (was_overloaded != is_overloaded()) ReportState(now);
}

// Reported only once, because for readers a warm-up ends all earlier tracks.
void LiveEventReporter::SendHeartbeat(const LiveProgress& now) {
  if (state_ == LiveState::kRunning && now.newest_ns - state_reported_ns_ >= kStateIntervalNs) {
    ReportState(now);
  }
}

void LiveEventReporter::ReportState(const LiveProgress& now) {
  state_reported_ns_ = now.newest_ns;
  output_.ReportState(now.newest_ns, state(), now.frames, now.lost_frames);
  service_.ReportStatus(LiveStateName(state()));
}

LiveIntake::LiveIntake(const Arguments& arguments, const OutputTimes& output_times,
                       const Config& config, LiveEventReporter& reporter, LiveTraceSink trace)
    : config_(config),
      reporter_(reporter),
      engine_(
          config, NamesOf(arguments.sources), output_times,
          [this](const EngineEvent& event) { reporter_.Take(event, Progress()); }, EmitTracksOf,
          arguments.livox.empty() ? std::nullopt : std::make_optional(TimeReading::kOffset),
          !arguments.livox.empty(), std::move(trace), FrameCallbackOf(arguments.event_returns)),
      skips_bad_frames_(config.input.skip_bad_frames || !arguments.livox.empty()),
      why_skipped_(arguments.livox.empty() ? " (input.skip_bad_frames)" : ""),
      pace_(std::chrono::nanoseconds(NsOf(config.live.overload_s))) {
  for (const FrameSource& source : arguments.sources) {
    AppendSensor(SourceName(source), source.directory);
  }
}

FrameCallback LiveIntake::FrameCallbackOf(int max_returns) {
  if (max_returns == 0) return nullptr;
  return [this, max_returns](std::uint32_t sensor, TimeNs stamp_ns,
                             const std::vector<Eigen::Vector3f>& points_m) {
    reporter_.ReportReturns(sensor, stamp_ns, points_m, static_cast<std::size_t>(max_returns),
                            engine_.newest_ns());
  };
}

void LiveIntake::AppendSensor(const std::string& name, const std::string& directory) {
  sensors_.emplace_back();
  LiveInput& input = summary_.inputs.emplace_back();
  input.name = Shortened(name, kMaxSensorNameBytes);  // a folder's may be anything
  input.directory = directory;
  reporter_.AddSensor(input.name);
}

std::optional<std::uint32_t> LiveIntake::SensorNamed(const std::string& name) const {
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    if (NameOf(i) == name) return i;
  }
  return std::nullopt;
}

std::uint32_t LiveIntake::AddSensor(const std::string& name, const std::string& first) {
  if (!config_.sensors.empty() && config_.sensors.count(name) == 0) {
    reporter_.Note(first + ": the config has no sensors." + name + ", it stands at the origin");
  }
  const std::uint32_t sensor = engine_.AddSensor(name);
  AppendSensor(name, "");
  return sensor;
}

void LiveIntake::ReplaceSensor(std::uint32_t sensor, const std::string& name) {
  reporter_.Note(name + " takes the place of " + NameOf(sensor) + ", which is silent");
  engine_.ReplaceSensor(sensor, name);
  sensors_[sensor] = Sensor();
  summary_.inputs[sensor] = LiveInput();
  summary_.inputs[sensor].name = name;
  reporter_.ReplaceSensor(sensor, name);
}

bool LiveIntake::IsInTime(std::uint32_t sensor, TimeNs stamp_ns,
                          std::optional<Clock::duration> waited,
                          const std::optional<Arrival>& arrival) {
  const Clock::time_point now = Clock::now();
  sensors_[sensor].arrived = now;
  if (std::exchange(sensors_[sensor].is_silent_by_clock, false)) {
    const bool is_blinded = engine_.StateOf(sensor) == SensorState::kBlinded;
    reporter_.ReportSensor(sensor, is_blinded ? SensorState::kBlinded : SensorState::kOk,
                           engine_.newest_ns());
  }
  const bool is_kept = pace_.Keeps(sensor, waited, now);
  reporter_.ReportPace(pace_.one_in(), summary_.overload_frames, Progress());
  if (is_kept) return true;
  ++summary_.overload_frames;
  engine_.NoteSkipped(sensor, stamp_ns, arrival);
  return false;
}

void LiveIntake::Add(CloudFrame frame) {
  const std::uint32_t sensor = frame.sensor;
  const std::string_view name = frame.name;
  const std::uint64_t late_before = engine_.late_frames();
  const std::uint64_t astray_before = engine_.astray_frames().count;
  const std::uint64_t overflow_before = engine_.overflow_frames().count;
  const double begin_s = ThreadCpuSeconds();
  try {
    engine_.Add(std::move(frame));
    ++summary_.inputs[sensor].frames;
  } catch (const UnitError&) {
    throw;  // the next would be no better
  } catch (const InputError& error) {
    TakeBadFrame(error);
  }
  if (engine_.warnings().size() > num_engine_warnings_) {
    num_engine_warnings_ = engine_.warnings().size();
    Warn(engine_.warnings());
  }
  summary_.processing_times.Add(ThreadCpuSeconds() - begin_s);
  if (!reporter_.StateOf(sensor) && engine_.has_begun() && !engine_.IsOutOfSync(sensor)) {
    reporter_.ReportSensor(sensor, SensorState::kOk, engine_.newest_ns());
  }
  CheckOutOfSync();
  NoteLeftOut(late_before, astray_before, overflow_before, name);
  reporter_.SendHeartbeat(Progress());
  reporter_.Flush();
}

void LiveIntake::NoteLeftOut(std::uint64_t late_before, std::uint64_t astray_before,
                             std::uint64_t overflow_before, std::string_view name) {
  reporter_.NoteCount(late_before, engine_.late_frames(), "frame",
                      " later than live.reorder_s and dropped, the last: " + std::string(name));
  const DroppedFrames& overflow = engine_.overflow_frames();
  reporter_.NoteCount(overflow_before, overflow.count, "frame",
                      std::string(kOverflowText) + ", the last of " + NameOf(overflow.sensor));
  const DroppedFrames& astray = engine_.astray_frames();
  if (astray.count == astray_before) return;
  std::string note = " astray and left out";
  if (astray.ahead_ns != 0) {
    const std::string seconds = SecondsText(std::abs(astray.ahead_ns));
    note += ": the clock of " + NameOf(astray.sensor) + " is " +
            seconds.substr(0, seconds.find('.')) + " s " +
            (astray.ahead_ns < 0 ? "behind" : "ahead of") + " that of the others";
  }
  reporter_.NoteCount(astray_before, astray.count, "frame", note);
}

void LiveIntake::TakeBadFrame(const InputError& error) {
  if (!skips_bad_frames_) throw InputError(error);
  const std::uint64_t before = summary_.counts.bad_frames++;
  reporter_.NoteCount(
      before, before + 1, "frame",
      std::string(" bad and skipped") + why_skipped_ + ", the last: " + error.what());
}

void LiveIntake::TakeFollowed(const FollowedCounts& counts) {
  const FollowedCounts before = std::exchange(summary_.followed, counts);
  const auto say = [&](std::uint64_t FollowedCounts::*count, const char* what) {
    reporter_.NoteCount(before.*count, counts.*count, "frame", what);
  };
  say(&FollowedCounts::vanished, kVanishedText);
  say(&FollowedCounts::passed_over, kPassedOverText);
  say(&FollowedCounts::already_processed, kAlreadyProcessedText);
}

void LiveIntake::CheckSilence() {
  const Clock::time_point now = Clock::now();
  const auto is_quiet = [&](const Sensor& sensor) {
    return now - sensor.arrived > std::chrono::nanoseconds(NsOf(config_.live.silent_s));
  };
  if (!std::all_of(sensors_.begin(), sensors_.end(), is_quiet)) return;
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    sensors_[i].is_silent_by_clock = true;
    reporter_.ReportSensor(i, SensorState::kSilent, engine_.newest_ns());
  }
}

// The engine reports accepted frames only: a sensor whose frames are all set aside is silent, too.
void LiveIntake::CheckOutOfSync() {
  if (!engine_.has_begun()) return;
  const TimeNs now_ns = engine_.newest_ns();
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    std::optional<TimeNs>& since_ns = sensors_[i].out_of_sync_since_ns;
    if (!engine_.IsOutOfSync(i) || engine_.StateOf(i) != SensorState::kSilent) {
      since_ns.reset();
      continue;
    }
    since_ns = std::min(since_ns.value_or(now_ns), now_ns);
    if (now_ns - *since_ns > NsOf(config_.live.silent_s)) {
      reporter_.ReportSensor(i, SensorState::kSilent, now_ns);
    }
  }
}

void LiveIntake::Warn(const std::vector<Warning>& warnings) {
  for (const Warning& warning : warnings) {
    std::vector<Warning>& all = summary_.warnings;
    if (std::find(all.begin(), all.end(), warning) != all.end()) continue;
    all.push_back(warning);
    reporter_.Note("warning: " + warning.text);
  }
}

void LiveIntake::Close() {
  engine_.Close();
  Warn(engine_.warnings());
  reporter_.ReportState(Progress());
}

LiveProgress LiveIntake::Progress() const {
  const InputCounts& counts = engine_.counts();
  return {engine_.newest_ns(), counts.frames,
          summary_.counts.bad_frames + counts.bad_frames + engine_.late_frames() +
              engine_.astray_frames().count + engine_.overflow_frames().count +
              summary_.overload_frames + summary_.followed.vanished +
              summary_.followed.passed_over};
}

LiveSummary LiveIntake::Summary() const {
  LiveSummary summary = summary_;
  for (std::uint32_t i = 0; i < sensors_.size(); ++i) {
    LiveInput& input = summary.inputs[i];
    input.state = reporter_.StateOf(i);
    input.blinded_s = engine_.BlindedS(i);
    input.sway_deg = engine_.SwayDeg(i);
  }
  summary.counts = engine_.counts();
  summary.counts.bad_frames += summary_.counts.bad_frames;
  summary.late_frames = engine_.late_frames();
  summary.astray_frames = engine_.astray_frames().count;
  summary.overflow_frames = engine_.overflow_frames().count;
  return summary;
}

}  // namespace unlidar
