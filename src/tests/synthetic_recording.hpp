// Recordings with known truth, the same with every standard library: of the random facilities only
// the engine is fixed by the standard.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "base/recording.hpp"

namespace unlidar::testing {

inline constexpr TimeNs kBeginNs = 1'700'000'000'000'000'000;
inline constexpr TimeNs kPeriodNs = 100'000'000;
inline constexpr double kPeriodS = 0.1;

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}

  double Uniform(double low, double high) {
    constexpr double kScale = 1.0 / 4294967296.0;
    return low + (high - low) * (static_cast<double>(engine_()) + 0.5) * kScale;
  }

  double Normal(double sigma) {  // Box and Muller
    const double radius = std::sqrt(-2.0 * std::log(Uniform(0.0, 1.0)));
    return sigma * radius * std::cos(2.0 * M_PI * Uniform(0.0, 1.0));
  }

  int Poisson(double mean) {  // arrivals until the unit of time is over
    int count = 0;
    double time = -std::log(Uniform(0.0, 1.0));
    while (time < mean) {
      ++count;
      time -= std::log(Uniform(0.0, 1.0));
    }
    return count;
  }

  Eigen::Vector3d InBox(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
    const double x = Uniform(low.x(), high.x());
    const double y = Uniform(low.y(), high.y());
    const double z = Uniform(low.z(), high.z());
    return {x, y, z};
  }

  Eigen::Vector3d NormalVector(double sigma) {
    const double x = Normal(sigma);
    const double y = Normal(sigma);
    const double z = Normal(sigma);
    return {x, y, z};
  }

  // A return of a ball that rays from afar meet evenly, relative to its centre. `ray`: unit vector.
  Eigen::Vector3d OnFacingSide(double radius_m, const Eigen::Vector3d& ray) {
    Eigen::Vector3d one_m;
    do {
      one_m = InBox(Eigen::Vector3d::Constant(-radius_m), Eigen::Vector3d::Constant(radius_m));
      one_m -= one_m.dot(ray) * ray;
    } while (one_m.norm() > radius_m);
    return one_m - std::sqrt(radius_m * radius_m - one_m.squaredNorm()) * ray;
  }

  std::uint32_t Index(std::size_t size) {
    return static_cast<std::uint32_t>(Uniform(0.0, static_cast<double>(size)));
  }

 private:
  std::mt19937 engine_;
};

// Builds a recording frame by frame; each return keeps a label of what it was.
class RecordingMaker {
 public:
  explicit RecordingMaker(std::uint32_t seed, std::size_t num_sensors = 1) : random(seed) {
    recording.sensors.resize(num_sensors);
    for (SensorInfo& sensor : recording.sensors) sensor.frame_period_ns = kPeriodNs;
  }

  // A frame of one period that begins at `time_s` after kBeginNs.
  void BeginFrame(double time_s, std::uint32_t sensor = 0) {
    FrameInfo frame;
    frame.sensor = sensor;
    frame.stamp_ns = frame.begin_ns = kBeginNs + std::llround(time_s * 1e9);
    frame.end_ns = frame.begin_ns + kPeriodNs;
    frame.first_return = frame.last_return = static_cast<std::uint32_t>(recording.points_m.size());
    recording.frames.push_back(frame);
  }

  void Add(const Eigen::Vector3d& point_m, int label = 0) {
    const FrameInfo& frame = recording.frames.back();
    AddAt((frame.begin_ns + frame.end_ns) / 2, point_m, label);
  }

  void AddAt(TimeNs time_ns, const Eigen::Vector3d& point_m, int label = 0) {
    recording.points_m.push_back(point_m.cast<float>());
    recording.times_ns.push_back(time_ns);
    labels.push_back(label);
    ++recording.frames.back().last_return;
  }

  // So many returns of a thing of this size (standard deviation per axis).
  void AddBlob(const Eigen::Vector3d& centre_m, double sigma_m, int count, int label = 0) {
    for (int i = 0; i < count; ++i) Add(centre_m + random.NormalVector(sigma_m), label);
  }

  // So many returns from anywhere in a box.
  void AddBox(const Eigen::Vector3d& low_m, const Eigen::Vector3d& high_m, int count,
              int label = 0) {
    for (int i = 0; i < count; ++i) Add(random.InBox(low_m, high_m), label);
  }

  // Level ground from 2 m to `reach_m` around the origin, denser near it as a LiDAR sees it.
  void AddGround(double height_m, double reach_m, int count, int label = 0) {
    for (int i = 0; i < count; ++i) {
      const double range_m = random.Uniform(2.0, reach_m);
      const double azimuth = random.Uniform(-M_PI, M_PI);
      Add({range_m * std::cos(azimuth), range_m * std::sin(azimuth),
           height_m + random.Normal(0.02)},
          label);
    }
  }

  Random random;
  Recording recording;
  std::vector<int> labels;  // (N)
};

// Frame `i` of a sensor whose frames follow each other, from kBeginNs, and its middle.
inline double MiddleS(int i) { return (i + 0.5) * kPeriodS; }

inline FrameInfo FrameAt(int i) {
  FrameInfo frame;
  frame.stamp_ns = frame.begin_ns = kBeginNs + i * kPeriodNs;
  frame.end_ns = frame.begin_ns + kPeriodNs;
  return frame;
}

inline double SecondsSinceBegin(TimeNs time_ns) {
  return static_cast<double>(time_ns - kBeginNs) * kSecondsPerNs;
}

}  // namespace unlidar::testing
