// Intake of frames into the engine of a live run, from any source.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "app/arguments.hpp"
#include "app/live_event_reporter.hpp"
#include "app/summary.hpp"
#include "io/arrival.hpp"
#include "io/followed_folders.hpp"
#include "io/input_limits.hpp"
#include "io/pcd.hpp"
#include "live/live_engine.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

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

  std::optional<std::size_t> SensorNamed(const std::string& name) const;

  // `first`: name of its first frame in messages. Returns its index.
  std::size_t AddSensor(const std::string& name, const std::string& first);

  // Reuses the index of a sensor that is no longer received.
  void ReplaceSensor(std::size_t sensor, const std::string& name);

  // True if a frame of this stamp and waiting time is to be processed. `waited` and `arrival` are
  // empty for a frame older than the program.
  bool IsInTime(std::size_t sensor, TimeNs stamp_ns, std::optional<Clock::duration> waited,
                const std::optional<Arrival>& arrival);

  // Processes a frame and writes the resulting output. `name`: of the frame, for messages.
  // `arrival`: of live sources. Throws InputError like TakeBadFrame(), OutputError.
  void Add(std::size_t sensor, TimeNs stamp_ns, const std::string& name, PcdCloud cloud,
           std::optional<Arrival> arrival);

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
                   std::uint64_t overflow_before, const std::string& name);
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
  std::size_t num_engine_warnings_ = 0;  // of all
};

}  // namespace unlidar
