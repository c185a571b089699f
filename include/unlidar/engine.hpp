// Online tracking of drones: frames in, rows out within a second. docs/cpp_api.md has an example.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// A new track, reported before its first row. Tracks are numbered from 0 and keep their numbers.
struct TrackConfirmed {
  int track_id = 0;
  TimeNs first_evidence_ns = 0;
  Kind kind;  // as judged so far
};

// Rows of one track are emitted in order of time. None is retracted.
struct RowGiven {
  TrajectoryRow row;
  bool is_late = false;  // by more than live.delay_s and a frame: just confirmed or reacquired
  Kind kind;             // of its track, as judged so far
};

// State of a track at the newest stamp, predicted from its detections so far. Emitted for each
// confirmed track at each frame that is the newest. Sigmas are those of the prediction. Not emitted
// if live.delay_s is infinite.
struct TrackPredicted {
  TrajectoryRow row;      // support: 0
  double unseen_s = 0.0;  // since its last evidence
  Kind kind;              // as judged so far
};

struct TrackEnded {
  int track_id = 0;
  TimeNs last_evidence_ns = 0;
  Kind kind;
  // Of the single fit behind all rows; set only if live.delay_s is infinite.
  std::optional<MinimumReport> minimum = {};
};

// Silent: no frame for live.silent_s. Blinded: frames arrive, but lack expected returns (fog, snow,
// a covered window); targets may be missed.
enum class SensorState { kOk, kSilent, kBlinded };

// Emitted with the first frame of a sensor and at each change of its state. No sensor is reported
// as blinded if live.delay_s is infinite.
struct SensorChanged {
  std::uint32_t sensor = 0;  // same as Frame::sensor
  SensorState state = SensorState::kOk;
};

// Emitted with the first frame and at the end of the warm-up; again after the clock of the stamps
// has jumped back.
enum class EngineState { kWarmingUp, kRunning };

using EngineEvent =
    std::variant<TrackConfirmed, RowGiven, TrackPredicted, TrackEnded, SensorChanged, EngineState>;

// Called from within Add(), Advance() and Close(); may call const functions of the engine only.
using EngineCallback = std::function<void(const EngineEvent&)>;

class LiveEngine;

// Takes frames one by one and emits rows as soon as they are due. Time is that of the stamps, never
// the wall clock: the same calls give the same events at any speed. Memory and time per frame are
// bounded by the config; with an infinite live.delay_s all frames are kept, and Close() emits the
// rows that TrackRecording() returns. Not thread-safe.
class Engine {
 public:
  // `sensors`: names of the sensors, the keys to `sensors` of the config. Throws ConfigError for a
  // config that CheckConfig() refuses and for the method paper with a finite delay; UsageError for
  // a rate outside (0, 1e6] Hz.
  Engine(const Config& config, const std::vector<std::string>& sensors, EngineCallback on_event,
         const OutputTimes& output_times = FirstSensorStamps{});
  ~Engine();
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  // Adds a sensor not named at construction. Returns its index, see Frame::sensor.
  std::uint32_t AddSensor(const std::string& name);

  // Frames may arrive in any order within live.reorder_s; later ones are counted and dropped. So
  // are frames with a stray stamp: farther ahead than the clocks of most sensors. If eight stray
  // stamps in a row agree, and no more sensors contradict them than agree, they define the current
  // time: after a pause all are accepted; if they are older than the accepted ones by more than
  // 5 s, or newer by more than live.window_s, tracks end and the engine starts anew.
  // Throws InputError for a frame of an unknown sensor, with a repeated stamp or one outside the
  // years 1844 to 2096, or with point times that are not one per point and within 1 s or 10 frames
  // of the stamp; that frame is ignored and the next may follow. Throws UnitError, an InputError,
  // if the first seconds of all sensors are not in metres.
  void Add(Frame frame);

  // Advances time without a frame: no frame older than `now_ns` less live.reorder_s will follow,
  // time offsets applied. Emits the rows that are due and reports silent sensors. Does nothing
  // before the first frame.
  void Advance(TimeNs now_ns);

  // Emits all pending rows and ends all tracks; no frame may follow.
  void Close();

  // Returns the newest accepted stamp, time offsets applied, or the time of Advance() if newer; 0
  // before the first frame. Decreases only when the engine starts anew.
  TimeNs newest_ns() const;

  // Warnings about the frames so far, each once: a moving sensor, a z axis that is not up.
  const std::vector<Warning>& warnings() const;

  // Frames accepted, including empty ones, and those dropped: too late, with a stray stamp, or more
  // than may wait for earlier ones.
  const InputCounts& counts() const;
  std::uint64_t late_frames() const;
  std::uint64_t astray_frames() const;
  std::uint64_t overflow_frames() const;

 private:
  std::vector<std::string> sensors_;  // names for messages
  std::string frame_name_;
  std::unique_ptr<LiveEngine> live_;
};

}  // namespace unlidar
