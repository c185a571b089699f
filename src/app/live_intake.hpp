// The frames of a live run on their way into the engine, whatever their source.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "app/live.hpp"
#include "app/live_event_reporter.hpp"
#include "app/live_summary.hpp"
#include "app/processing_times.hpp"
#include "io/followed_folders.hpp"
#include "io/frame_pace.hpp"
#include "io/input_limits.hpp"
#include "io/pcd.hpp"
#include "live/live_engine.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

// Counts what becomes of each, leaves frames out where too many come, and looks by the clock
// whether any come at all.
class LiveIntake {
 public:
  using Clock = FramePace::Clock;

  // The sensors of a request for folders are those of its sources, others are added as they come.
  // All arguments outlive it. Throws ConfigError.
  LiveIntake(const LiveRequest& request, const Config& config, LiveEventReporter& reporter);
  LiveIntake(const LiveIntake&) = delete;
  LiveIntake& operator=(const LiveIntake&) = delete;

  // A stream of garbage that looks like frames of ever new sensors must not fill the memory.
  bool is_full() const { return sensors_.size() >= kMaxSensors; }

  std::optional<std::size_t> SensorNamed(const std::string& name) const;
  const std::string& NameOf(std::size_t sensor) const { return sensors_[sensor].name; }

  // `first`: what messages call what arrived first of it. Returns its index.
  std::size_t AddSensor(const std::string& name, const std::string& first);

  // The place of one that is heard no more is another's from now on.
  void ReplaceSensor(std::size_t sensor, const std::string& name);

  // Whether a frame of this stamp that has waited so long is to be worked off. `waited` and
  // `arrival` are empty for one that was there before the program.
  bool IsInTime(std::size_t sensor, TimeNs stamp_ns, std::optional<Clock::duration> waited,
                const std::optional<Arrival>& arrival);

  // `name`: what messages call the frame. `arrival`: of live sources. What it brings is written.
  // Throws InputError as TakeBadFrame(), OutputError.
  void Add(std::size_t sensor, TimeNs stamp_ns, const std::string& name, PcdCloud cloud,
           std::optional<Arrival> arrival);

  // Throws it on, but where bad frames are skipped.
  void TakeBadFrame(const InputError& error);

  // So many in all. What is new is said.
  void TakeFollowed(const FollowedCounts& counts);

  // A pulled cable: time stands still for the engine, but not for who waits for an answer.
  void CheckSilence();

  // Tells them, and keeps them for the summary.
  void Warn(const std::vector<Warning>& warnings);

  // No frame will follow.
  void Close();

  // All that is known of it here: of each sensor its name and its frames.
  LiveSummary Summary() const;

 private:
  struct Sensor {
    std::string name;
    std::uint64_t frames = 0;
    bool is_silent_by_clock = false;
    Clock::time_point arrived = Clock::now();    // its last frame
    std::optional<TimeNs> out_of_sync_since_ns;  // by the stamps of the others
  };

  void AppendSensor(const std::string& name);
  void NoteLeftOut(std::uint64_t late_before, std::uint64_t astray_before, const std::string& name);
  void NoteOverflow(std::uint64_t before);
  void CheckOutOfSync();
  LiveProgress Progress() const;

  const Config& config_;
  LiveEventReporter& reporter_;
  LiveEngine engine_;
  bool skips_bad_frames_;
  const char* why_skipped_;
  FramePace pace_;
  std::vector<Sensor> sensors_;
  ProcessingTimes processing_times_;
  std::uint64_t bad_frames_ = 0;  // but for those that the engine counts
  std::uint64_t overload_frames_ = 0;
  FollowedCounts followed_;
  std::vector<Warning> warnings_;        // all,
  std::size_t num_engine_warnings_ = 0;  // and those that the engine had
};

}  // namespace unlidar
