// The events of an engine as the program writes them.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "python/named_sensors.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Events frame by frame. Renumbers and delays them like the output of --stdin: a track is reported
// with its first row and numbered then, a sensor only when its state has changed.
class Stream {
 public:
  Stream(const std::string& config, const std::vector<std::string>& assignments,
         std::int64_t nanohertz, const pybind11::dict& poses);

  // Each returns the events since the last call, a dictionary each with the keys of --events.
  pybind11::list Add(const std::string& sensor, TimeNs stamp_ns, const pybind11::object& xyz,
                     const pybind11::object& offsets_ns);
  pybind11::list Advance(TimeNs now_ns);
  // Reports the state once more.
  pybind11::list Close();

  std::vector<std::string> TakeNotes() { return sensors_.TakeNotes(); }

 private:
  struct TimedEvent {
    TimeNs at_ns;
    EngineEvent event;
    std::uint64_t frames;
    std::uint64_t dropped;
  };
  struct OpenTrack {
    TimeNs first_evidence_ns = 0;
    std::optional<int> number;
  };

  void Take(const EngineEvent& event);
  void Push(EngineEvent event);
  pybind11::list TakeAll();

  std::vector<TimedEvent> events_;
  std::map<int, OpenTrack> open_tracks_;  // by the engine's number
  int next_number_ = 0;
  std::map<std::uint32_t, SensorState> sensor_states_;
  std::optional<EngineState> state_;
  NamedSensors sensors_;
};

}  // namespace unlidar
