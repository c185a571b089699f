#include "unlidar/track_recording.hpp"

#include <limits>
#include <utility>
#include <variant>

#include "api/track_collector.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

std::vector<Track> TrackRecording(const Config& config, const std::vector<std::string>& sensors,
                                  std::vector<Frame> frames, const OutputTimes& output_times) {
  Config endless = config;
  endless.live.delay_s = std::numeric_limits<double>::infinity();
  std::vector<Track> tracks;
  Engine engine(
      endless, sensors,
      [&](const EngineEvent& event) { std::visit(TrackCollector{tracks}, event); }, output_times);
  for (Frame& frame : frames) engine.Add(std::move(frame));
  engine.Close();
  return tracks;
}

}  // namespace unlidar
