#include "unlidar/engine.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>
#include <optional>
#include <utility>
#include <variant>

#include "api/recording_events.hpp"
#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "io/stamp.hpp"
#include "live/live_engine.hpp"
#include "recording/pipeline.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Output times as the stages expect them.
OutputTimes Checked(const OutputTimes& times) {
  const auto* const rate = std::get_if<Rate>(&times);
  if (rate != nullptr && !IsRate(*rate)) {
    throw UsageError("rate: " + std::to_string(rate->nanohertz) +
                     " nHz, expected above 0 to 1e15 (1 MHz)");
  }
  const auto* const list = std::get_if<std::vector<TimeNs>>(&times);
  return list != nullptr ? SortedUnique(*list) : times;
}

}  // namespace

std::vector<Warning> EmitTracksOf(const Recording& recording, const OutputTimes& output_times,
                                  const Config& config, const EngineCallback& on_event) {
  const PipelineResult result = TracksOf(recording, output_times, config);
  std::vector<TrajectoryRow> rows;
  for (const FittedTrack& track : result.tracks) {
    on_event(TrackConfirmed{track.id(), track.begin_ns(), track.flight.kind});
    const RowStream next = RowsOf(result, track);
    while (const std::optional<TrajectoryRow> row = next()) rows.push_back(*row);
  }
  std::stable_sort(rows.begin(), rows.end(), [](const TrajectoryRow& a, const TrajectoryRow& b) {
    return std::make_pair(a.time_ns, a.track_id) < std::make_pair(b.time_ns, b.track_id);
  });
  const auto kind_of = [&](const TrajectoryRow& row) {
    return result.tracks[static_cast<std::size_t>(row.track_id)].flight.kind;
  };
  for (const TrajectoryRow& row : rows) on_event(RowGiven{row, false, kind_of(row)});
  for (const FittedTrack& track : result.tracks) {
    on_event(TrackEnded{track.id(), track.end_ns(), track.flight.kind,
                        track.row_source.trajectory.minimum});
  }
  return result.warnings;
}

Engine::Engine(const Config& config, const std::vector<std::string>& sensors,
               EngineCallback on_event, const OutputTimes& output_times) {
  for (const std::string& name : sensors) sensors_.push_back(Shortened(name));
  CheckConfig(config);
  CheckLive(config);
  live_ = std::make_unique<LiveEngine>(config, sensors, Checked(output_times), std::move(on_event),
                                       EmitTracksOf, TimeReading::kOffset);
}

Engine::~Engine() = default;

std::uint32_t Engine::AddSensor(const std::string& name) {
  sensors_.push_back(Shortened(name));
  return live_->AddSensor(name);
}

void Engine::Add(Frame frame) {
  if (frame.sensor >= sensors_.size()) {
    throw InputError("frame of stamp " + std::to_string(frame.stamp_ns) + " ns: of sensor " +
                     std::to_string(frame.sensor) + ", expected an index below " +
                     std::to_string(sensors_.size()));
  }
  CloudFrame taken;
  taken.sensor = frame.sensor;
  taken.stamp_ns = frame.stamp_ns;
  std::array<char, 24> stamp{};
  const auto end = std::to_chars(stamp.data(), stamp.data() + stamp.size(), frame.stamp_ns).ptr;
  frame_name_ = "frame of ";
  frame_name_ += sensors_[frame.sensor];
  frame_name_ += ", stamp ";
  frame_name_.append(stamp.data(), end);
  frame_name_ += " ns";
  taken.name = frame_name_;
  if (!frame.offsets_ns.empty() && frame.offsets_ns.size() != frame.points_m.size()) {
    throw InputError(frame_name_ + ": " + Count(frame.offsets_ns.size(), "point time") +
                     ", expected none or " + std::to_string(frame.points_m.size()));
  }
  taken.cloud.points_m = std::move(frame.points_m);
  taken.cloud.integer_times = std::move(frame.offsets_ns);
  live_->Add(std::move(taken));
}

void Engine::Advance(TimeNs now_ns) { live_->Advance(now_ns); }

void Engine::Close() { live_->Close(); }

TimeNs Engine::newest_ns() const { return live_->newest_ns(); }

const std::vector<Warning>& Engine::warnings() const { return live_->warnings(); }

const InputCounts& Engine::counts() const { return live_->counts(); }

std::uint64_t Engine::late_frames() const { return live_->late_frames(); }

std::uint64_t Engine::astray_frames() const { return live_->astray_frames().count; }

std::uint64_t Engine::overflow_frames() const { return live_->overflow_frames().count; }

std::vector<Track> TrackRecording(const Config& config, const std::vector<std::string>& sensors,
                                  std::vector<Frame> frames, const OutputTimes& output_times) {
  Config endless = config;
  endless.live.delay_s = std::numeric_limits<double>::infinity();
  std::vector<Track> tracks;
  Engine engine(
      endless, sensors,
      [&](const EngineEvent& event) { std::visit(TrackCollector{tracks}, event); }, output_times);
  for (Frame& frame : frames) engine.Add(std::move(frame));
  engine.Close();
  return tracks;
}

}  // namespace unlidar
