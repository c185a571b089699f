// Implementation of Engine, with frames as the program reads them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "io/sensor_frames.hpp"
#include "live/live_tracker.hpp"
#include "live/stamp_validator.hpp"
#include "live/waiting_frames.hpp"
#include "scene/pose_check.hpp"
#include "scene/sensor_health.hpp"
#include "scene/sway.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Throws ConfigError for a config that cannot be used with streams.
void CheckLive(const Config& config);

struct DroppedFrames {
  std::uint64_t count = 0;
  std::uint32_t sensor = 0;  // of the last one
  TimeNs ahead_ns = 0;       // its stamp, not confirmed, less the newest one taken; 0 without one
};

// Tracks the recording that a stream with an endless delay is once it has ended: emits the events
// of its tracks and returns the warnings about it. Batch tracking belongs to the layers beside this
// one.
using RecordingTracker =
    std::function<std::vector<Warning>(const Recording& recording, const OutputTimes& output_times,
                                       const Config& config, const EngineCallback& on_event)>;

// Receives the returns of a frame that was taken, in the common frame and before it is tracked:
// sensor, stamp, returns.
using FrameCallback = std::function<void(std::uint32_t sensor, TimeNs stamp_ns,
                                         const std::vector<Eigen::Vector3f>& points_m)>;

// Same as Engine. `track_recording`: called if live.delay_s is infinite. `reading`: how point times
// are read; found from the frames by default. `are_metres`: the source states that its unit is the
// metre, so ranges are not used to check it. `trace`: receives measurements and decisions, unless
// live.delay_s is infinite. `on_frame`: may be empty.
class LiveEngine {
 public:
  LiveEngine(const Config& config, const std::vector<std::string>& sensors,
             OutputTimes output_times, EngineCallback on_event, RecordingTracker track_recording,
             std::optional<TimeReading> reading = std::nullopt, bool are_metres = false,
             LiveTraceSink trace = nullptr, FrameCallback on_frame = nullptr);

  std::uint32_t AddSensor(const std::string& name);

  // Replaces a silent sensor by another one.
  void ReplaceSensor(std::uint32_t sensor, const std::string& name);

  void Add(CloudFrame frame);

  // Judges the stamp of a frame that is not processed, as evidence of the clocks.
  void NoteSkipped(std::uint32_t sensor, TimeNs stamp_ns, const std::optional<Arrival>& arrival);

  void Advance(TimeNs now_ns);
  void Close();

  bool has_begun() const { return stamps_.has_begun(); }
  TimeNs newest_ns() const { return stamps_.newest_ns(); }
  const InputCounts& counts() const { return counts_; }
  std::uint64_t late_frames() const { return late_frames_; }
  // Their stamps were not confirmed.
  const DroppedFrames& astray_frames() const { return astray_; }
  // Too many were waiting for live.reorder_s.
  const DroppedFrames& overflow_frames() const { return overflow_; }
  const std::vector<Warning>& warnings() const { return warnings_; }

  SensorState StateOf(std::uint32_t sensor) const { return sensors_.at(sensor).state; }

  // True if its last frame was held: its clock differs from that of the other sensors.
  bool IsOutOfSync(std::uint32_t sensor) const { return stamps_.IsOutOfSync(sensor); }

  // Total time the sensor was blinded.
  double BlindedS(std::uint32_t sensor) const {
    return sensors_.at(sensor).sensor_health.blinded_s();
  }

  // Largest amplitude of its sway, see Sway.
  double SwayDeg(std::uint32_t sensor) const { return sway_.LargestDeg(sensor); }

 private:
  struct Sensor {
    SensorFrames frames;
    TimeNs newest_ns = 0;
    SensorState state = SensorState::kSilent;  // last reported
    SensorHealth sensor_health = {};
    PoseCheck pose = {};
    bool was_heard = false;      // at least one frame was taken
    bool is_not_metres = false;  // its coordinates cannot be metres
    TimeNs reported_period_ns = 0;
    std::vector<TimeNs> stamps_ns = {};  // of frames that may still be repeated, ascending
  };

  SensorFrames FramesOf(std::uint32_t sensor, const std::string& name) const {
    return {sensor, name, config_,
            is_endless_ ? SensorFrames::Source::kRecording : SensorFrames::Source::kStream,
            reading_};
  }
  bool CameBefore(const Sensor& sensor, const CloudFrame& frame, TimeNs stamp_ns) const;
  void Settle(StampValidator::Verdict verdict);
  void DropAstray(const HeldFrames::Condition& should_drop);
  void Take(CloudFrame frame, TimeNs stamp_ns);
  void CheckUnits(std::uint32_t index);  // throws only if every sensor's unit is wrong
  bool IsBeyondWindow(TimeNs stamp_ns) const;
  void EndTracks();
  void Restart();
  // Frames with stamps before this time are too late.
  TimeNs SettledNs() const { return newest_ns() - NsOf(config_.live.reorder_s); }
  void ReportSensorStates(std::optional<std::uint32_t> heard);
  void RemoveSway(LoadedFrame* frame);
  void UpdateSensorHealth(const LoadedFrame& frame);
  void Warn(std::uint32_t sensor, std::vector<Warning> warnings);
  bool Finish(LoadedFrame* frame);
  void PassToTracker(TimeNs until_ns, LoadedFrame* frame);
  void Release(TimeNs until_ns);
  void TrackAsRecording();

  Config config_;
  OutputTimes output_times_;
  EngineCallback on_event_;
  RecordingTracker track_recording_;
  std::optional<TimeReading> reading_;
  bool are_metres_;
  bool is_endless_;
  LiveTraceSink trace_;
  FrameCallback on_frame_;
  std::vector<Sensor> sensors_;
  WaitingFrames waiting_;
  std::unique_ptr<LiveTracker> tracker_;
  StampValidator stamps_;
  Sway sway_;
  HeldFrames held_;
  HeldFrames::Held taken_;  // from held_
  InputCounts counts_;
  std::uint64_t late_frames_ = 0;
  DroppedFrames overflow_;
  DroppedFrames astray_;
  std::vector<Warning> warnings_;                              // so far
  std::set<std::pair<std::uint32_t, std::string>> warned_of_;  // sensor and code
};

}  // namespace unlidar
