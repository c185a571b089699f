// The events of an engine as the program writes them.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "python/named_sensors.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Renumbers and delays events like the output of --stdin: a track is reported with its first row
// and numbered then, a sensor only when its state has changed.
class StreamEvents {
 public:
  // `sensors` has the engine that emits the event.
  void Take(const EngineEvent& event, const NamedSensors& sensors);

  // Reports the state once more.
  void Close(const NamedSensors& sensors);

  // The events since the last call, a dictionary each with the keys of --events.
  pybind11::list TakeAll(const NamedSensors& sensors);

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

  void Push(EngineEvent event, const NamedSensors& sensors);

  std::vector<TimedEvent> events_;
  std::map<int, OpenTrack> open_tracks_;  // by the engine's number
  int next_number_ = 0;
  std::map<std::uint32_t, SensorState> sensor_states_;
  std::optional<EngineState> state_;
};

}  // namespace unlidar
