// Data passed between the stages: frames, measurements.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "base/time_list.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

inline constexpr TimeNs kNsPerSecond = 1'000'000'000;

// Rounds to the nearest nanosecond.
inline TimeNs NsOf(double seconds) {
  return std::llround(seconds * static_cast<double>(kNsPerSecond));
}

inline double SecondsOf(TimeNs duration_ns) {
  return static_cast<double>(duration_ns) * kSecondsPerNs;
}

// Order by a member, for sorting.
template <class Value, class Member>
auto By(Member Value::*member) {
  return [member](const Value& a, const Value& b) { return a.*member < b.*member; };
}

// Returns the first of `values`, which ascend by this member, that is not below `least`.
template <class Values, class Value, class Member>
auto FirstFrom(Values& values, Member Value::*member, const Member& least) {
  return std::partition_point(values.begin(), values.end(),
                              [&](const Value& value) { return value.*member < least; });
}

// LiDARs emit 5 to 20 frames per second. Those that lie farther apart may be every n-th of what was
// measured, and last less than until the next.
inline constexpr double kLongestFrameS = 0.2;
// That of most LiDARs, 10 frames per second.
inline constexpr double kCommonFrameS = 0.1;

// Pose of the carrier of a sensor at the middle of a frame. At rest: the identity.
struct CarrierPose {
  Eigen::Vector3f shift_m = Eigen::Vector3f::Zero();  // of the sensor from its first position
  Eigen::Quaternion<float, Eigen::DontAlign> rotation = Eigen::Quaternionf::Identity();
};

// One frame of one sensor; its returns are [first_return, last_return) of the recording.
struct FrameInfo {
  std::uint32_t sensor = 0;  // index into Recording::sensors
  TimeNs stamp_ns = 0;       // from the file, time offset of the sensor applied
  TimeNs begin_ns = 0;       // interval in which the frame was measured
  TimeNs end_ns = 0;
  std::uint32_t first_return = 0;
  std::uint32_t last_return = 0;
  bool is_timed = false;      // with the times of its points, given or told by their order
  float time_sigma_s = 0.0F;  // of an error of these times that the frames of a sensor share
  CarrierPose carrier;

  TimeNs middle_ns() const { return begin_ns + (end_ns - begin_ns) / 2; }
};

struct SensorInfo {
  std::string name;
  Eigen::Vector3f origin_m =
      Eigen::Vector3f::Zero();    // in the common frame; the first, if it moves
  const void* carrier = nullptr;  // identity of what carries it; null at rest
  TimeNs frame_period_ns = 0;     // median difference of its stamps
};

// All returns of all sensors in the common frame, frames in order of (stamp, sensor).
struct Recording {
  std::vector<SensorInfo> sensors;
  std::vector<FrameInfo> frames;
  std::vector<Eigen::Vector3f> points_m;  // (N)
  TimeList times_ns;                      // (N) point time, or the middle of its frame
  InputCounts counts;
  std::vector<Warning> warnings;  // about the meaning of frame names and coordinates
};

// Non-owning view of consecutive values; valid until their owner changes or frees them.
template <class T>
class View {
 public:
  View(const T* begin, std::size_t size) : begin_(begin), size_(size) {}
  View(const T* begin, const T* end) : View(begin, static_cast<std::size_t>(end - begin)) {}
  View(const std::vector<T>& values)  // NOLINT(google-explicit-constructor)
      : View(values.data(), values.size()) {}

  const T* begin() const { return begin_; }
  const T* end() const { return begin_ + size_; }
  std::size_t size() const { return size_; }
  const T& front() const { return *begin_; }
  const T& operator[](std::size_t i) const { return begin_[i]; }

 private:
  const T* begin_;
  std::size_t size_;
};
using PointsView = View<Eigen::Vector3f>;
using IndexView = View<std::uint32_t>;

// Returns the shortest frame period of all sensors; the largest TimeNs if none has one.
inline TimeNs ShortestPeriodNs(const Recording& recording) {
  TimeNs period_ns = std::numeric_limits<TimeNs>::max();
  for (const SensorInfo& sensor : recording.sensors) {
    if (sensor.frame_period_ns > 0) period_ns = std::min(period_ns, sensor.frame_period_ns);
  }
  return period_ns;
}

// Returns the mean position of the returns, at least one.
inline Eigen::Vector3d MeanOf(const Recording& recording, const IndexView& returns) {
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  for (const std::uint32_t i : returns) sum_m += recording.points_m[i].cast<double>();
  return sum_m / static_cast<double>(returns.size());
}

// Measured position of a target: the mean of `support` returns.
struct Measurement {
  TimeNs time_ns = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Identity();
  int support = 1;
  Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();  // origin of its rays
  // Log likelihood ratio of its returns, target against the clutter of their places; 0 if unknown.
  double log_ratio = 0.0;
};

// Alternative mode of a target at one time: its probability, mean and variance per axis.
struct AlternativeMode {
  TimeNs time_ns = 0;
  double probability = 0.0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d variance_m2 = Eigen::Vector3d::Zero();
};

}  // namespace unlidar
