// The engine behind Engine, with frames as the program reads them.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/sensor_frames.hpp"
#include "live/held_frames.hpp"
#include "live/live_tracker.hpp"
#include "live/stamp_validator.hpp"
#include "live/waiting_frames.hpp"
#include "scene/pose_check.hpp"
#include "scene/sensor_health.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Throws ConfigError for a config that no stream can be tracked by.
void CheckLive(const Config& config);

// The frames whose stamps were not borne out, and were left out.
struct AstrayFrames {
  std::uint64_t count = 0;
  std::uint32_t sensor = 0;  // of the last of them,
  TimeNs ahead_ns = 0;       // and its stamp, less the newest that was taken; 0 without one
};

// The frames that were more than may wait for live.reorder_s, and were left out.
struct OverflowFrames {
  std::uint64_t count = 0;
  std::uint32_t sensor = 0;  // of the last of them
};

// As Engine. How point times are read follows from the frames, or is given. `are_metres`: the
// source states the unit of its coordinates, so that no range makes it doubtful.
class LiveEngine {
 public:
  LiveEngine(const Config& config, const std::vector<std::string>& sensors,
             OutputTimes output_times, EngineCallback on_event,
             std::optional<TimeReading> reading = std::nullopt, bool are_metres = false);

  std::uint32_t AddSensor(const std::string& name);

  // Another sensor takes the place of one that is heard no more.
  void ReplaceSensor(std::uint32_t sensor, const std::string& name);

  void Add(CloudFrame frame);

  // A frame has come, but is not to be worked off. Its stamp tells of the clocks all the same.
  void NoteSkipped(std::uint32_t sensor, TimeNs stamp_ns, const std::optional<Arrival>& arrival);

  void Advance(TimeNs now_ns);
  void Close();

  bool has_begun() const { return stamps_.has_begun(); }
  TimeNs newest_ns() const { return stamps_.newest_ns(); }
  const InputCounts& counts() const { return counts_; }
  std::uint64_t late_frames() const { return late_frames_; }
  const AstrayFrames& astray_frames() const { return astray_; }
  const OverflowFrames& overflow_frames() const { return overflow_; }
  const std::vector<Warning>& warnings() const { return warnings_; }

  // As it was last told.
  SensorState StateOf(std::uint32_t sensor) const { return sensors_.at(sensor).state; }

  // Whether its last frame was set aside: its clock is not that of the others.
  bool IsOutOfSync(std::uint32_t sensor) const { return stamps_.IsOutOfSync(sensor); }

  // For so long the sensor was blinded.
  double BlindedS(std::uint32_t sensor) const {
    return sensors_.at(sensor).sensor_health.blinded_s();
  }

 private:
  struct Sensor {
    explicit Sensor(SensorFrames its_frames) : frames(std::move(its_frames)) {}

    SensorFrames frames;
    TimeNs newest_ns = 0;
    SensorState state = SensorState::kSilent;  // as it was told, and before it is
    SensorHealth sensor_health;
    PoseCheck pose;
    bool was_heard = false;      // ever,
    bool is_not_metres = false;  // and its coordinates can be none
    TimeNs reported_period_ns = 0;
    std::vector<TimeNs> stamps_ns;  // of the frames that may still come twice, ascending
  };

  SensorFrames FramesOf(std::uint32_t sensor, const std::string& name) const;
  bool CameBefore(const Sensor& sensor, const CloudFrame& frame, TimeNs stamp_ns) const;
  void Settle(StampValidator::Verdict verdict);
  void TakeHeld();
  template <class ShouldDrop>
  void DropAstray(const ShouldDrop& should_drop);
  void Take(CloudFrame frame, TimeNs stamp_ns);
  void DropOverflow();
  void CheckUnits(std::uint32_t index);  // a sensor of another unit does not end the run of others
  bool HasForgottenAll(TimeNs stamp_ns) const;
  void EndTracks();
  void Restart();
  TimeNs SettledNs() const;
  void ReportSensorStates(std::optional<std::uint32_t> heard);
  void UpdateSensorHealth(const LoadedFrame& frame);
  void Warn(std::uint32_t sensor, std::vector<Warning> warnings);
  void PassToTracker(TimeNs until_ns, LoadedFrame* frame);
  void Release(TimeNs until_ns);
  void TrackAll();

  Config config_;
  OutputTimes output_times_;
  EngineCallback on_event_;
  std::optional<TimeReading> reading_;
  bool are_metres_;
  bool is_endless_;
  std::vector<Sensor> sensors_;
  WaitingFrames waiting_;
  std::unique_ptr<LiveTracker> tracker_;
  StampValidator stamps_;
  HeldFrames held_;
  HeldFrames::Held taken_;  // from there
  InputCounts counts_;
  std::uint64_t late_frames_ = 0;
  OverflowFrames overflow_;
  AstrayFrames astray_;
  std::vector<Warning> warnings_;                              // what is in doubt so far
  std::set<std::pair<std::uint32_t, std::string>> warned_of_;  // sensor and code
};

}  // namespace unlidar
