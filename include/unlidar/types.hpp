// Input and output types: frames, output times, rows.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace unlidar {

// Unix time in integer nanoseconds: a double would lose the last 200 ns of a stamp.
using TimeNs = std::int64_t;

inline constexpr double kSecondsPerNs = 1e-9;

// One frame of one sensor, in the sensor's own axes and clock; `sensors` of the config has its pose
// and time offset, `poses` those of its carrier.
struct Frame {
  std::uint32_t sensor = 0;  // index into the sensor names
  TimeNs stamp_ns = 0;       // instant of the frame chosen by input.stamp of the config
  // (N) All rays or those with a return; points with NaN or Inf and (0, 0, 0) are counted and
  // skipped.
  std::vector<Eigen::Vector3f> points_m;
  // (N) Measurement time of each ray, in nanoseconds from the stamp; empty if unknown: then the
  // order of the points may tell (those of a LiDAR that turns, in the order in which it fires).
  std::vector<std::int64_t> offsets_ns;
};

// Pose of a carrier of sensors: p_world = R(rotation) p_carrier + position_m.
struct Pose {
  TimeNs time_ns = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector4d rotation_xyzw = Eigen::Vector4d(0, 0, 0, 1);  // unit quaternion
};

// Times of the rows: the stamps of the first sensor's frames, a fixed rate, or a list.
struct FirstSensorStamps {};
struct Rate {
  std::int64_t nanohertz = 0;  // above 0 to 1e15
};
using OutputTimes = std::variant<FirstSensorStamps, Rate, std::vector<TimeNs>>;

// One row of the trajectory.
struct TrajectoryRow {
  TimeNs time_ns = 0;
  int track_id = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_m = Eigen::Vector3d::Zero();
  // Number of returns of the target in frames whose stamps are closer to this row than to any other
  // row of its track.
  int support = 0;
};

// Class probabilities of a track, which add up to 1, each a multiple of 0.0001. `unknown`: too
// little evidence, or a flight like neither.
struct Kind {
  double drone = 0.0;
  double bird_like = 0.0;  // birds and bats
  double unknown = 1.0;
};

// Report of the minimisation of a fit; `solver` is "ceres" or "banded".
struct MinimumReport {
  const char* solver = "banded";
  int iterations = 0;
  bool converged = false;
  // Set by Ceres only, also if it did not converge and the banded solver found the minimum instead:
  // half of the minimised sum at the start and the end, and Ceres' own termination type.
  double initial_cost = 0.0;
  double final_cost = 0.0;
  const char* termination = "";
};

// A suspected fault of the input: results may be wrong although nothing failed.
struct Warning {
  std::string code;  // stable, for programs: lower case with '_'
  std::string text;  // one line, for people; names the sensor

  friend bool operator==(const Warning& a, const Warning& b) {
    return a.code == b.code && a.text == b.text;
  }
};

// Counts of the input, for the summary and for messages.
struct InputCounts {
  std::uint64_t frames = 0;
  std::uint64_t empty_frames = 0;
  std::uint64_t bad_frames = 0;       // skipped, only with input.skip_bad_frames
  std::uint64_t unplaced_frames = 0;  // left out: no pose of their carrier
  std::uint64_t rows = 0;
  std::uint64_t no_return_rows = 0;     // (0, 0, 0): a ray without a return
  std::uint64_t non_finite_rows = 0;    // NaN or Inf
  std::uint64_t out_of_range_rows = 0;  // beyond input.max_range_m or closer than min_range_m
  std::uint64_t returns = 0;
};

}  // namespace unlidar
