// Events, state and notes of a live run.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "app/live_output.hpp"
#include "app/output_files.hpp"
#include "app/returns_view.hpp"
#include "app/service.hpp"
#include "io/livox_frames.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// True if a count has reached 1, 2, 4, 8, ... since it was `before`: repeated incidents are noted
// ever less often.
inline bool IsWorthANote(std::uint64_t before, std::uint64_t count) {
  return (before ^ count) > before;  // a higher bit is set
}

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

  // The same with the count of incidents before it, if that is worth a note.
  void NoteCount(std::uint64_t before, std::uint64_t count, const std::string& noun,
                 const std::string& text) const;

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

}  // namespace unlidar
