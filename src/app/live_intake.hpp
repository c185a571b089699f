// Intake of frames into the engine of a live run, from any source, and what is told of it.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/arguments.hpp"
#include "app/live_output.hpp"
#include "app/output.hpp"
#include "app/output_files.hpp"
#include "app/returns_view.hpp"
#include "app/service.hpp"
#include "app/summary.hpp"
#include "base/format.hpp"
#include "io/arrival.hpp"
#include "io/followed_folders.hpp"
#include "io/input_limits.hpp"
#include "io/livox_frames.hpp"
#include "live/live_engine.hpp"
#include "unlidar/engine.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

struct LiveProgress {
  TimeNs newest_ns = 0;  // stamp
  std::uint64_t frames = 0;
  std::uint64_t lost_frames = 0;
};

// Sensors and tracks are reported again only after a change.
class LiveEventReporter {
 public:
  // All of them outlive it.
  LiveEventReporter(LiveOutput& output, const ServiceNotifier& service, const NoteCallback& note)
      : output_(output), service_(service), note_(note) {}

  void Note(const std::string& text) const { note_(text); }

  // Notes `text` with the count of incidents, if that is worth a note.
  void NoteCount(std::uint64_t before, std::uint64_t count, const std::string& noun,
                 const std::string& text) const {
    if (IsWorthANote(before, count)) Note(Count(count, noun) + text);
  }

  // Counts one more incident in `count` and notes it, if that is worth a note.
  void NoteIncident(const std::string& text, std::uint64_t* count) const {
    ++*count;
    if (IsWorthANote(*count - 1, *count)) Note(text);
  }

  // Sensors are numbered as they are added.
  void AddSensor(const std::string& name) { sensors_.push_back({name}); }

  // Further events of this index belong to another sensor.
  void ReplaceSensor(std::size_t index, const std::string& name) { sensors_[index] = {name}; }

  void Take(const EngineEvent& event, const LiveProgress& now);

  void ReportSensor(std::size_t index, SensorState state, TimeNs newest_ns);
  // Reports the clock of a sensor that tells of its synchronisation, also before its first frame.
  void ReportClock(std::size_t index, SyncState clock, TimeNs newest_ns);
  // As last reported, if it was.
  std::optional<SensorState> StateOf(std::size_t sensor) const { return sensors_[sensor].state; }

  // Reports at most `max_returns` returns of a frame if a view of them is due.
  void ReportReturns(std::size_t sensor, TimeNs stamp_ns,
                     const std::vector<Eigen::Vector3f>& points_m, std::size_t max_returns,
                     TimeNs newest_ns);

  // Reports that one frame in `one_in` is processed, and the number skipped so far.
  void ReportPace(std::uint64_t one_in, std::uint64_t left_out, const LiveProgress& now);

  void ReportState(const LiveProgress& now);

  // Repeats the state while frames are processed: tells an empty sky from a stopped engine.
  void SendHeartbeat(const LiveProgress& now);

  // State as last reported.
  LiveState state() const { return is_overloaded() ? LiveState::kOverloaded : state_; }
  std::uint64_t one_in() const { return one_in_; }

  // Writes everything pending. Throws OutputError.
  void Flush() { output_.Flush(); }

 private:
  void OnEngineState(EngineState state, const LiveProgress& now);

  struct Sensor {
    std::string name;
    std::optional<SensorState> state = {};  // as last reported
    std::uint64_t num_blinded = 0;
    ViewPace view = {};
    std::optional<SyncState> clock = {};
    std::uint64_t num_lost = 0;  // synchronisation
  };

  bool is_overloaded() const { return one_in_ > 1; }

  LiveOutput& output_;
  const ServiceNotifier& service_;
  const NoteCallback& note_;
  std::vector<Sensor> sensors_;
  LiveState state_ = LiveState::kWarmingUp;  // without overload
  bool has_begun_ = false;
  std::uint64_t one_in_ = 1;
  TimeNs state_reported_ns_ = 0;  // stamp
};

// Counts the fate of each frame, skips frames under overload, detects silence by the wall clock.
class LiveIntake {
 public:
  using Clock = FramePace::Clock;

  // The sensors are those of the arguments with folders, otherwise they are added as they appear.
  // All arguments but `trace`, which may be empty, must outlive it. Throws ConfigError.
  LiveIntake(const Arguments& arguments, const OutputTimes& output_times, const Config& config,
             LiveEventReporter& reporter, LiveTraceSink trace);
  LiveIntake(const LiveIntake&) = delete;
  LiveIntake& operator=(const LiveIntake&) = delete;

  // Limits the sensors, so that garbage that looks like ever new ones does not exhaust memory.
  bool is_full() const { return sensors_.size() >= kMaxSensors; }

  std::optional<std::uint32_t> SensorNamed(const std::string& name) const;

  // `first`: name of its first frame in messages. Returns its index.
  std::uint32_t AddSensor(const std::string& name, const std::string& first);

  // Reuses the index of a sensor that is no longer received.
  void ReplaceSensor(std::uint32_t sensor, const std::string& name);

  // True if a frame of this stamp and waiting time is to be processed. `waited` and `arrival` are
  // empty for a frame older than the program.
  bool IsInTime(std::uint32_t sensor, TimeNs stamp_ns, std::optional<Clock::duration> waited,
                const std::optional<Arrival>& arrival);

  // Processes a frame and writes the resulting output. Throws InputError like TakeBadFrame(),
  // OutputError.
  void Add(CloudFrame frame);

  // Rethrows the error unless bad frames are skipped.
  void TakeBadFrame(const InputError& error);

  // Takes the total counts; notes the new ones.
  void TakeFollowed(const FollowedCounts& counts);

  // Detects silence by the wall clock: with a pulled cable the engine's time stands still.
  void CheckSilence();

  // Notes warnings and keeps them for the summary.
  void Warn(const std::vector<Warning>& warnings);

  // No frame will follow.
  void Close();

  // The newest stamp; 0 before the first frame.
  TimeNs newest_ns() const { return engine_.newest_ns(); }

  // Returns the part of the summary known here, with name, directory and frames of each sensor.
  LiveSummary Summary() const;

 private:
  struct Sensor {
    bool is_silent_by_clock = false;
    Clock::time_point arrived = Clock::now();    // its last frame
    std::optional<TimeNs> out_of_sync_since_ns;  // by the stamps of the others
  };

  FrameCallback FrameCallbackOf(int max_returns);  // empty for 0
  void AppendSensor(const std::string& name, const std::string& directory);
  void NoteLeftOut(std::uint64_t late_before, std::uint64_t astray_before,
                   std::uint64_t overflow_before, std::string_view name);
  void CheckOutOfSync();
  LiveProgress Progress() const;

  const std::string& NameOf(std::size_t sensor) const { return summary_.inputs[sensor].name; }

  const Config& config_;
  LiveEventReporter& reporter_;
  LiveEngine engine_;
  bool skips_bad_frames_;
  const char* why_skipped_;
  FramePace pace_;
  std::vector<Sensor> sensors_;
  LiveSummary summary_;                  // without what the engine counts
  std::size_t num_engine_warnings_ = 0;  // that were passed on
};

}  // namespace unlidar
