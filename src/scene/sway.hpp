// Sway of stations without poses: small motions, estimated from what stands still and removed.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/small_motion.hpp"
#include "scene/stations.hpp"

namespace unlidar {

// A frame and its returns in the common frame.
struct SwayingFrame {
  FrameInfo* info = nullptr;
  Eigen::Vector3f* points_m = nullptr;  // (size)
  std::size_t size = 0;
  std::function<TimeNs(std::size_t)> time_ns;  // of each return
};

// A period in which the motion of a station is followed against one map.
struct SwayPeriod {
  Vector6d mean = Vector6d::Zero();  // the station at rest, relative to the map
  bool is_swaying = false;           // beyond what noise explains
};

// Motion of a station at one frame. Without a period nothing is known.
struct SwayEstimate {
  std::shared_ptr<const SwayPeriod> period;
  SmallMotion motion;
};

// Looks at each station without poses for some seconds now and then, and follows it while it sways.
// Each sensor has a map of its own, as sensors disagree by their calibration; all sensors of a
// station share the motion.
//
// A look supposes a station at rest: its maps are made of returns as they come. A station sways if
// the motion that one half of each frame tells of brings the returns of the other half, which are
// seen in other directions, nearer to the surfaces than they are at rest. In maps that are made of
// returns that are moved, a sensor that sees one band at a time agrees with any motion, so these
// come only then. Motions from 0.05 degrees rms to excursions of 3 degrees or 0.5 m are removed;
// larger ones are no sway.
class Sway {
 public:
  // Adds a frame. Frames are in order of (stamp, sensor).
  SwayEstimate Observe(const SensorInfo& sensor, const SwayingFrame& frame);

  // Estimates the motion at an observed frame again, with maps that by now hold more frames, whose
  // returns are corrected. Frames are in order.
  SwayEstimate Refine(const SwayEstimate& estimate, const SwayingFrame& frame);

  // Moves the returns of the frame to where they would be with the station at rest, and sets the
  // pose of its carrier. Changes nothing unless the station sways.
  void Correct(const SwayEstimate& estimate, const SwayingFrame& frame) const;

  // Forgets a sensor, whose number is another one's from now on.
  void Forget(std::uint32_t sensor) { station_of_.erase(sensor); }

  // Returns the largest amplitude of the rotation so far, over some seconds; 0 unless the station
  // of the sensor swayed.
  double LargestDeg(std::uint32_t sensor) const;

  // Returns the warning that a station sways, for its first sensor.
  std::optional<Warning> WarningOf(std::uint32_t sensor, const std::string& name) const;

 private:
  // State of a period.
  struct Following {
    TimeNs begin_ns = 0;
    bool is_moving = false;  // maps are made of returns that are moved
    TimeNs judged_ns = 0;
    std::optional<TimeNs> matched_ns;  // last frame with enough returns on surfaces
    // Means over frames, at most the last ones.
    double weight = 0.0;
    // Product of the rotations of the halves from rest: their variance, without noise.
    double product_rad2 = 0.0;
    Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero();  // of the rotation from rest
    double rest_error = 0.0;                             // see SmallMotionFilter::Fit
    double held_out_error = 0.0;

    explicit Following(TimeNs time_ns) : begin_ns(time_ns) {}
  };
  struct Station {
    std::uint32_t first_sensor = 0;
    TimeNs newest_ns = 0;
    TimeNs rest_until_ns = 0;
    std::optional<Following> following;
    std::optional<SmallMotionFilter> refining;  // of the last period
    // State of the last period, whose memory serves the next.
    SmallMotionFilter filter;
    std::shared_ptr<SwayPeriod> period;
    std::map<std::uint32_t, SurfaceMap> maps;  // of sensors
    Queue<Vector6d> poses;                     // of the last frames
    double largest_rad = 0.0;                  // of all periods with sway
  };

  void Follow(std::uint32_t sensor, const Eigen::Vector3d& viewpoint_m, const SwayingFrame& frame,
              Station* station);
  void Judge(const SmallMotionFilter::Fit& fit, TimeNs time_ns, Station* station);

  Stations places_;
  std::vector<Station> stations_;
  std::map<std::uint32_t, std::size_t> station_of_;
  std::vector<TimedReturn> sampled_;
};

}  // namespace unlidar
