// --metrics of a live run.
#include <string_view>

#include "app/output.hpp"
#include "app/summary.hpp"
#include "app/version.hpp"
#include "base/format.hpp"

namespace unlidar {
namespace {

// The value of a label is escaped as JSON text is.
std::string Label(const char* name, const std::string& value) {
  return std::string(name) + "=" + JsonString(value);
}

// The metrics of a text, in families.
class Metrics {
 public:
  void Begin(std::string_view name, std::string_view type, std::string_view help) {
    name_ = name;
    text_ += "# HELP " + name_ + " " + std::string(help) + "\n# TYPE " + name_ + " " +
             std::string(type) + "\n";
  }

  void Add(const std::string& labels, const std::string& value, std::string_view suffix = "") {
    text_ += name_ + std::string(suffix) + (labels.empty() ? "" : "{" + labels + "}") + " " +
             value + "\n";
  }

  void Add(const std::string& labels, std::uint64_t value, std::string_view suffix = "") {
    Add(labels, std::to_string(value), suffix);
  }

  void AddSeconds(const std::string& labels, double value, std::string_view suffix = "") {
    Add(labels, ShortestText(value), suffix);
  }

  const std::string& text() const { return text_; }

 private:
  std::string name_;
  std::string text_;
};

void AddInput(const LiveStatus& status, Metrics& metrics) {
  const LiveSummary& summary = status.summary;
  metrics.Begin("unlidar_frames_total", "counter", "Frames that were tracked, by sensor.");
  for (const LiveInput& input : summary.inputs) {
    metrics.Add(Label("sensor", input.name), input.frames);
  }
  metrics.Begin("unlidar_returns_total", "counter", "Returns of these frames, of all sensors.");
  metrics.Add("", summary.counts.returns);
  metrics.Begin("unlidar_frames_dropped_total", "counter", "Frames that were not, by reason.");
  metrics.Add(Label("reason", "bad"), summary.counts.bad_frames);
  metrics.Add(Label("reason", "late"), summary.late_frames);
  metrics.Add(Label("reason", "astray"), summary.astray_frames);
  metrics.Add(Label("reason", "surplus"), summary.overflow_frames);
  metrics.Add(Label("reason", "overload"), summary.overload_frames);
  metrics.Add(Label("reason", "vanished"), summary.followed.vanished);
  metrics.Begin("unlidar_sensor_state", "gauge", "1 for the state that a sensor is in.");
  for (const LiveInput& input : summary.inputs) {
    for (const SensorState state :
         {SensorState::kOk, SensorState::kSilent, SensorState::kBlinded}) {
      metrics.Add(Label("sensor", input.name) + "," + Label("state", SensorStateName(state)),
                  std::uint64_t{input.state == state});
    }
  }
  metrics.Begin("unlidar_sensor_blinded_seconds_total", "counter",
                "Time for which a sensor did not see what it should.");
  for (const LiveInput& input : summary.inputs) {
    metrics.AddSeconds(Label("sensor", input.name), input.blinded_s);
  }
}

void AddPackets(const LiveSummary& summary, Metrics& metrics) {
  metrics.Begin("unlidar_packets_total", "counter", "Packets of --livox, by sensor and fate.");
  for (const LiveInput& input : summary.inputs) {
    if (!input.packets) continue;
    const auto add = [&](const char* fate, std::uint64_t count) {
      metrics.Add(Label("sensor", input.name) + "," + Label("fate", fate), count);
    };
    add("used", input.packets->used);
    add("lost", input.packets->lost);
    add("repeated", input.packets->repeated);
    add("reordered", input.packets->reordered);
    add("late", input.packets->late);
    add("astray", input.packets->astray);
    add("excess", input.packets->excess);
  }
  metrics.Begin("unlidar_sensor_clock", "gauge",
                "1 for what the clock of a sensor is: synchronised, no more, never.");
  for (const LiveInput& input : summary.inputs) {
    if (!input.sync) continue;
    for (const SyncState state :
         {SyncState::kSynchronised, SyncState::kLost, SyncState::kUnsynchronised}) {
      metrics.Add(Label("sensor", input.name) + "," + Label("clock", SyncStateName(state)),
                  std::uint64_t{input.sync->state() == state});
    }
  }
  metrics.Begin("unlidar_sensor_clock_losses_total", "counter",
                "How often a sensor has lost its time synchronisation.");
  for (const LiveInput& input : summary.inputs) {
    if (input.sync) metrics.Add(Label("sensor", input.name), input.sync->losses());
  }
  metrics.Begin("unlidar_packets_refused_total", "counter", "Packets that are of no Livox sensor.");
  metrics.Add("", summary.refused_packets);
  if (!summary.recording) return;
  metrics.Begin("unlidar_packets_recorded_total", "counter",
                "Packets of --record-packets, by fate: written, or lost by the disk.");
  metrics.Add(Label("fate", "written"), summary.recording->packets);
  metrics.Add(Label("fate", "lost"), summary.recording->lost_packets);
  metrics.Begin("unlidar_recording_bytes", "gauge", "Size of the captures that are there.");
  metrics.Add("", summary.recording->bytes);
}

void AddTracks(const LiveStatus& status, Metrics& metrics) {
  const LiveSummary& summary = status.summary;
  metrics.Begin("unlidar_tracks", "gauge", "Tracks that have begun and not ended.");
  metrics.Add("", std::uint64_t{status.tracks.size()});
  metrics.Begin("unlidar_tracks_total", "counter", "Tracks that have begun.");
  metrics.Add("", summary.output.tracks);
  metrics.Begin("unlidar_rows_total", "counter", "Rows of the trajectory that were written.");
  metrics.Add("", summary.output.rows);
}

void AddLoad(const LiveStatus& status, Metrics& metrics) {
  metrics.Begin("unlidar_state", "gauge", "1 for the state that the engine is in.");
  for (const LiveState state :
       {LiveState::kWarmingUp, LiveState::kRunning, LiveState::kOverloaded}) {
    metrics.Add(Label("state", LiveStateName(state)),
                std::uint64_t{!status.has_ended && status.state == state});
  }
  metrics.Begin("unlidar_newest_stamp_seconds", "gauge", "The newest stamp that was taken in.");
  metrics.Add("", SecondsText(status.newest_ns));
  const ProcessingTimes& times = status.summary.processing_times;
  metrics.Begin("unlidar_frame_cpu_seconds", "summary", "Processor time of a frame.");
  for (const char* const share : {"0.5", "0.99", "1"}) {
    metrics.AddSeconds(Label("quantile", share), times.Quantile(*ParseNumber<double>(share)));
  }
  metrics.AddSeconds("", times.sum_s(), "_sum");
  metrics.Add("", times.frames(), "_count");
  metrics.Begin("process_resident_memory_bytes", "gauge", "Resident memory.");
  metrics.Add("", std::uint64_t{status.memory_bytes});
  metrics.Begin("unlidar_build_info", "gauge", "1, with the version.");
  metrics.Add(Label("version", kVersion), std::uint64_t{1});
}

}  // namespace

std::string MetricsText(const LiveStatus& status) {
  Metrics metrics;
  AddInput(status, metrics);
  AddPackets(status.summary, metrics);
  AddTracks(status, metrics);
  AddLoad(status, metrics);
  return metrics.text();
}

}  // namespace unlidar
