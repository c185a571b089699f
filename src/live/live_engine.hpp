// The engine behind Engine, with frames as the program reads them.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/pcd.hpp"
#include "io/sensor_frames.hpp"
#include "live/live_tracker.hpp"
#include "robust/scene/sight.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// One frame of one sensor, in the sensor's own axes and by its own clock.
struct CloudFrame {
  std::uint32_t sensor = 0;  // index into the sensors of the engine
  TimeNs stamp_ns = 0;       // as its source says: the sensor's time offset is not yet applied
  std::string_view name;     // what messages call it
  PcdCloud cloud;
};

// Throws ConfigError for a config that no stream can be tracked by.
void CheckLive(const Config& config);

// As Engine. How point times are read follows from the frames, or is given.
class LiveEngine {
 public:
  LiveEngine(const Config& config, const std::vector<std::string>& sensors,
             OutputTimes output_times, EngineCallback on_event,
             std::optional<TimeReading> reading = std::nullopt);

  std::uint32_t AddSensor(const std::string& name);
  void Add(CloudFrame frame);
  void Advance(TimeNs now_ns);
  void Close();

  TimeNs newest_ns() const { return newest_ns_; }
  const InputCounts& counts() const { return counts_; }
  std::uint64_t late_frames() const { return late_frames_; }

  // As it was last told.
  SensorState StateOf(std::uint32_t sensor) const { return sensors_.at(sensor).state; }

  // For so long the sensor was blinded.
  double BlindedS(std::uint32_t sensor) const { return sensors_.at(sensor).sight.blinded_s(); }

 private:
  struct Sensor {
    explicit Sensor(SensorFrames its_frames) : frames(std::move(its_frames)) {}

    SensorFrames frames;
    TimeNs newest_ns = 0;
    SensorState state = SensorState::kSilent;  // as it was told, and before it is
    SensorSight sight;
    TimeNs told_period_ns = 0;
    std::vector<TimeNs> stamps_ns;  // of the frames that may still come twice, ascending
    int frames_of_past = 0;         // that came one after the other, beyond all memory
  };

  struct Waiting {
    TimeNs stamp_ns = 0;
    LoadedFrame frame;

    // By stamp and sensor.
    bool ComesBefore(const Waiting& other) const {
      return stamp_ns < other.stamp_ns ||
             (stamp_ns == other.stamp_ns && frame.info.sensor < other.frame.info.sensor);
    }
  };

  SensorFrames FramesOf(std::uint32_t sensor, const std::string& name) const;
  bool HasClockGoneBack(Sensor* sensor, TimeNs stamp_ns) const;
  bool HasForgottenAll(TimeNs stamp_ns) const;
  void BeginAnew();
  TimeNs SettledNs() const;
  void TellSensors(std::optional<std::uint32_t> heard);
  void LookAt(const LoadedFrame& frame);
  void HandOn(TimeNs until_ns, LoadedFrame* frame);
  void Release(TimeNs until_ns);
  void TrackAll();

  Config config_;
  OutputTimes output_times_;
  EngineCallback on_event_;
  std::optional<TimeReading> reading_;
  bool is_endless_;
  std::vector<Sensor> sensors_;
  // The first `num_waiting_` are a heap, the earliest on top. Others are room for more, with the
  // memory of frames that have gone.
  std::vector<Waiting> waiting_;
  std::size_t num_waiting_ = 0;
  std::unique_ptr<LiveTracker> tracker_;
  bool has_begun_ = false;  // with a frame, by the clock of now
  TimeNs newest_ns_ = 0;
  InputCounts counts_;
  std::uint64_t late_frames_ = 0;
};

}  // namespace unlidar
