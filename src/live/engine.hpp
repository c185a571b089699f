// The live side of the program: frames in as they come, tracks and rows out within a second.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "base/recording.hpp"
#include "io/pcd.hpp"
#include "trajectory/output_times.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// One frame of one sensor, in the sensor's own axes and by its own clock.
struct Frame {
  std::uint32_t sensor = 0;  // index into the sensors of the engine
  TimeNs stamp_ns = 0;       // as its source says: the sensor's time offset is not yet applied
  std::string name;          // what messages call it
  PcdCloud cloud;
};

struct TrackConfirmed {
  int track_id = 0;
  TimeNs first_evidence_ns = 0;
};

struct RowGiven {
  TrajectoryRow row;
  bool is_late = false;  // older than live.delay_s, as the track was only now confirmed
};

struct TrackEnded {
  int track_id = 0;
  TimeNs last_evidence_ns = 0;
};

struct SensorChanged {
  std::uint32_t sensor = 0;
  bool is_silent = false;
};

enum class EngineState { kWarmingUp, kRunning };

using EngineEvent = std::variant<TrackConfirmed, RowGiven, TrackEnded, SensorChanged, EngineState>;

// Takes frames one by one and gives rows as soon as they are due. Time is that of the stamps, never
// the wall clock: the same frames give the same events however fast they come.
class Engine {
 public:
  using Callback = std::function<void(const EngineEvent&)>;

  // `sensors`: their names, which tie them to sensors.NAME of the config. `output_times`: as for a
  // recording.
  Engine(const Config& config, std::vector<std::string> sensors, OutputTimes output_times,
         Callback on_event);
  ~Engine();
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  // A sensor that was not known at the beginning: the index of its frames.
  std::uint32_t AddSensor(const std::string& name);

  // Frames of one sensor may come late by up to live.reorder_s; later ones are counted and dropped.
  // Throws InputError for a frame whose point times make no sense or whose stamp its sensor had
  // already; it is left out then, and the next may follow.
  void Add(Frame frame);

  // No frame will follow: gives all rows that are pending and ends all tracks.
  void Close();

  // The newest stamp taken in, time offsets applied; 0 before the first frame.
  TimeNs newest_ns() const;

  // Frames taken in and dropped as too late, empty ones among them.
  const InputCounts& counts() const;
  std::uint64_t late_frames() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace unlidar
