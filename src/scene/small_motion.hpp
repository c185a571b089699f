// Small motion of a station, filtered from frame to frame against the surfaces of what stands
// still.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "base/voxel_numbers.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Normal distributions of the returns in cells (Biber and Strasser, IROS 2003) whose edge grows
// with range, as the spacing of rays does. A cell is a surface along those axes of its returns in
// which it is thin: one for a wall or the ground, two for a pole or an edge.
class SurfaceMap {
 public:
  struct Surface {
    Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
    int num_normals = 0;  // 0: not a surface
    std::array<Eigen::Vector3d, 3> normals;
    std::array<double, 3> variances_m2{};  // along them
  };

  // Positions are relative to the viewpoint.
  void Add(const Eigen::Vector3d& position_m);

  // Returns the surface at a position; null if none is known there. Valid until the next Add().
  const Surface* Find(const Eigen::Vector3d& position_m) const;

  // Keeps the memory.
  void Clear() {
    numbers_.Clear();
    cells_.clear();
  }

 private:
  struct Cell {
    double count = 0.0;
    double count_of_fit = 0.0;                        // when the surface was computed
    Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();  // from the centre
    Eigen::Matrix3d squares_m2 = Eigen::Matrix3d::Zero();
    Surface surface;
  };

  VoxelNumbers numbers_;  // a grid for each size of cells
  std::vector<Cell> cells_;
};

using Vector6d = Eigen::Matrix<double, 6, 1>;

// A rotation vector (rad) and a translation (m) about the viewpoint at one time, and their rates.
struct SmallMotion {
  TimeNs time_ns = 0;
  Vector6d pose = Vector6d::Zero();
  Vector6d rate_per_s = Vector6d::Zero();

  // Returns the pose at a time nearby.
  Vector6d At(TimeNs other_ns) const {
    return pose + rate_per_s * (static_cast<double>(other_ns - time_ns) * kSecondsPerNs);
  }
};

// Moves a position, relative to the viewpoint, by a pose: exact to the third power of the angle.
inline Eigen::Vector3d Moved(const Vector6d& pose, const Eigen::Vector3d& position_m) {
  const Eigen::Vector3d turned_m = pose.head<3>().cross(position_m);
  return position_m + turned_m + pose.head<3>().cross(turned_m) / 2.0 + pose.tail<3>();
}

// A return, relative to the viewpoint.
struct TimedReturn {
  Eigen::Vector3d position_m;
  TimeNs time_ns = 0;
};

// Kalman filter of poses and rates, driven by white accelerations, whose measurements are the
// distances of returns from the surfaces of a map (point to plane, Chen and Medioni 1992), each at
// the time of its return.
class SmallMotionFilter {
 public:
  explicit SmallMotionFilter(TimeNs time_ns = 0) { Begin(time_ns); }

  // Begins at rest, as far as a station that sways is. Keeps the memory.
  void Begin(TimeNs time_ns);

  void Predict(TimeNs time_ns);

  // Sets the pose about which the motion is expected.
  void SetRest(const Vector6d& pose) { rest_ = pose; }

  // Result of a frame. The returns of every other sector of azimuth are a half.
  struct Fit {
    std::size_t matched = 0;  // returns on a surface
    // Rotations (rad) by each half alone, without the motion before.
    std::array<Eigen::Vector3d, 2> half_rad;
    // Squared distances, in variances, of each half from the surfaces: at rest, and as the other
    // half moves it.
    double rest_error = 0.0;
    double held_out_error = 0.0;
  };
  Fit Update(const std::vector<TimedReturn>& returns, const SurfaceMap& map);

  const SmallMotion& motion() const { return motion_; }

  // Standard deviation (rad) of the rotation, that about the worst known axis.
  double SigmaRad() const;

 private:
  using Vector12d = Eigen::Matrix<double, 12, 1>;
  using Matrix12d = Eigen::Matrix<double, 12, 12>;

  // Distance of a return from a surface along a normal.
  struct Row {
    Vector6d gradient;  // by the pose
    double s = 0.0;     // time of the return since that of the motion
    double distance_m = 0.0;
    double variance_m2 = 0.0;
    double weight_per_m2 = 0.0;
    std::size_t half = 0;
  };

  // Matches returns, moved by a state, to surfaces. Returns how many are on one.
  std::size_t Match(const std::vector<TimedReturn>& returns, const SurfaceMap& map,
                    const Vector12d& state, double scale);
  // Compares the halves of the rows, which are of a state.
  void CompareHalves(const Vector12d& state, Fit* fit) const;

  SmallMotion motion_;
  Vector6d rest_ = Vector6d::Zero();
  Matrix12d covariance_;
  std::vector<std::size_t> halves_;  // (returns of the frame)
  std::vector<Row> rows_;            // of the frame
};

}  // namespace unlidar
