// Tracks drones while frames come: frames in, rows out within a second.
//
//   unlidar::Engine engine(unlidar::LoadConfig("station.yaml"), {"roof"},
//                          [](const unlidar::EngineEvent& event) {
//     if (const auto* given = std::get_if<unlidar::RowGiven>(&event)) Send(given->row);
//   });
//   while (std::optional<unlidar::Frame> frame = NextFrame()) engine.Add(std::move(*frame));
//   engine.Close();
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

// A new track, told before its first row. Tracks are numbered from 0 and keep their numbers.
struct TrackConfirmed {
  int track_id = 0;
  TimeNs first_evidence_ns = 0;
  Kind kind;  // by what was seen until now
};

// Rows of one track come in order of time. None is taken back.
struct RowGiven {
  TrajectoryRow row;
  bool is_late = false;  // older than live.delay_s and a frame: only now confirmed or seen again
  Kind kind;             // of its track, by what was seen until now
};

struct TrackEnded {
  int track_id = 0;
  TimeNs last_evidence_ns = 0;
  Kind kind;
  // Of the one fit that gave all of its rows: with an endless live.delay_s alone.
  std::optional<MinimumReport> minimum = {};
};

// Silent: without a frame for live.silent_s. Blinded: it gives frames, but does not see what it
// should: fog, snow, a covered window. What flies there may not be found.
enum class SensorState { kOk, kSilent, kBlinded };

// Told of a sensor with its first frame, and whenever it changes. With an endless live.delay_s none
// is blinded.
struct SensorChanged {
  std::uint32_t sensor = 0;  // index as of its frames
  SensorState state = SensorState::kOk;
};

// Told with the first frame, and when enough of the scene is known to find anything in it; once
// more where the clock of the stamps has gone back.
enum class EngineState { kWarmingUp, kRunning };

using EngineEvent = std::variant<TrackConfirmed, RowGiven, TrackEnded, SensorChanged, EngineState>;

// Called from within Add(), Advance() and Close(); must not call the engine's own.
using EngineCallback = std::function<void(const EngineEvent&)>;

class LiveEngine;

// Takes frames one by one and gives rows as soon as they are due. Time is that of the stamps, never
// the wall clock: the same calls give the same events however fast they come. Memory and time per
// frame are bounded by the config; with an endless live.delay_s all frames are kept, and Close()
// gives what TrackRecording() gives. Not for several threads at once.
class Engine {
 public:
  // `sensors`: their names, which tie them to `sensors` of the config. Throws ConfigError for a
  // config that CheckConfig() refuses and for the method paper with a delay that ends; UsageError
  // for a rate outside (0, 1e6] Hz.
  Engine(const Config& config, const std::vector<std::string>& sensors, EngineCallback on_event,
         const OutputTimes& output_times = FirstSensorStamps{});
  ~Engine();
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  // A sensor that was not known at the beginning: the index of its frames.
  std::uint32_t AddSensor(const std::string& name);

  // Frames may come in any order within live.reorder_s; those that come later are counted and
  // dropped. So are those whose stamps are astray: farther ahead than the clocks of most sensors
  // have come. Where eight in a row agree, and no more sensors contradict them than agree, they are
  // the time of now: after a pause they are all taken; where they are older than what was taken by
  // more than 5 s, or newer by more than live.window_s, tracks end and the engine begins anew.
  // Throws InputError for a frame of no sensor, with a stamp that its sensor
  // had already or beyond the years 1844 to 2096, or with point times that are not one per point
  // and within 1 s or 10 frames of the stamp; it is left out then, and the next may follow. Throws
  // UnitError, which is an InputError, where the first seconds of all sensors show no metres.
  void Add(Frame frame);

  // As much time has passed, although no frame says so: none older than `now_ns` less
  // live.reorder_s will come any more, time offsets applied. Gives the rows that are due and tells
  // of sensors that are silent. Nothing before the first frame.
  void Advance(TimeNs now_ns);

  // No frame will follow: gives all rows that are pending and ends all tracks.
  void Close();

  // The newest stamp taken in, time offsets applied, or the time of Advance() where that is newer;
  // 0 before the first frame. It falls where the engine begins anew only.
  TimeNs newest_ns() const;

  // What is in doubt about the frames so far, each once: a sensor that moves, z that is not up.
  const std::vector<Warning>& warnings() const;

  // Frames taken in, empty ones among them, and those dropped as too late or astray.
  const InputCounts& counts() const;
  std::uint64_t late_frames() const;
  std::uint64_t astray_frames() const;

 private:
  std::vector<std::string> sensors_;  // as messages call them
  std::string frame_name_;
  std::unique_ptr<LiveEngine> live_;
};

}  // namespace unlidar
