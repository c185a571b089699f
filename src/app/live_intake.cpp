#include "app/live_intake.hpp"

#include <algorithm>
#include <utility>

#include "base/format.hpp"
#include "io/frame_preparation.hpp"

namespace unlidar {
namespace {

FramePace::Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<FramePace::Clock::duration>(
      std::chrono::duration<double>(seconds));
}

std::vector<std::string> NamesOf(const std::vector<FrameSource>& sources) {
  std::vector<std::string> names;
  names.reserve(sources.size());
  for (const FrameSource& source : sources) names.push_back(SourceName(source));
  return names;
}

}  // namespace

LiveIntake::LiveIntake(const LiveRequest& request, const Config& config, LiveTeller& teller)
    : config_(config),
      teller_(teller),
      engine_(
          config, NamesOf(request.sources), request.output_times,
          [this](const EngineEvent& event) { teller_.Take(event, Progress()); },
          request.livox ? std::make_optional(TimeReading::kOffset) : std::nullopt),
      skips_bad_frames_(config.input.skip_bad_frames || request.livox),
      why_skipped_(request.livox ? "" : " (input.skip_bad_frames)"),
      pace_(Seconds(config.live.overload_s)) {
  for (const std::string& name : NamesOf(request.sources)) AppendSensor(name);
}

void LiveIntake::AppendSensor(const std::string& name) {
  sensors_.emplace_back();
  sensors_.back().name = name;
  teller_.AddSensor(name);
}

std::optional<std::size_t> LiveIntake::SensorNamed(const std::string& name) const {
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    if (sensors_[i].name == name) return i;
  }
  return std::nullopt;
}

std::size_t LiveIntake::AddSensor(const std::string& name, const std::string& first) {
  if (!config_.sensors.empty() && config_.sensors.count(name) == 0) {
    teller_.Note(first + ": the config has no sensors." + name + ", it stands at the origin");
  }
  engine_.AddSensor(name);
  AppendSensor(name);
  return sensors_.size() - 1;
}

bool LiveIntake::IsInTime(std::size_t sensor, std::optional<Clock::duration> waited) {
  const Clock::time_point now = Clock::now();
  sensors_[sensor].came = now;
  if (std::exchange(sensors_[sensor].is_silent_by_clock, false)) {
    const bool is_blinded =
        engine_.StateOf(static_cast<std::uint32_t>(sensor)) == SensorState::kBlinded;
    teller_.TellSensor(sensor, is_blinded ? SensorState::kBlinded : SensorState::kOk,
                       engine_.newest_ns());
  }
  const bool is_kept = pace_.Keeps(sensor, waited, now);
  teller_.TellPace(pace_.one_in(), overload_frames_, Progress());
  if (!is_kept) ++overload_frames_;
  return is_kept;
}

void LiveIntake::Add(std::size_t sensor, TimeNs stamp_ns, const std::string& name, PcdCloud cloud) {
  const std::uint64_t late_before = engine_.late_frames();
  const double begin_s = ThreadCpuSeconds();
  try {
    engine_.Add({static_cast<std::uint32_t>(sensor), stamp_ns, name, std::move(cloud)});
    ++sensors_[sensor].frames;
  } catch (const InputError& error) {
    TakeBadFrame(error);
  }
  frame_times_.Add(ThreadCpuSeconds() - begin_s);
  if (!teller_.HasTold(sensor)) teller_.TellSensor(sensor, SensorState::kOk, engine_.newest_ns());
  const std::uint64_t late = engine_.late_frames();
  if (late > late_before && IsWorthANote(late)) {
    teller_.Note(Count(late, "frame") +
                 " later than live.reorder_s and dropped, the last: " + name);
  }
  teller_.Flush();
}

void LiveIntake::TakeBadFrame(const InputError& error) {
  if (!skips_bad_frames_) throw InputError(error);
  if (IsWorthANote(++bad_frames_)) {
    teller_.Note(Count(bad_frames_, "frame") + " bad and skipped" + why_skipped_ +
                 ", the last: " + error.what());
  }
}

void LiveIntake::TakeVanished(std::uint64_t frames) {
  if (std::exchange(vanished_frames_, frames) == frames || !IsWorthANote(frames)) return;
  teller_.Note(Count(frames, "frame") + " removed before it could be read");
}

void LiveIntake::LookForSilence() {
  const Clock::time_point now = Clock::now();
  const auto is_quiet = [&](const Sensor& sensor) {
    return now - sensor.came > Seconds(config_.live.silent_s);
  };
  if (!std::all_of(sensors_.begin(), sensors_.end(), is_quiet)) return;
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    sensors_[i].is_silent_by_clock = true;
    teller_.TellSensor(i, SensorState::kSilent, engine_.newest_ns());
  }
}

void LiveIntake::Close() {
  engine_.Close();
  teller_.TellState(Progress());
}

LiveProgress LiveIntake::Progress() const {
  const InputCounts& counts = engine_.counts();
  return {engine_.newest_ns(), counts.frames,
          bad_frames_ + counts.bad_frames + engine_.late_frames() + overload_frames_ +
              vanished_frames_};
}

LiveSummary LiveIntake::Summary() const {
  LiveSummary summary;
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    summary.inputs.push_back({sensors_[i].name, "", sensors_[i].frames,
                              engine_.BlindedS(static_cast<std::uint32_t>(i)), std::nullopt});
  }
  summary.counts = engine_.counts();
  summary.counts.bad_frames += bad_frames_;
  summary.late_frames = engine_.late_frames();
  summary.overload_frames = overload_frames_;
  summary.vanished_frames = vanished_frames_;
  summary.frame_times = frame_times_;
  return summary;
}

}  // namespace unlidar
